"""Commanded positions of an axis: set-points with a speed, and the path through cyclic targets.

SYNCs arrive with jitter: a phase-locked loop makes an even clock of them. Where a SYNC of a running
stream is late or missing, the axis goes on at the stream's speed for at most `_MISSED` periods.
"""

import math
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

_NEAR = 1.0
"""Distance [count] from which a position counts as reached by the set-point."""
_GAIN = 0.01
"""Fraction of the phase error that each SYNC corrects; a larger one lets more jitter through."""
_MISSED = 2
"""Most SYNCs in a row that may be missing: the axis goes on along its line for as many periods."""
_LATEST = 0.9
"""Lateness [periods] up to which a SYNC counts as late; from here on one before it is missing."""
_LOCKED = 0.5
"""How much too early a SYNC may come [periods]; an earlier one shows that the last one was late."""
_LINES = 4
"""Number of recent lines that are stored: the control loop may run some cycles late."""


@dataclass
class SetPoint:
    """Commanded position [count] and speed [count/s] of an axis."""

    position: float
    speed: float = 0.0

    def to_speed(self, wanted: float, up: float, down: float, seconds: float) -> None:
        """Change the speed towards ``wanted`` [count/s] for a time ``seconds`` [s], at ``up``
        (faster) or ``down`` (slower) [count/s²] at most, and move the position by it."""
        faster = wanted * self.speed >= 0.0 and abs(wanted) > abs(self.speed)
        most = (up if faster else down) * seconds
        self.speed += min(max(wanted - self.speed, -most), most)
        self.position += self.speed * seconds

    def to_position(
        self, goal: float, top: float, up: float, down: float, seconds: float
    ) -> bool:  # fmt: skip
        """Move towards ``goal`` [count] for ``seconds``; return whether it is reached. ``top``
        limits the speed [count/s], ``up`` and ``down`` limit acceleration and braking
        [count/s²]."""
        way = goal - self.position
        slow = abs(self.speed) <= 3.0 * down * seconds
        if slow and abs(way) <= max(abs(self.speed) * seconds, _NEAR):
            self.position, self.speed = goal, 0.0
            return True
        wanted = math.copysign(min(top, math.sqrt(2.0 * down * abs(way))), way)
        self.to_speed(wanted, up, down, seconds)
        return False


class Line(NamedTuple):
    """Straight motion of a set-point from one target to the next: begins at time ``begin`` [s],
    leads from ``start`` to ``end`` [count] in ``period`` [s], then goes on by ``step`` [count] a
    period, the change between targets (``end`` − ``start`` also has the axis's correction)."""

    begin: float
    start: float
    end: float
    period: float
    step: float


class Interpolation:
    """Path of one axis through the targets of cyclic synchronous position mode (CiA 402)."""

    def __init__(self) -> None:
        self._lines: deque[Line] = deque(maxlen=_LINES)

    def clear(self) -> None:
        self._lines.clear()

    def take(self, t: float, command: float, target: float, period: float) -> None:
        """Add a target [count] that came with the SYNC at time t [s], to be reached within
        ``period`` [s]; ``command`` is the present set-point [count]."""
        line = Line(t, command, target, period, step=0.0)
        if self._lines and period == self._lines[-1].period > 0.0:
            last = self._lines[-1]
            error = (t - last.begin) / period - 1.0
            missed = max(0, math.ceil(error - _LATEST)) if error > -_LOCKED else -1
            if missed <= _MISSED and error > -1.0 - _LOCKED:
                begin = last.begin + (1 + missed) * period
                start = last.start if missed < 0 else self.at(begin) if missed else last.end
                step = (target - last.end) / max(1 + missed, 1)
                line = Line(begin + _GAIN * (t - begin), start, target, period, step)
        self._lines.append(line)

    @property
    def known(self) -> bool:
        return bool(self._lines)

    def at(self, t: float) -> float:
        """Return the commanded position [count] of the axis at time t [s]."""
        begin, start, end, period, step = next(
            (line for line in reversed(self._lines) if line.begin <= t), self._lines[0]
        )
        passed = max(0.0, (t - begin) / period) if period > 0.0 else 1.0
        beyond = min(max(passed - 1.0, 0.0), _MISSED)
        return start + min(passed, 1.0) * (end - start) + beyond * step
