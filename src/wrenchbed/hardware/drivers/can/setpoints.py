"""Setpoints of each cycle: holds, minimum-jerk moves, streams with and without times, and braking.

A path is followed by the count of cycles, not by time: a late cycle does not make the next one
jump. No joint goes further in a cycle than its top speed allows, or beyond its limits; a joint
outside its limits stays where it is until it is commanded to come inside.
"""

import threading
from collections.abc import Callable

import numpy as np

from wrenchbed.hardware.drivers.can.timed_targets import TimedTargets
from wrenchbed.robots.motion_limits import minimum_jerk

BRAKE_S = 0.15
"""Time in which a motion is braked to rest [s]; estimate."""
OUTSIDE = 1e-3
"""How far beyond a limit a resting joint still counts as inside [rad or m]; estimate."""
_STREAM_S = 0.1
"""Longest duration of the path to a streamed target, that of a late one [s]; estimate."""
_MARGIN = 1.1
"""Factor on top speed in a single cycle; estimate."""
Path = Callable[[float], np.ndarray]
"""Joint values (J,) some time [s] after the path began."""


class Setpoints:
    """Safe to use from several threads.

    Args:
        period: of the cycles [s].
        lower: joint limits (J,).
        upper: likewise.
        speed: top speed of each joint (J,).
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
        self._streamed = 0.0
        self._timed: TimedTargets | None = None

    @property
    def command(self) -> np.ndarray:
        """Joint values (J,) of the last cycle."""
        return self._command

    @property
    def moving(self) -> bool:
        """Whether a motion is under way."""
        return self._path is not None

    def outside(self, q: np.ndarray) -> tuple[int, float, float] | None:
        """The first joint beyond its limits at q (J,), and those limits."""
        beyond = (q < self._lower - OUTSIDE) | (q > self._upper + OUTSIDE) | ~np.isfinite(q)
        for joint in np.flatnonzero(beyond)[:1]:
            return int(joint), float(self._lower[joint]), float(self._upper[joint])
        return None

    def hold(self, q: np.ndarray) -> None:
        """Stay where the robot is (J,)."""
        with self._lock:
            self._command, self._speed = np.array(q), np.zeros(len(q))
            self._path = self._timed = None
            self._braking = False

    def move(self, goal: np.ndarray, seconds: float) -> None:
        """Go to rest at a goal (J,)."""
        with self._lock:
            start = self._command
            self._start(
                lambda t: start + minimum_jerk(np.array(t / seconds)) * (goal - start), seconds
            )

    def stream(self, q: np.ndarray, t: float) -> None:
        """Be at q (J,) as long after now as the last target was before now; t is now [s]."""
        with self._lock:
            start, seconds = self._command, min(max(t - self._streamed, self._period), _STREAM_S)
            self._streamed = t
            self._start(lambda t: start + t / seconds * (q - start), seconds)

    def follow(self, q: np.ndarray, at: float, t: float) -> None:
        """Be at q (J,) at a time; t is now [s]. The first of a path may be late."""
        with self._lock:
            if self._timed is None or self._timed.rests:
                at = at if at > t else t + _STREAM_S
                timed = TimedTargets(self._command, self._speed, t)
                self._start(lambda _: timed.step(self._period), np.inf)
                self._timed = timed
            self._timed.add(q, at)

    def lose(self, seconds: float) -> None:
        """Cycles were lost [s]: targets with a time are late by that."""
        with self._lock:
            if self._timed is not None:
                self._timed.lose(seconds)

    @property
    def follows(self) -> bool:
        """Whether targets with a time are under way."""
        return self._timed is not None

    def brake(self) -> None:
        """Come to rest in `BRAKE_S`; a second call changes nothing."""
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
        """Joint values (J,) for the next cycle."""
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
