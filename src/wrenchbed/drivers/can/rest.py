"""When the axes stand still: no voltage is taken off one that moves."""

import time

import numpy as np

from wrenchbed.drivers.can.cycle import Told
from wrenchbed.health import STALE_S

REST_S = 0.5
"""Longest that a quick stop takes from top speed [s]."""
_SHARE = 0.02
"""Of top speed: what is slower stands still."""
_ENOUGH = 6
"""Answers that make a speed."""
_COUNTS = 0.3
"""Apparent speed of an axis at rest whose encoder flickers [count a cycle]."""


class Rest:
    """Judges by what the drives told last.

    Args:
        speed: top speed of each joint (J,).
        counts: per unit of each joint (J,).
        period: of the cycles [s].
        watchdog: silence after which drives stop by themselves [s].
    """

    def __init__(
        self, speed: np.ndarray, counts: np.ndarray, period: float, watchdog: float
    ) -> None:
        self._slow = _SHARE * speed + _COUNTS / (np.abs(counts) * period)
        self.longest = watchdog + REST_S
        """Silence [s] after which every drive has stopped by its watchdog."""

    def moving(self, told: Told | None) -> np.ndarray:
        """Which joints move (J,), as they told last."""
        return np.zeros(len(self._slow), bool) if told is None else np.abs(told.qd) > self._slow

    def reached(self, told: Told | None) -> bool:
        """Whether all stand still: they say so, or are silent for longer than they may move."""
        if told is None:
            return True
        age = time.monotonic() - told.t
        if age >= STALE_S:
            return age > self.longest
        return told.sequence >= _ENOUGH and not self.moving(told).any()
