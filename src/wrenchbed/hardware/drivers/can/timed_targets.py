"""A smooth path through targets that arrive before their times.

Between two targets joints follow the cubic that has their values and the speeds of the straight
lines between their neighbours, so when and between which cycles a target arrives does not matter.
The path has a clock of its own. Where targets fail to come it runs slower and comes to rest at the
last one, on the path; where cycles were lost it runs faster, a little, until nothing is missing.
"""

import math
from collections import deque

import numpy as np

_BRAKE_S = 0.06
"""Time in which the clock comes to rest from its usual rate [s]; estimate."""
_AT_ONCE_S = 0.01
"""Longest time of lost cycles after which the next target is where it would be without [s]:
drives go on along their lines for so long; estimate."""
_CATCH_UP_S, _HASTE = 0.5, 0.05
"""Time constant of making up for lost cycles [s], and largest excess of the clock's rate for it;
estimates."""


class TimedTargets:
    """Joint values (J,) cycle by cycle.

    Args:
        q: joint values where the path begins (J,).
        speed: likewise (J,).
        now: when [s].
    """

    def __init__(self, q: np.ndarray, speed: np.ndarray, now: float) -> None:
        self._clock, self._rate, self._lag, self._lost = now, 1.0, 0.0, 0.0
        self._begin, self._one, self._leaves = now, np.array(q), np.array(speed)
        self._end, self._two, self._arrives = now, self._one, self._leaves
        self._coming: deque[tuple[float, np.ndarray]] = deque()
        self.passed = 0.0
        """Time that the last step took [s]."""

    def add(self, q: np.ndarray, at: float) -> None:
        """Be at q (J,) at a time [s]; one that is not after the last one is left out."""
        if at > self._last:
            self._coming.append((at, np.array(q)))

    def lose(self, seconds: float) -> None:
        """Cycles were lost [s]: few are made up for by the next step, many slowly."""
        if seconds <= _AT_ONCE_S:
            self._lost += seconds
        else:
            self._lag += seconds

    @property
    def rests(self) -> bool:
        """Whether it is at rest at the last target."""
        return self._clock >= self._last

    def step(self, seconds: float) -> np.ndarray:
        """Where to be some time later [s] (J,)."""
        seconds, self._lost = seconds + self._lost, 0.0
        self.passed = seconds
        left = self._last - self._clock
        growth = seconds / _BRAKE_S
        haste = min(max(self._lag / _CATCH_UP_S, 0.0), _HASTE)
        half = 0.5 * growth
        braking = math.sqrt(half**2 + 2.0 * left / _BRAKE_S) - half
        self._rate = min(self._rate + growth, 1.0 + haste, braking)
        self._lag += seconds * (1.0 - self._rate)
        self._clock = min(self._clock + self._rate * seconds, self._last)
        while self._clock > self._end:
            self._enter()
        return self._at(self._clock)

    @property
    def _last(self) -> float:
        return self._coming[-1][0] if self._coming else self._end

    def _enter(self) -> None:
        """Begin the next part; what follows it is known, or it ends as a straight line."""
        self._begin, self._one, self._leaves = self._end, self._two, self._arrives
        self._end, self._two = self._coming.popleft()
        after, beyond = self._coming[0] if self._coming else (self._end, self._two)
        self._arrives = (beyond - self._one) / (after - self._begin)

    def _at(self, t: float) -> np.ndarray:
        way = self._end - self._begin
        if way <= 0.0:
            return self._two
        share = (t - self._begin) / way
        return np.asarray(
            (1.0 + 2.0 * share) * (1.0 - share) ** 2 * self._one
            + share**2 * (3.0 - 2.0 * share) * self._two
            + way * share * (1.0 - share) ** 2 * self._leaves
            - way * share**2 * (1.0 - share) * self._arrives
        )
