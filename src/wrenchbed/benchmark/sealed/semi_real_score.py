"""Figures of semi-real cases: only the added effects are known, the recording's own are not.

What an entrant claims of the recording as it is, it may claim of every other case, too.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from wrenchbed.benchmark.scoring.case_rows import CaseRow
from wrenchbed.benchmark.scoring.linear_problem import Claim
from wrenchbed.benchmark.scoring.metrics import METRICS, SURE, Metric, holds, matched
from wrenchbed.benchmark.sealed.answer import Answer

Parts = Callable[[CaseRow, str], Sequence[float] | None]


def metrics(rows: Sequence[CaseRow], answers: Mapping[str, Answer]) -> dict[str, Metric]:
    """Every figure by name.

    Args:
        rows: every case of a family.
        answers: by case.
    """

    def own(method: str) -> set[str]:
        """Effects that an entrant claims of the recording as it is."""
        return {n for r in rows if r.kind == "none" for c in r.answers[method].causes for n in c}

    def new(row: CaseRow, method: str) -> bool:
        return row.kind == "single" and row.truth[0] not in own(method)

    def larger(row: CaseRow, method: str) -> bool:
        real = answers[row.id].real_gap
        return new(row, method) and not row.between and row.size[row.truth[0]] > (real or 0.0)

    def isolated(counts: Callable[[CaseRow, str], bool]) -> Parts:
        return _share_of(counts, lambda row, method: holds(row.answers[method], row.truth))

    def alike(row: CaseRow, method: str) -> bool:
        named = [n for c in answers[row.id].causes for n in (c.effect, *c.alike)]
        return holds(row.answers[method], named)

    def misnamed(row: CaseRow, method: str) -> bool:
        allowed = own(method) | set(row.truth)
        return any(not allowed & set(c) for c in sure_classes(row.answers[method]))

    def silent(row: CaseRow, method: str) -> bool:
        """Whether an entrant says that something unknown is there, and names nothing new."""
        claim = row.answers[method]
        names = {n for c in claim.causes for n in c}
        return claim.verdict in ("unknown", "partial") and names <= own(method)

    def said(verdict: str) -> Callable[[CaseRow, str], bool]:
        return lambda row, method: row.answers[method].verdict == verdict

    def kind(*names: str) -> Callable[[CaseRow, str], bool]:
        return lambda row, method: row.kind in names

    def found(row: CaseRow, method: str) -> Sequence[float] | None:
        hits, _, missed = matched(row, row.answers[method])
        return (hits, hits + missed) if row.kind == "pair" else None

    share = METRICS["isolation"].combine
    single = kind("single")
    added = kind("single", "pair", "outside")
    table: dict[str, tuple[str, str, Parts]] = {
        "isolation": (METRICS["isolation"].title, "≥ 95 %", isolated(single)),
        "isolation_alike": (
            "… or one that this data cannot tell from it", "≥ 95 %", _share_of(single, alike),
        ),
        "isolation_new": (
            "… effects not claimed of the recording as it is", "≥ 95 %", isolated(new),
        ),
        "isolation_larger": (
            "… and with a gap above the recording's own", "≥ 95 %", isolated(larger),
        ),
        "single_unknown": (
            "single effects: nothing new named, and something called unknown", "",
            _share_of(new, silent),
        ),
        "single_none": ("single effects: none", "", _share_of(new, said("none"))),
        "pairs_found": ("two effects: found", "", found),
        "misnamed": (
            "another effect with p > 0.9, not claimed of the recording as it is", "≤ 2 %",
            _share_of(added, misnamed),
        ),
        "unknown": (
            METRICS["unknown"].title, "≥ 95 %", _share_of(kind("outside"), said("unknown")),
        ),
        "unknown_partly": (
            "… or nothing named but what is claimed of the recording as it is", "≥ 95 %",
            _share_of(kind("outside"), silent),
        ),
        "outside_misnamed": (
            "outside the library: named with p > 0.9, not claimed of the recording as it is",
            "≤ 2 %", _share_of(kind("outside"), misnamed),
        ),
    }  # fmt: skip
    told = {k: Metric(title, target, parts, share) for k, (title, target, parts) in table.items()}
    return told | {k: METRICS[k] for k in ("seconds", "failed")}


def _share_of(
    counts: Callable[[CaseRow, str], bool], held: Callable[[CaseRow, str], bool]
) -> Parts:
    """Sums of the share of counted cases in which something holds."""
    return lambda row, method: (held(row, method), 1.0) if counts(row, method) else None


def sure_classes(claim: Claim) -> list[tuple[str, ...]]:
    """Claimed classes with a stated probability above 0.9."""
    stated = claim.presence or [claim.probabilities.get("|".join(c), 0.0) for c in claim.causes]
    return [c for c, p in zip(claim.causes, np.asarray(stated), strict=False) if p > SURE]
