"""What every cycle sends beside the targets: the sensor's poll and, where due, the heartbeat.

Drives that watch the master's heartbeat (0x1016) stop when it stays away.
"""

import time
from collections.abc import Callable

from wrenchbed.transducers.netcanoem.link import Link

_OPERATIONAL = bytes([0x05])


class Heartbeat:
    """Call it once a cycle.

    Args:
        link: the bus.
        node: id of the master.
        period: [s].
        poll: asks the sensor.
    """

    def __init__(self, link: Link, node: int, period: float, poll: Callable[[], None]) -> None:
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
