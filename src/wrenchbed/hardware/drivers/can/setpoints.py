"""Joint targets of each cycle: hold, minimum-jerk move, targets streamed with times, and braking.

A path is followed by the count of cycles, not by time: a late cycle does not make the next one
jump. No joint goes further in a cycle than its top speed allows, or beyond its limits; a joint
outside its limits stays where it is until it is commanded to come inside.

Between two timed targets the joints follow the cubic that has their values and, as speeds, the
slopes between their neighbours. So it does not matter when a target arrives, or between which
cycles. The path has its own clock. If targets fail to come the clock slows down, and the joints
come to rest on the path at the last target; after lost cycles the clock runs slightly faster until
it has caught up. A change here moves robots: run tests/hardware/test_can_setpoints.py.
"""

import math
import threading
from collections import deque
from collections.abc import Callable

import numpy as np

from wrenchbed.hardware.drivers.row_times import hermite
from wrenchbed.robots.checked_moves import minimum_jerk

BRAKE_S = 0.15
"""Time in which a motion is braked to rest [s]: at top speed, 6.7 times that speed per second."""
OUTSIDE = 1e-3
"""Distance beyond a limit at which a resting joint still counts as inside [rad or m]: positions of
joints that rest at their limit flicker by some counts."""
_MARGIN = 1.1
"""Factor on top speed in a single cycle: a path at top speed is a bit faster between cycles."""
_SLOW_S = 0.06
"""Time in which the path's clock stops from its usual rate [s]: joints at top speed then decelerate
by 16 times their top speed per second."""
_AT_ONCE_S = 0.01
"""Longest loss of cycles [s] after which the next target is as if none were lost: drives have gone
on along their lines for that long."""
_CATCH_UP_S, _HASTE = 0.5, 0.05
"""Time constant of catching up after lost cycles [s], and largest excess of the clock's rate."""
Path = Callable[[float], np.ndarray]
"""Joint values (J,) as a function of the time [s] since the path began."""


class TimedTargets:
    """A smooth path through targets that arrive before their times, sampled once a cycle. It starts
    at joint values q (J,) with a speed (J,), at the time ``now`` [s]."""

    def __init__(self, q: np.ndarray, speed: np.ndarray, now: float) -> None:
        self._clock, self._rate, self._lag, self._lost = now, 1.0, 0.0, 0.0
        self._begin, self._one, self._leaves = now, np.array(q), np.array(speed)
        self._end, self._two, self._arrives = now, self._one, self._leaves
        self._coming: deque[tuple[float, np.ndarray]] = deque()
        self.passed = 0.0
        """Time step of the last call of `step`, with lost cycles [s]."""

    def add(self, q: np.ndarray, at: float) -> None:
        """Append a target q (J,) for a time [s]; ignore it if not later than the last one."""
        if at > self._last:
            self._coming.append((at, np.array(q)))

    def lose(self, seconds: float) -> None:
        """Note ``seconds`` of lost cycles: the path catches up, at once if few, else slowly."""
        if seconds <= _AT_ONCE_S:
            self._lost += seconds
        else:
            self._lag += seconds

    @property
    def rests(self) -> bool:
        """Whether the path has reached its last target, where it rests."""
        return self._clock >= self._last

    def step(self, seconds: float) -> np.ndarray:
        """Advance the path by a time [s]; return the joint values (J,) to command at its end."""
        seconds, self._lost = seconds + self._lost, 0.0
        self.passed = seconds
        remaining = self._last - self._clock
        growth = seconds / _SLOW_S
        haste = min(max(self._lag / _CATCH_UP_S, 0.0), _HASTE)
        half = 0.5 * growth
        braking = math.sqrt(half**2 + 2.0 * remaining / _SLOW_S) - half
        self._rate = min(self._rate + growth, 1.0 + haste, braking)
        self._lag += seconds * (1.0 - self._rate)
        self._clock = min(self._clock + self._rate * seconds, self._last)
        while self._clock > self._end:  # the next cubic; without one after that it ends straight
            self._begin, self._one, self._leaves = self._end, self._two, self._arrives
            self._end, self._two = self._coming.popleft()
            after, beyond = self._coming[0] if self._coming else (self._end, self._two)
            self._arrives = (beyond - self._one) / (after - self._begin)
        return self._at(self._clock)

    @property
    def _last(self) -> float:
        return self._coming[-1][0] if self._coming else self._end

    def _at(self, t: float) -> np.ndarray:
        way = self._end - self._begin
        if way <= 0.0:
            return self._two
        ends, speeds = (self._one, self._two), (self._leaves, self._arrives)
        return hermite(ends, speeds, way, (t - self._begin) / way)[0]


