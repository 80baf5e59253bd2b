"""A CAN bus as the checks see it: frames out, frames in, and a clock."""

import queue
import time
from typing import NamedTuple, Protocol

from wrenchbed.hardware.transducers.netcanoem.link import CanLink


class Received(NamedTuple):
    """A data frame that came: when [s], its id, its data."""

    t: float
    can_id: int
    data: bytes


class Port(Protocol):
    """A bus.

    Attributes:
        remote: whether it can send remote frames.
    """

    remote: bool

    def now(self) -> float:
        """The time [s]."""
        ...

    def send(self, can_id: int, data: bytes, remote: bool = False) -> None:
        """Send a frame."""
        ...

    def receive(self, seconds: float) -> Received | None:
        """The next frame, None where none comes within some time [s]."""
        ...


class LinkPort:
    """A bus of python-can.

    Args:
        link: open.
        remote: whether its interface carries remote frames.
    """

    def __init__(self, link: CanLink, remote: bool) -> None:
        self.remote = remote
        self._link = link
        self._frames: queue.Queue[Received] = queue.Queue()
        link.listen(lambda t, can_id, data: self._frames.put(Received(t, can_id, data)))

    def now(self) -> float:
        """The time of `time.monotonic` [s]."""
        return time.monotonic()

    def send(self, can_id: int, data: bytes, remote: bool = False) -> None:
        """Send a frame.

        Raises:
            LinkError: the bus is gone or takes nothing.
        """
        self._link.send(can_id, data, remote)

    def receive(self, seconds: float) -> Received | None:
        """The next frame, None where none comes within some time [s]."""
        try:
            return self._frames.get(timeout=max(0.0, seconds))
        except queue.Empty:
            return None
