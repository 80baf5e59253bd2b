"""The score of a sealed benchmark: commitments checked, claims held against answers."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from wrenchbed.blind import answer as answers_
from wrenchbed.blind import claims as claims_
from wrenchbed.blind import seal
from wrenchbed.blind.answer import Answer, Oracle
from wrenchbed.blind.claims import Said
from wrenchbed.diagnosis.linear import Claim
from wrenchbed.diagnosis.scoring_rows import OURS, Number, Row
from wrenchbed.diagnosis.scoring_truth import as_published
from wrenchbed.errors import BenchmarkError
from wrenchbed.referee.catalogue import STATED

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
    rows: tuple[Row, ...]
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
    sealed = seal.verify(cases, answers, published)
    names = claims_.entrants(claims, main)
    told = {n: answers_.read(seal.answer_of(answers, n)) for n in sealed}
    wrong = next((n for n, a in told.items() if a.case != n), None)
    if wrong is not None:
        raise BenchmarkError(f"{seal.answer_of(answers, wrong)}: answers case {told[wrong].case}")
    rows, unclaimed = [], 0
    for name, truth in told.items():
        said = {n: claims_.read(claims / n / name, sealed[name].recording) for n in names}
        unclaimed += not (claims / names[0] / name).is_dir()
        rows.append(_row(truth, said[names[0]], {n: said[n] for n in names[1:]}))
    root = seal.digest((cases / seal.COMMITMENTS).read_bytes())
    return Score(names[0], tuple(names[1:]), tuple(rows), told, root, unclaimed)


def _row(truth: Answer, own: Said, others: dict[str, Said]) -> Row:
    every = {OURS: own, **others}
    closed = own_closed(truth, own)
    answers = {k: s.claim for k, s in every.items()}
    if truth.oracle is not None:
        answers[ORACLE] = _certain(truth.oracle)
    effects = truth.effects
    return Row(
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


def own_closed(truth: Answer, said: Said) -> float | None:
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


def _numbers(truth: Answer, said: Said) -> tuple[Number, ...]:
    """Published numbers of every true effect that is named first, beside the true ones.

    Of a simulated robot every number is known, 0 where none is listed; of a real one those listed.
    """
    found: list[Number] = []
    for cause in truth.causes if truth.effects else ():
        published = said.parameters.get(cause.effect, {})
        if cause.effect == "joint.compliance" and not _usable(published):
            continue
        known = COMPARED.get(cause.effect)
        told = as_published(cause.effect, published)
        found += [
            Number(f"{cause.effect}:{n}", p["value"], p["std"], cause.true.get(n, 0.0))
            for n, p in told.items()
            if known is not None
            and re.fullmatch(known, n)
            and p["std"] is not None
            and (truth.oracle is not None or n in cause.true)
        ]
    return tuple(found)


def _usable(published: Mapping[str, Any]) -> bool:
    """Whether a compliance follows: a stiffness needs a joint, and is not 0."""
    stiffness = published.get("stiffness")
    return stiffness is None or ("joint" in published and stiffness["value"] != 0.0)


_CHANNEL = "[ft][xyz]"
COMPARED: Mapping[str, str] = {
    "sensor.bias": rf"bias\.{_CHANNEL}",
    "tool.mass": "mass",
    "tool.cog": r"cog\.[xyz]",
    "tool.inertia": r"inertia\.[xyz]{2}",
    "base.tilt": "[xy]",
    "mount.rotation": r"rotation\.[xyz]",
    "joint.offset": r"offset\.q\d",
    "joint.compliance": r"compliance\.q\d",
    "sensor.gain": rf"gain\.{_CHANNEL}",
    "sensor.drift": rf"rate\.{_CHANNEL}",
    "sensor.jump": rf"step\.{_CHANNEL}",
    "sensor.crosstalk": rf"x\.{_CHANNEL}\.{_CHANNEL}",
    "link.length": r"length\.[A-Z]\d\d?[yz]?",
    "timing.delay": "delay",
    "timing.skew": "skew",
}
"""Numbers that mean the same to the referee and to the library, by effect. The moment of a jump is
not among them: any moment between two poses is as true as another."""
