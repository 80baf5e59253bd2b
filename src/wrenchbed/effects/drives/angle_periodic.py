"""Effects periodic in a joint's angle: two harmonics of a period are fitted (cogging, ripple)."""

from abc import abstractmethod
from typing import ClassVar

import numpy as np

from wrenchbed.effects.drives.base import Block, Column, DriveEffect, DriveResidual, DriveRows

HARMONICS = (1, 2)
"""Waves within a period: teeth or poles make more than a sine, of which the second shows."""
SLOWEST, FASTEST = 1.5, 400.0
"""Periods a turn of the joint that are tried: up to motors of 3 to 10 pole pairs behind gears of 30
to 160."""
GEAR_MOST = 12.0
"""Periods a turn up to which the joint's own gear makes them, beyond it the motor: the slowest
motor turns 30 times."""
_FINE = 4.0
"""Steps of the search within the width of a peak: the nearest one has 95 % of its power."""
_STEP = 0.25
"""Step between the slow spatial frequencies that are tried [periods per turn]: joints turn less
than once, so peaks are wider."""
_BINS = 8.0
"""Bins of the angle within the shortest period: averaging over one keeps 97 % of it."""


def first_of(effect: str) -> tuple[str, ...]:
    """Name prefixes of an effect's sine and cosine columns at harmonic 1, which give its size."""
    return f"{effect}.sine1", f"{effect}.cosine1"


class Wave(DriveEffect):
    """Effect periodic in the joint's angle; its `Block.value` is the number of periods per turn."""

    tried: ClassVar[float]
    """Range of periods per turn that is searched, which sets the prior of each."""

    @abstractmethod
    def periods(self, residual: DriveResidual) -> float:
        """Search the number of periods a joint turn whose wave is strongest in a residual."""

    def scan(self, rows: DriveRows, residual: DriveResidual) -> tuple[tuple[Column, ...], Block]:
        turns = self.periods(residual)
        columns = tuple(
            rows.column(f"{self.name}.{word}{k}", wave(k * turns * rows.angle))
            for k in HARMONICS
            for word, wave in (("sine", np.sin), ("cosine", np.cos))
        )
        names = tuple(c.name for c in columns)
        return columns, self.cause(rows, names, turns, -float(np.log(self.tried)))


def strongest(residual: np.ndarray, angle: np.ndarray) -> float:
    """Periods per turn above `GEAR_MOST` of most power in a residual (M,) over angle (M,) [rad].

    Sums over rows become a transform over bins of the angle: rows of a bin have nearly one phase.
    """
    turns = max(float(np.ptp(angle)) / (2.0 * np.pi), 1e-6)
    tried = np.arange(GEAR_MOST, FASTEST, min(1.0 / (_FINE * turns), 1.0))
    bins = int(_BINS * FASTEST * turns) + 2
    share = (angle - angle.min()) / max(float(np.ptp(angle)), 1e-12)
    at = np.clip((bins * share).astype(int), 0, bins - 1)
    total = np.bincount(at, residual - residual.mean(), bins)
    middle = angle.min() + (np.arange(bins) + 0.5) / bins * np.ptp(angle)
    power = np.abs(np.exp(1j * np.outer(tried, middle)) @ total)
    return float(tried[int(power.argmax())])


def fitting(y: np.ndarray, basis: np.ndarray, angle: np.ndarray) -> float:
    """Periods per turn, up to `GEAR_MOST`, of the wave over an angle (M,) [rad] that best fits a
    torque (M,) ``y`` beside an orthonormal basis (M, K) of other columns."""
    residual, best, period = y - basis @ (basis.T @ y), -1.0, SLOWEST
    for turn in np.arange(SLOWEST, GEAR_MOST, _STEP):
        phase = turn * angle
        waves = np.column_stack([np.sin(phase), np.cos(phase)])
        waves = waves - basis @ (basis.T @ waves)
        taken = (
            residual @ waves @ np.linalg.lstsq(waves.T @ waves, waves.T @ residual, rcond=None)[0]
        )
        if taken > best:
            best, period = float(taken), float(turn)
    return period
