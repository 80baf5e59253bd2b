"""Streamed targets that wait for their time, so that each reaches the robot in a cycle of its own.

The driver sends targets ahead, since its loop comes late now and then; the control worker, which
does little else, passes each on when it is due. Where targets are as far apart as states, their
times are shifted slowly until they lie between two states: two clocks that drift apart would else
put two targets into one cycle of the robot, and none into the next.
"""

import math
from collections import deque

_MOST = 256
_GAIN, _PHASE = 0.02, 0.4
"""Share of the error that a target corrects, and of the period after a state where targets go."""
_ALIKE = 0.01


class Stream:
    """Targets that wait.

    Args:
        period: between two states [s].
    """

    def __init__(self, period: float) -> None:
        self._period = period
        self._waiting: deque[tuple[float, list[float]]] = deque(maxlen=_MOST)
        self._last, self._locked, self._shift = -math.inf, False, 0.0

    @property
    def due(self) -> float:
        """When the next target is due (`time.monotonic`, [s]); never, if none waits."""
        return self._waiting[0][0] + self._shift if self._waiting else math.inf

    def add(self, q: list[float], at: float) -> None:
        """Take in a target (6,) for a time (`time.monotonic`, [s])."""
        apart = at - self._last
        self._locked = abs(apart - self._period) < _ALIKE * self._period
        self._last = at
        self._waiting.append((at, q))

    def clear(self) -> None:
        """Forget what waits."""
        self._waiting.clear()

    def take(self, now: float, state: float) -> list[float] | None:
        """The newest target that is due, None if none is.

        Args:
            now: `time.monotonic` [s].
            state: likewise, when the robot's newest state arrived.
        """
        q = None
        while self.due <= now:
            q = self._waiting.popleft()[1]
        if q is not None and self._locked:
            self._follow((now - state) % self._period)
        return q

    def _follow(self, phase: float) -> None:
        period = self._period
        error = (_PHASE * period - phase + 0.5 * period) % period - 0.5 * period
        self._shift += _GAIN * error
        if abs(self._shift) > 0.5 * period:
            self._shift -= math.copysign(period, self._shift)
