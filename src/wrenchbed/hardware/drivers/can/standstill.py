"""When the axes stand still: no voltage is taken off one that moves.

What every cycle sends beside the targets: the sensor's poll and, where due, the heartbeat.

Drives that watch the master's heartbeat (0x1016) stop when it stays away.
"""

import time
from collections.abc import Callable

import numpy as np

from wrenchbed.hardware.device import STALE_S
from wrenchbed.hardware.drivers.can.cycle import CycleCommands
from wrenchbed.hardware.transducers.netcanoem.link import CanLink

_OPERATIONAL = bytes([0x05])


class Heartbeat:
    """Call it once a cycle.

    Args:
        link: the bus.
        node: id of the master.
        period: [s].
        poll: asks the sensor.
    """

    def __init__(self, link: CanLink, node: int, period: float, poll: Callable[[], None]) -> None:
        self._link, self._id, self._period = link, 0x700 + node, period
        self._due, self._poll = 0.0, poll

    def __call__(self) -> None:
        """Ask, and send it where it is due.

        Raises:
            LinkError: the bus is gone.
        """
        self._poll()
        now = time.monotonic()
        if now >= self._due:
            self._due = max(self._due + self._period, now)
            self._link.send(self._id, _OPERATIONAL)


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

    def moving(self, told: CycleCommands | None) -> np.ndarray:
        """Which joints move (J,), as they told last."""
        return np.zeros(len(self._slow), bool) if told is None else np.abs(told.qd) > self._slow

    def reached(self, told: CycleCommands | None) -> bool:
        """Whether all stand still: they say so, or are silent for longer than they may move."""
        if told is None:
            return True
        age = time.monotonic() - told.t
        if age >= STALE_S:
            return age > self.longest
        return told.sequence >= _ENOUGH and not self.moving(told).any()
