"""Lifecycle and health of a connected device: a robot's driver or a sensor's electronics."""

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from ipaddress import ip_address
from socket import gethostbyname
from typing import ClassVar, Literal, Self

from wrenchbed.errors import DriverError

State = Literal["closed", "starting", "ok", "stale", "lost", "stopped", "fault"]
"""``stale``: no fresh reading for `STALE_S`; ``lost``: the link or its worker is gone;
``stopped``: the device is at rest by a stop of its own (protective, emergency, program ended);
``fault``: the device answers and reports an error that someone must clear."""

STALE_S = 0.08
"""Age of the newest reading from which a link is stale [s]: ten states of a 125 Hz controller."""
GONE_S = 1.0
"""Age of the newest reading from which a link is lost [s]: no short stall of a network or
machine."""


@dataclass(frozen=True)
class Health:
    """State of a device.

    Attributes:
        state: one of `State`.
        detail: one sentence for people; empty when all is well.
        counters: readings, losses, restarts, by name.
    """

    state: State
    detail: str = ""
    counters: Mapping[str, float] = field(default_factory=dict)

    @property
    def ok(self) -> bool:
        """Whether the device may be used."""
        return self.state == "ok"


def by_age(age: float, what: str, counters: Mapping[str, float]) -> Health:
    """Health of a link from the age [s] of its newest reading; ``what`` names the link."""
    if age < STALE_S:
        return Health("ok", "", counters)
    state: State = "stale" if age < GONE_S else "lost"
    return Health(state, f"{what}: no fresh reading for {age:.2f} s", counters)


def wait_until(done: Callable[[], bool], seconds: float, pause: float = 0.005) -> bool:
    """Wait until a condition holds, looking every ``pause`` [s]; False at the deadline [s]."""
    end = time.monotonic() + seconds
    while not done():
        if time.monotonic() > end:
            return False
        time.sleep(pause)
    return True


def only_here(host: str) -> bool:
    """Whether an address is this machine's own, where only emulators serve."""
    try:
        return ip_address(gethostbyname(host)).is_loopback
    except (OSError, UnicodeError, ValueError):
        return False


class Device(ABC):
    """Something that is connected, used and closed. Use as a context manager."""

    name: ClassVar[str]
    title: ClassVar[str]
    options: ClassVar[type]
    """A dataclass of what the constructor takes."""

    def __init__(self) -> None:
        self._connected = False

    def connect(self) -> None:
        """Open the device and wait for its first reading; nothing moves.

        Raises:
            LinkError: it cannot be reached, or does not answer within its deadline.
            DriverError: its answer cannot be used.
        """
        if not self._connected:
            try:
                self._connect()
            except BaseException:
                self._close()
                raise
            self._connected = True

    def close(self) -> None:
        """Release the device; may be called twice."""
        if self._connected:
            self._connected = False
            self._close()

    def health(self) -> Health:
        """The state, and what is wrong, if anything."""
        return self._health() if self._connected else Health("closed", "call connect() first")

    @abstractmethod
    def _connect(self) -> None: ...

    @abstractmethod
    def _close(self) -> None:
        """Release what is open; the device may be half open."""

    @abstractmethod
    def _health(self) -> Health: ...

    def _check_connected(self) -> None:
        if not self._connected:
            raise DriverError(f"{self.name!r} is not connected: call connect() first")

    def __enter__(self) -> Self:
        self.connect()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
