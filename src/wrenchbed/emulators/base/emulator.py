"""What a twin is: a server that unmodified client libraries take for the device.

A twin runs in a process of its own (`wrenchbed twin`): client libraries may hold Python's lock
while they wait for it.

Real time for a twin's cycle: deadlines on an absolute grid, real-time scheduling on request.
"""

import ipaddress
import os
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import TracebackType
from typing import ClassVar, Self

from wrenchbed.emulators.base.faults import Faults
from wrenchbed.errors import ParameterError


@dataclass(frozen=True)
class EmulatorOptions:
    """What every twin is told.

    Attributes:
        host: address of this machine to serve at, 127.0.0.1 … 127.255.255.254.
        parameters: true values where they differ from nominal, by name, SI.
        noise: ``real``, ``white`` or ``off``.
        seed: of the noise and of the effects' random parts.
        effects: as ``joint.compliance:joint=2,stiffness=1.4e4``; without values of typical size.
        table: height of a plate that the tool may press on [m].
        setting: what this twin alone knows, by name.
    """

    host: str = "127.0.0.1"
    parameters: Mapping[str, float] = field(default_factory=dict)
    noise: str = "real"
    seed: int = 0
    effects: tuple[str, ...] = ()
    table: float | None = None
    setting: Mapping[str, str] = field(default_factory=dict)


class TwinServer(ABC):
    """A device's protocols, served on this machine and to nobody else.

    Raises:
        ParameterError: the host is not one of 127.0.0.0/8, or an option is impossible.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    settings: ClassVar[Mapping[str, str]]
    """Name of each setting of its own → what it does and its default."""

    def __init__(self, options: EmulatorOptions) -> None:
        _check_local(options.host)
        self.options = options
        self.faults = Faults()
        self.failed = threading.Event()
        self.failure: BaseException | None = None

    def fail(self, error: BaseException) -> None:
        """Tell, from any thread, that this twin serves no more and why."""
        self.failure = self.failure or error
        self.failed.set()

    @abstractmethod
    def start(self) -> dict[str, str]:
        """Serve from now on; the address of each link by its name, for instance ``host:port``.

        Raises:
            DriverError: a port is taken or not allowed; names it and the remedy.
        """

    @abstractmethod
    def stop(self) -> None:
        """Close all links; may be called twice."""

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.stop()


def _check_local(host: str) -> None:
    try:
        local = ipaddress.IPv4Address(host).is_loopback
    except ValueError:
        local = False
    if not local:
        raise ParameterError(
            f"--host {host}: a twin serves this machine only: give 127.0.0.1 … 127.255.255.254"
        )


GIVE_UP_S = 1.0
"""Lag beyond which lost cycles are not made up for [s]."""


class CycleClock:
    """Deadlines every ``period`` seconds of `time.monotonic`, without drift.

    A loop that is late gets the deadlines that it missed at once, one after the other, until it
    has caught up; after more than `GIVE_UP_S` the rest is forgotten and counted in `lost`.
    """

    def __init__(self, period: float) -> None:
        self.period = period
        self.lost = 0.0
        self._start = time.monotonic()
        self._cycles = 0

    @property
    def due(self) -> float:
        """Deadline of the next cycle [s]."""
        return self._start + (self._cycles + 1) * self.period

    @property
    def remaining(self) -> float:
        """Time until the next deadline [s], 0 where it has passed."""
        return max(0.0, self.due - time.monotonic())

    def advance(self) -> int:
        """Count one cycle as done; how many more deadlines have passed already."""
        self._cycles += 1
        behind = time.monotonic() - self._start - self._cycles * self.period
        if behind > GIVE_UP_S:
            self._start += behind
            self.lost += behind
            return 0
        return max(0, int(behind / self.period))


def take_priority(priority: int = 50) -> bool:
    """Give the calling thread the real-time policy SCHED_FIFO; whether the system allowed it."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except (OSError, AttributeError):
        return False
    return True
