"""The truth of one case, as it is sealed."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from wrenchbed.benchmark.referee.case import RefereeCase, TrueCause
from wrenchbed.benchmark.referee.catalogue import EFFECTS, STATED
from wrenchbed.benchmark.referee.fault import total
from wrenchbed.data.checked import load
from wrenchbed.data.parquet import FORMAT
from wrenchbed.errors import BenchmarkError

MOST = 5
"""Members of a class that may be named; a larger one is unknown (contract)."""


@dataclass(frozen=True)
class Fact:
    """One true cause.

    Attributes:
        effect: the contract's name, or of an outside case the family's.
        size: in multiples of typical, None on a real robot.
        gap: that it adds; between rows the mean rise of a row's variance; None on a real robot.
        rows: largest rise of a channel's row variance, 0 where means show it.
        true: its numbers as a diagnosis publishes them, SI, with what minor imperfections add.
        alike: effects that this very data cannot tell from it.
    """

    effect: str
    size: float | None
    gap: float | None
    rows: float
    true: Mapping[str, float]
    alike: tuple[str, ...]


@dataclass(frozen=True)
class Oracle:
    """What one says that is told the form and size of all that may be there.

    Attributes:
        verdict: as the contract's.
        causes: its classes.
        closed: share of the gap that the true effects close.
    """

    verdict: str
    causes: tuple[tuple[str, ...], ...]
    closed: float | None


@dataclass(frozen=True)
class Answer:
    """The truth of a case; its salt makes the hash of the file impossible to guess.

    Of a real robot nobody knows the minor imperfections, and no oracle can be asked. ``real_gap``
    is the calibrated gap of the recording that the cause was added to, None of other cases.
    """

    case: str
    robot: str
    mode: str
    kind: str
    causes: tuple[Fact, ...]
    minor: float | None
    rows: int
    oracle: Oracle | None
    salt: str
    format: int = FORMAT
    real_gap: float | None = None

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects of the library that are there."""
        return () if self.kind == "outside" else tuple(c.effect for c in self.causes)

    def to_bytes(self) -> bytes:
        """The file; what is committed to is its SHA-256."""
        raw = asdict(self)
        if self.real_gap is None:
            del raw["real_gap"]
        return (json.dumps(raw, indent=1, ensure_ascii=False) + "\n").encode()


def read(path: Path) -> Answer:
    """An answer from its file.

    Raises:
        BenchmarkError: it is not one.
    """
    try:
        raw: dict[str, Any] = load(path, BenchmarkError)
        if raw["format"] != FORMAT:
            raise BenchmarkError(f"{path}: format {raw['format']!r}, this version reads {FORMAT}")
        causes = [Fact(**{**c, "alike": tuple(c["alike"])}) for c in raw["causes"]]
        told = raw["oracle"]
        oracle = told and Oracle(
            told["verdict"], tuple(tuple(c) for c in told["causes"]), told["closed"]
        )
        return Answer(**{**raw, "causes": tuple(causes), "oracle": oracle})
    except (ValueError, KeyError, TypeError) as cause:
        raise BenchmarkError(f"{path}: is not a sealed answer: {cause}") from cause


def of_case(case: RefereeCase, name: str, salt: str) -> Answer:
    """The answer of a case."""
    meta = case.setting.metadata
    return Answer(
        case=name,
        robot=meta.robot,
        mode=meta.mode,
        kind=case.kind,
        causes=tuple(_true(case, c) for c in case.causes),
        minor=case.minor,
        rows=len(case.measured) * (1 if meta.mode == "dynamic" else _per_pose(case)),
        oracle=_oracle(case),
        salt=salt,
    )


def _per_pose(case: RefereeCase) -> int:
    return len(case.recording) // len(case.measured)


def _true(case: RefereeCase, cause: TrueCause) -> Fact:
    fault = cause.fault
    sums = total(case.faults, fault.name)
    effect = EFFECTS.get(fault.name)
    numbers = sums if effect is None or effect.adds else fault.true
    if fault.name in STATED[1:]:
        numbers = _with_own_weight(case, sums)
    alike: list[str] = []
    if case.kind != "outside" and not cause.rows:
        alike = case.bench.alike(fault.name, cause.signature)
    true = {k: float(v) for k, v in numbers.items()}
    return Fact(fault.name, fault.size, cause.gap, cause.rows, true, tuple(alike))


def _with_own_weight(case: RefereeCase, sums: Mapping[str, float]) -> dict[str, float]:
    """What gauges load by the sensor's own weight looks like mass at the sensor's origin."""
    weight = total(case.faults, "tool.self_weight").get("mass", 0.0)
    tool = case.setting.metadata.tool
    assert tool.mass is not None and tool.cog is not None
    if "mass" in sums:
        return {"mass": sums["mass"] + weight}
    shift = dict(zip("xyz", tool.cog, strict=True))
    return {k: v - weight / tool.mass * shift[k[-1]] for k, v in sums.items()}


def _oracle(case: RefereeCase) -> Oracle:
    """It names what it was told, once the data holds it, and whatever could not be told from it."""
    if not case.causes:
        return Oracle("none", (), None)
    means = [c for c in case.causes if not c.rows]
    seen: list[tuple[str, ...]] = []
    for cause in case.causes:
        name, configured = cause.fault.name, cause.fault.name in STATED
        others: np.ndarray = sum((c.signature for c in means if c is not cause), np.zeros(1))
        if cause.rows:
            seen.append((name,))
        elif case.bench.shows(case.measured - others, cause.signature, configured):
            known = case.kind != "outside"
            seen.append((name, *(case.bench.alike(name, cause.signature) if known else ())))
    closed = _closed(case, means, case.causes[0].world.row_noise)
    if not seen:
        return Oracle("none", (), closed)
    if case.kind == "outside" or any(len(c) > MOST for c in seen):
        return Oracle("unknown", (), closed)
    certain = all(len(c) == 1 for c in seen)
    return Oracle("identified" if certain else "ambiguous", tuple(seen), closed)


def _closed(case: RefereeCase, causes: Sequence[TrueCause], noise: float) -> float | None:
    """Share of the gap that vanishes with the exact signatures of the true causes."""
    if not causes:
        return None
    configured = all(c.fault.name in STATED for c in causes)
    usual = case.bench.usual
    start = usual.gap(case.measured, configured) - noise
    known: np.ndarray = sum((c.signature for c in causes), np.zeros(1))
    after = usual.gap(case.measured - known, configured) - noise
    return (start - after) / start if start > 0 else None
