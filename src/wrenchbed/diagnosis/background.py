"""The ladder of background levels: how much many small imperfections add to a gap together."""

from dataclasses import dataclass

import numpy as np

from wrenchbed.diagnosis.dictionary import Dictionary
from wrenchbed.diagnosis.evidence import LARGE, Level

LADDER = (0.02, 0.08, 0.3, 1.2, 5.0, 20.0)
"""Gap that the background adds in all. Up to `NORMAL` every robot has it; more is a gap of its
own, or the price of an effect's form that the library has only nearly."""
NORMAL = 0.5
SHARES = {"effects": 0.45, "kernels": 0.3, "rows": 0.25}
MOST = 0.2
"""An imperfection is at most so large beside its effect's typical size."""
CORRELATION_S = 0.4
"""In a motion what the model lacks is alike for so long [s]."""
WITHIN = 1.0
"""Standard deviation of a stated number over its tolerance."""


@dataclass(frozen=True, eq=False)
class Background:
    """One rung: its gap and the covariance that goes with it."""

    gap: float
    level: Level

    @property
    def normal(self) -> bool:
        """Whether every robot may have so many imperfections."""
        return self.gap <= NORMAL


def ladder(d: Dictionary) -> tuple[Background, ...]:
    """All rungs for a dictionary."""
    return tuple(Background(g, _level(d, g)) for g in LADDER)


def _level(d: Dictionary, gap: float) -> Level:
    variance = np.zeros(len(d.label))
    named = sorted({e for e, p in d.label if p} - {d.label[k][0] for k in d.stated})
    for effect in named:
        columns = d.of_effect(effect)
        share = SHARES["effects"] * gap / (len(named) * len(columns))
        variance[columns] = np.minimum(
            MOST**2, share / np.maximum(d.configured_gap[columns], 1e-12)
        )
    for columns in d.kernels.values():
        variance[columns] = SHARES["kernels"] * gap / len(d.kernels)
    allowed = np.minimum((WITHIN * d.tolerance) ** 2, LARGE)
    variance[d.stated] = allowed
    rows = SHARES["rows"] * gap
    if d.prepared.moving:
        period = d.prepared.scene.period * d.prepared.stride
        rows *= max(1.0, CORRELATION_S / period)
    v0 = np.tile(d.prepared.variance + rows, d.rows)
    return Level(d.E, v0, variance, d.grams)