class Setpoints:
    """Computes the joint values to command in each cycle; several threads may use it.

    Args:
        period: duration of a cycle [s].
        lower, upper: limits of the joints (J,) [m or rad].
        speed: top speeds of the joints (J,) [m/s or rad/s].
    """

    def __init__(
        self, period: float, lower: np.ndarray, upper: np.ndarray, speed: np.ndarray
    ) -> None:
        self._period = period
        self._lower, self._upper = lower, upper
        self._step = _MARGIN * speed * period
        self._lock = threading.Lock()
        self.clipped = 0
        self._command: np.ndarray = np.clip(np.zeros(len(speed)), lower, upper)
        self._speed = np.zeros(len(speed))
        self._path: Path | None = None
        self._braking = False
        self._length = self._elapsed = 0.0
        self._timed: TimedTargets | None = None

    @property
    def command(self) -> np.ndarray:
        """Joint values (J,) commanded in the last cycle."""
        return self._command

    @property
    def moving(self) -> bool:
        """Whether a move, a stream of targets or braking is under way."""
        return self._path is not None

    def outside(self, q: np.ndarray) -> tuple[int, float, float] | None:
        """Index and limits of the first joint beyond its limits at q (J,); None if all are in."""
        beyond = (q < self._lower - OUTSIDE) | (q > self._upper + OUTSIDE) | ~np.isfinite(q)
        for joint in np.flatnonzero(beyond)[:1]:
            return int(joint), float(self._lower[joint]), float(self._upper[joint])
        return None

    def hold(self, q: np.ndarray) -> None:
        """End any motion and command q (J,), the robot's present joint values, from now on."""
        with self._lock:
            self._command, self._speed = np.array(q), np.zeros(len(q))
            self._path = self._timed = None
            self._braking = False

    def move(self, goal: np.ndarray, seconds: float) -> None:
        """Begin a minimum-jerk move that comes to rest at ``goal`` (J,) after ``seconds``."""
        with self._lock:
            start = self._command
            self._start(
                lambda t: start + minimum_jerk(np.array(t / seconds)) * (goal - start), seconds
            )

    def follow(self, q: np.ndarray, at: float, t: float) -> None:
        """Add a streamed target: be at q (J,) at the time ``at`` [s]; ``t`` is now [s]."""
        with self._lock:
            if self._timed is None or self._timed.rests:
                timed = TimedTargets(self._command, self._speed, t)
                self._start(lambda _: timed.step(self._period), np.inf)
                self._timed = timed
            self._timed.add(q, at)

    def lose(self, seconds: float) -> None:
        """Note ``seconds`` of lost cycles, by which streamed targets have to catch up."""
        with self._lock:
            if self._timed is not None:
                self._timed.lose(seconds)

    def brake(self) -> None:
        """Begin to brake to rest within `BRAKE_S`; no effect while already braking."""
        with self._lock:
            if self._braking:
                return
            start, speed = self._command, self._speed
            if not np.abs(speed).any():
                self._path = self._timed = None
                return
            self._start(lambda t: start + speed * (t - t * t / (2.0 * BRAKE_S)), BRAKE_S)
            self._braking = True

    def step(self) -> np.ndarray:
        """Advance the motion by one cycle; return the joint values (J,) to command."""
        with self._lock:
            wanted = self._command
            if self._path is not None:
                self._elapsed += self._period
                wanted = self._path(min(self._elapsed, self._length))
            lower = np.minimum(self._lower, self._command)
            upper = np.maximum(self._upper, self._command)
            within = np.clip(wanted, lower, upper)
            near = np.clip(within, self._command - self._step, self._command + self._step)
            self.clipped += bool(np.abs(near - wanted).max() > 1e-9)
            passed = self._period if self._timed is None else self._timed.passed
            self._speed = (near - self._command) / passed
            ended = self._elapsed >= self._length if self._timed is None else self._timed.rests
            if ended and np.array_equal(near, within):
                self._path = self._timed = None
            self._command = near
            return near

    def _start(self, path: Path, seconds: float) -> None:
        self._path, self._length, self._elapsed, self._braking = path, seconds, 0.0, False
        self._timed = None
