"""What the drives are told each cycle: holds, minimum-jerk moves, streams, and braking.

The way is counted in cycles, not in time: a cycle that came late does not make the next one jump.
Whatever is asked, no joint goes further in a cycle than its top speed allows, or beyond its limits;
one that stands outside them stays where it is until it is told to come in.
"""

import threading
from collections.abc import Callable

import numpy as np

from wrenchbed.robots.motion_limits import minimum_jerk

BRAKE_S = 0.15
"""Time in which a motion is braked to rest [s]."""
OUTSIDE = 1e-3
"""How far beyond a limit a joint may come to rest and still count as inside [rad or m]."""
_STREAM_S = 0.1
_MARGIN = 1.1
Way = Callable[[float], np.ndarray]
"""Joint values (J,) some time [s] after the way began."""


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
        self._way: Way | None = None
        self._braking = False
        self._length = self._gone = 0.0
        self._streamed = 0.0

    @property
    def command(self) -> np.ndarray:
        """Joint values (J,) of the last cycle."""
        return self._command

    @property
    def moving(self) -> bool:
        """Whether a motion is under way."""
        return self._way is not None

    def outside(self, q: np.ndarray) -> tuple[int, float, float] | None:
        """The first joint that stands beyond its limits at q (J,), and those limits."""
        beyond = (q < self._lower - OUTSIDE) | (q > self._upper + OUTSIDE) | ~np.isfinite(q)
        for joint in np.flatnonzero(beyond)[:1]:
            return int(joint), float(self._lower[joint]), float(self._upper[joint])
        return None

    def hold(self, q: np.ndarray) -> None:
        """Stay where the robot is (J,)."""
        with self._lock:
            self._command, self._speed, self._way = np.array(q), np.zeros(len(q)), None
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

    def brake(self) -> None:
        """Come to rest in `BRAKE_S`; asked for again, it goes on as it began."""
        with self._lock:
            if self._braking:
                return
            start, speed = self._command, self._speed
            if not np.abs(speed).any():
                self._way = None
                return
            self._start(lambda t: start + speed * (t - t * t / (2.0 * BRAKE_S)), BRAKE_S)
            self._braking = True

    def step(self) -> np.ndarray:
        """Joint values (J,) for the next cycle."""
        with self._lock:
            wanted = self._command
            if self._way is not None:
                self._gone += self._period
                wanted = self._way(min(self._gone, self._length))
            lower = np.minimum(self._lower, self._command)
            upper = np.maximum(self._upper, self._command)
            within = np.clip(wanted, lower, upper)
            near = np.clip(within, self._command - self._step, self._command + self._step)
            self.clipped += bool(np.abs(near - wanted).max() > 1e-9)
            if self._gone >= self._length and np.array_equal(near, within):
                self._way = None
            self._speed = (near - self._command) / self._period
            self._command = near
            return near

    def _start(self, way: Way, seconds: float) -> None:
        self._way, self._length, self._gone, self._braking = way, seconds, 0.0, False
