"""The score of a sealed benchmark: commitments checked, claims held against answers.

Figures of a sealed benchmark: those of every benchmark, and what the data itself allows.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wrenchbed.benchmark.referee.catalogue import EFFECTS, STATED
from wrenchbed.benchmark.scoring.linear import Claim
from wrenchbed.benchmark.scoring.metrics import METRICS, SURE, Metric, holds
from wrenchbed.benchmark.scoring.rows import OURS, CaseRow, Number
from wrenchbed.benchmark.sealed import answer as answers_
from wrenchbed.benchmark.sealed import case_files, commitments
from wrenchbed.benchmark.sealed import claims as claims_
from wrenchbed.benchmark.sealed.answer import Answer, Oracle
from wrenchbed.benchmark.sealed.claims import EntrantClaim
from wrenchbed.effects.chain import effects
from wrenchbed.errors import BenchmarkError


def metrics(answers: Mapping[str, Answer]) -> dict[str, Metric]:
    """Every figure by name, those up to what data cannot tell beside the strict ones."""

    def alike(row: CaseRow) -> tuple[str, ...]:
        """True effects and those that this very data cannot tell from them."""
        return tuple(n for c in answers[row.id].causes for n in (c.effect, *c.alike))

    def isolated(row: CaseRow, method: str) -> Sequence[float] | None:
        return (holds(row.answers[method], alike(row)), 1.0) if row.kind == "single" else None

    def unlike(row: CaseRow, method: str) -> Sequence[float] | None:
        if row.kind != "single" or len(alike(row)) > 1:
            return None
        return (holds(row.answers[method], row.truth), 1.0)

    def sure(row: CaseRow, method: str) -> Sequence[float] | None:
        claim = row.answers[method]
        if not claim.causes or claim.sure <= SURE:
            return None
        allowed = alike(row) if row.truth else ()
        return (bool(set(claim.causes[0]) & set(allowed)), 1.0)

    share = METRICS["isolation"].combine
    extra = {
        "isolation_alike": Metric(
            "… or one that this data cannot tell from it",
            "≥ 95 %",
            isolated,
            share,
        ),
        "isolation_unlike": Metric("… effects that nothing imitates", "≥ 95 %", unlike, share),
    }
    told: dict[str, Metric] = {}
    for name, metric in METRICS.items():
        if name == "coverage_right":  # whose variant is right is not sealed
            continue
        told[name] = metric
        if name == "isolation":
            told |= extra
        if name == "sure":
            told["sure_alike"] = Metric(
                "… or as good as right, by what this data can tell",
                "≥ 97 %",
                sure,
                share,
            )
    return told


def first(claim: Claim) -> str:
    """Subsystem of the first cause, or the verdict."""
    return claim.causes[0][0].partition(".")[0] if claim.causes else claim.verdict


ORACLE = "oracle"


@dataclass(frozen=True, eq=False)
class Score:
    """Every case with its truth and what was said.

    Attributes:
        main: the entrant that is judged.
        others: beside it, as their names are in ``rows``.
        rows: one a case; the main entrant's claim is under `OURS`.
        answers: by case.
        root: SHA-256 of the commitments.
        unclaimed: cases that the main entrant has no claim for.
    """

    main: str
    others: tuple[str, ...]
    rows: tuple[CaseRow, ...]
    answers: dict[str, Answer]
    root: str
    unclaimed: int

    @property
    def beside(self) -> tuple[str, ...]:
        """Methods beside the judged one; an oracle where every truth is known to the last digit."""
        known = all(a.oracle is not None for a in self.answers.values())
        return (ORACLE, *self.others) if known else self.others


def score(
    cases: Path,
    claims: Path,
    answers: Path,
    main: str | None = None,
    published: str | None = None,
) -> Score:
    """Check what was committed to, and hold claims against answers.

    Args:
        cases: folder of recordings and commitments.
        claims: folder of claims, one folder an entrant.
        answers: folder of answers.
        main: entrant that is judged; wrenchbed's diagnosis, else the first.
        published: SHA-256 of the commitments as it was published with the cases, if it was.

    Raises:
        BenchmarkError: a case or an answer was changed, or claims are missing.
    """
    sealed = commitments.verify(cases, answers, published)
    names = claims_.entrants(claims, main)
    told = {n: answers_.read(case_files.answer_of(answers, n)) for n in sealed}
    wrong = next((n for n, a in told.items() if a.case != n), None)
    if wrong is not None:
        raise BenchmarkError(
            f"{case_files.answer_of(answers, wrong)}: answers case {told[wrong].case}"
        )
    rows, unclaimed = [], 0
    for name, truth in told.items():
        said = {n: claims_.read(claims / n / name, sealed[name].recording) for n in names}
        unclaimed += not (claims / names[0] / name).is_dir()
        rows.append(_row(truth, said[names[0]], {n: said[n] for n in names[1:]}))
    root = commitments.digest((cases / commitments.COMMITMENTS).read_bytes())
    return Score(names[0], tuple(names[1:]), tuple(rows), told, root, unclaimed)


def _row(truth: Answer, own: EntrantClaim, others: dict[str, EntrantClaim]) -> CaseRow:
    every = {OURS: own, **others}
    closed = closed_by_entrant(truth, own)
    answers = {k: s.claim for k, s in every.items()}
    if truth.oracle is not None:
        answers[ORACLE] = _certain(truth.oracle)
    effects = truth.effects
    return CaseRow(
        id=truth.case,
        kind=truth.kind,
        truth=effects,
        outside=truth.causes[0].effect if truth.kind == "outside" else None,
        size={c.effect: float("nan") if c.gap is None else c.gap for c in truth.causes},
        detectability={c.effect: _sigmas(truth, c) for c in truth.causes},
        between=tuple(c.effect for c in truth.causes if c.rows),
        answers=answers,
        where=own.where,
        numbers=_numbers(truth, own),
        closed=closed,
        oracle=None if closed is None or truth.oracle is None else truth.oracle.closed,
        seconds={k: s.seconds for k, s in every.items() if s.seconds is not None},
        error=own.error,
    )


def _certain(oracle: Oracle) -> Claim:
    first = "|".join(oracle.causes[0]) if oracle.causes else oracle.verdict
    return Claim(oracle.verdict, oracle.causes, {first: 1.0}, ())


def _sigmas(truth: Answer, cause: answers_.Fact) -> float:
    """Norm of a signature in noises; of a raised variance by its own scatter √(2/n)."""
    if cause.gap is None:
        return float("inf")  # who makes a fault on a real robot makes it visible
    if cause.rows:
        return cause.rows * float(np.sqrt(truth.rows / 2))
    return float(np.sqrt(6 * truth.rows * cause.gap))


def closed_by_entrant(truth: Answer, said: EntrantClaim) -> float | None:
    """Share of the gap on rows that no fit saw that an entrant says it closes; 0 if it says none.

    None where a cause shows between rows: then the floor itself rose.
    Of causes that are only wrong stated numbers from the configured simulator on, else from the
    calibrated one.
    """
    if not truth.effects or any(c.rows for c in truth.causes):
        return None
    start = "configured" if set(truth.effects) <= set(STATED) else "calibrated"
    gap = said.gap
    if not said.claim.causes or not {start, "floor", "calibrated"} <= set(gap):
        return 0.0
    whole = gap[start] - gap["floor"]
    after = gap.get("with_effects", gap["calibrated"])
    return (gap[start] - after) / whole if whole > 0 else 0.0


def _numbers(truth: Answer, said: EntrantClaim) -> tuple[Number, ...]:
    """Published numbers of every true effect that is named first, beside the true ones.

    Of a simulated robot every number is known, 0 where none is listed; of a real one those listed.
    """
    found: list[Number] = []
    for cause in truth.causes if truth.effects else ():
        published = said.parameters.get(cause.effect, {})
        known = EFFECTS[cause.effect].compared if cause.effect in EFFECTS else ""
        told = effects()[cause.effect].amplitudes(published) if known else None
        found += [
            Number(f"{cause.effect}:{n}", p["value"], p["std"], cause.true.get(n, 0.0))
            for n, p in (told or {}).items()
            if re.fullmatch(known, n)
            and p["std"] is not None
            and (truth.oracle is not None or n in cause.true)
        ]
    return tuple(found)
