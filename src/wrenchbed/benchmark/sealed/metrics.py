"""Figures of sealed cases, whose referee knows which effects each case's data cannot tell apart."""

from collections.abc import Callable, Sequence

from wrenchbed.benchmark.scoring.case_rows import CaseRow, Claim
from wrenchbed.benchmark.scoring.metrics import (
    METRICS,
    SURE,
    Metric,
    holds,
    isolated,
    matched,
    named,
    of_kind,
    share,
)
from wrenchbed.diagnosis.evidence.search import NONE

_Held = Callable[[CaseRow, str], bool]
_ALIKE = "… or one that this data cannot tell from it"


def _alike(row: CaseRow, claim: Claim) -> bool:
    return holds(claim, (*row.truth, *row.alike))


_BESIDE = {
    "isolation": {
        "isolation_alike": share(_ALIKE, "≥ 95 %", of_kind("single"), _alike),
        "isolation_unlike": share(
            "… effects that nothing imitates", "≥ 95 %",
            lambda row, claim: row.kind == "single" and not row.alike, isolated,
        ),
    },
    "sure": {
        "sure_alike": share(
            "… or as good as right, by what this data can tell", "≥ 97 %", named,
            lambda row, claim: bool({*row.truth, *row.alike} & set(claim.causes[0])),
        ),
    },
    "coverage": {
        "sets": share(
            "90 % sets of answers hold the truth", "87–93 %",
            lambda row, claim: bool(claim.set90),
            lambda row, claim: bool(
                set(claim.set90) & (set(row.truth) or {"unknown" if row.outside else "none"})
            ),
            ours=True,
        ),
    },
}  # fmt: skip
"""Figures that need what the referee knows of each case, by the figure that they stand below."""
SEALED = {
    name: metric
    for key, first in METRICS.items()
    if key != "coverage_right"  # whose variant is right is not sealed
    for name, metric in {key: first, **_BESIDE.get(key, {})}.items()
}
"""All metrics of sealed cases by name."""


def semi_real(rows: Sequence[CaseRow]) -> dict[str, Metric]:
    """Figures of faults added to a recording, of which only the added effects are known.

    What an entrant claims of the recording as it is, it may claim of every other case, too.

    Args:
        rows: every case of a family, of which one is the recording as it is.
    """

    def own(method: str) -> set[str]:
        """Effects that an entrant claims of the recording as it is."""
        return {n for r in rows if r.kind == "none" for c in r.answers[method].causes for n in c}

    def by_method(
        title: str, target: str, counts: _Held, said: _Held
    ) -> Metric:  # fmt: skip
        return Metric(
            title, target,
            lambda row, method: (said(row, method), 1.0) if counts(row, method) else None,
        )  # fmt: skip

    def new(row: CaseRow, method: str) -> bool:
        return row.kind == "single" and row.truth[0] not in own(method)

    def larger(row: CaseRow, method: str) -> bool:
        if not new(row, method) or row.between:
            return False
        return row.size[row.truth[0]] > (row.real_gap or 0.0)

    def held(row: CaseRow, method: str) -> bool:
        return holds(row.answers[method], row.truth)

    def misnamed(row: CaseRow, method: str) -> bool:
        allowed = own(method) | set(row.truth)
        return any(not allowed & set(c) for c in _sure_classes(row.answers[method]))

    def silent(row: CaseRow, method: str) -> bool:
        """Whether an entrant reports something unknown and names no new cause."""
        claim = row.answers[method]
        names = {n for c in claim.causes for n in c}
        return claim.verdict in ("unknown", "partial") and names <= own(method)

    def pairs(row: CaseRow, method: str) -> Sequence[float] | None:
        named, _, missed = matched(row, row.answers[method])
        return (named, named + missed) if row.kind == "pair" else None

    def added(row: CaseRow, method: str) -> bool:
        return row.kind != "none"

    def outside(row: CaseRow, method: str) -> bool:
        return row.kind == "outside"

    return {
        "isolation": share(METRICS["isolation"].title, "≥ 95 %", of_kind("single"), isolated),
        "isolation_alike": _BESIDE["isolation"]["isolation_alike"],
        "isolation_new": by_method(
            "… effects not claimed of the recording as it is", "≥ 95 %", new, held
        ),
        "isolation_larger": by_method(
            "… and with a gap above the recording's own", "≥ 95 %", larger, held
        ),
        "single_unknown": by_method(
            "single effects: nothing new named, and something called unknown", "", new, silent
        ),
        "single_none": by_method(
            "single effects: none", "", new, lambda row, m: row.answers[m].verdict == NONE
        ),
        "pairs_found": Metric("two effects: found", "", pairs),
        "misnamed": by_method(
            "another effect with p > 0.9, not claimed of the recording as it is", "≤ 2 %",
            added, misnamed,
        ),
        "unknown": METRICS["unknown"],
        "unknown_partly": by_method(
            "… or nothing named but what is claimed of the recording as it is", "≥ 95 %",
            outside, silent,
        ),
        "outside_misnamed": by_method(
            "outside the library: named with p > 0.9, not claimed of the recording as it is",
            "≤ 2 %", outside, misnamed,
        ),
    } | {k: METRICS[k] for k in ("seconds", "failed")}  # fmt: skip


def _sure_classes(claim: Claim) -> list[tuple[str, ...]]:
    """Claimed classes with a stated probability above 0.9."""
    stated = claim.presence or [claim.probabilities.get("|".join(c), 0.0) for c in claim.causes]
    return [c for c, p in zip(claim.causes, stated, strict=False) if p > SURE]
