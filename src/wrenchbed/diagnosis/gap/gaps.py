"""Gaps of simulators on rows that no fit saw, each with its interval."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Interval:
    """An estimate with its 95 % interval, from blocks drawn anew."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Closure:
    """Gaps on held-out rows (`docs/nomenclature.md`: 0 when only noise is left).

    Attributes:
        configured, floor: of the simulator as stated, and of noise alone.
        calibrated: after bias, mass and CoG.
        with_effects: with the claimed effects too.
        closed: share of the gap that the effects close.
        black_box: share that a flexible model of the residual closes.
        rows: held-out rows.
        folds: parts of the recording, each of which was held out once.
        per_channel: gap per channel before and after.
        members: gap that each cause closes in all channels, by name: what comes back without it.
        in_sample: gap with the claimed effects on rows that the fit did see.
        readings: (M, 6) of the scene's rows by simulator: ``calibrated``, ``with_effects``.
        in_all: share of the gaps of all channels together that the effects close.
        further: gap of further channels than the first that each cause closes, by name.
    """

    configured: float
    calibrated: Interval
    with_effects: Interval | None
    floor: float
    closed: Interval | None
    black_box: float | None
    rows: int
    folds: int
    per_channel: Mapping[str, Mapping[str, float]]
    members: Mapping[str, Interval]
    in_sample: float | None
    readings: Mapping[str, np.ndarray]
    in_all: Interval | None = None
    further: Mapping[str, Interval] = field(default_factory=dict)

    @property
    def excess(self) -> float:
        """Calibrated gap beyond the noise floor."""
        return self.calibrated.value - max(self.floor, 0.0)

    @property
    def channels(self) -> float:
        """Calibrated gap where noise of a channel is taken to be its own, mean of all."""
        return float(np.mean([c["before"] for c in self.per_channel.values()]))

    @property
    def shares(self) -> dict[str, float]:
        """The closed share among the causes, by how much of the gap comes back without each.

        Each lies within 0 … 1: noise may let a twin end below the floor, or add to the gap.
        """
        back = {k: max(m.value, 0.0) for k, m in self.members.items()}
        total, closed = sum(back.values()), 0.0 if self.closed is None else self.closed.value
        closed = min(1.0, max(0.0, closed))
        return {k: closed * v / total if total > 0 else 0.0 for k, v in back.items()}
