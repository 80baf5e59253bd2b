"""What an emulator is: a server that unmodified client libraries take for the device.

It runs in a process of its own (`wrenchbed twin`), because client libraries may hold Python's lock
while they wait for it. `serve` starts one by name, with timed faults.
"""

import ipaddress
import threading
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import ClassVar, Self

from robot_emulators.base import faults as timed
from robot_emulators.base.body import BodyOptions
from robot_emulators.base.faults import Faults
from robot_emulators.base.real_time import objects_kept
from wrenchbed import registry
from wrenchbed.errors import DriverError, ParameterError
from wrenchbed.robots.base import SimulatedRobot


@dataclass(frozen=True)
class EmulatorOptions:
    """Options that every emulator takes.

    Attributes:
        host: address of this machine to serve at, 127.0.0.1 … 127.255.255.254.
        parameters: true values where they differ from nominal, by name, SI.
        noise: ``real``, ``white`` or ``off``.
        seed: of the noise and of the effects' random parts.
        effects: as ``joint.compliance:joint=2,stiffness=1.4e4``; without values of typical size.
        table: height of a plate that the tool may press on [m].
        setting: of this kind of emulator, name → text.
    """

    host: str = "127.0.0.1"
    parameters: Mapping[str, float] = field(default_factory=dict)
    noise: str = "real"
    seed: int = 0
    effects: tuple[str, ...] = ()
    table: float | None = None
    setting: Mapping[str, str] = field(default_factory=dict)

    def body(self, robot: str | SimulatedRobot) -> BodyOptions:
        """The robot behind the emulator."""
        return BodyOptions(robot, self.parameters, self.noise, self.seed, self.effects, self.table)


class Emulator(ABC):
    """A device's protocols, served on this machine and to nobody else.

    Raises:
        ParameterError: the host is not one of 127.0.0.0/8, or an option is impossible.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    settings: ClassVar[Mapping[str, str]]
    """Name of each setting → what it does and its default."""

    def __init__(self, options: EmulatorOptions) -> None:
        _check_local(options.host)
        self.options = options
        self.faults = Faults()
        self.addresses: dict[str, str] = {}
        self.failed = threading.Event()
        self.failure: BaseException | None = None
        self._used = False

    def start(self) -> dict[str, str]:
        """Serve from now on; the address of each link by its name, for instance ``host:port``.

        Raises:
            DriverError: a port is taken or not allowed; names it and the remedy. Or this emulator
                was started before.
        """
        if self._used:
            raise DriverError("this emulator was started before: make a new one")
        self._used = True
        try:
            return self.serve()
        except BaseException:
            self.stop()
            raise

    def fail(self, error: BaseException) -> None:
        """Report, from any thread, that this emulator no longer serves and why."""
        self.failure = self.failure or error
        self.failed.set()

    @abstractmethod
    def serve(self) -> dict[str, str]:
        """What `start` does for this kind; where it raises, `stop` follows."""

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
            f"--host {host}: an emulator serves this machine only: give 127.0.0.1 … 127.255.255.254"
        )


@contextmanager
def serve(
    name: str, options: EmulatorOptions | None = None, faults: str | Path | None = None
) -> Iterator[Emulator]:
    """Serve an emulated robot or sensor while the block runs.

    Args:
        name: see ``names("emulators")``.
        options: address, true parameters, noise, effects.
        faults: TOML script of timed faults; their time counts from the start of the block.

    Yields:
        The server; ``addresses`` names each link, ``failed`` is set if it breaks down.

    Raises:
        NotFoundError: there is no such emulator.
        MapError: the script of faults is wrong.
        DriverError: a port is taken or not allowed.
    """
    server: Emulator = registry.load("emulators", name)(options or EmulatorOptions())
    script = () if faults is None else timed.read(faults)
    server.faults.check(script, str(faults))
    try:
        server.addresses = server.start()
        server.faults.start(script, str(faults))
        with objects_kept():
            yield server
    finally:
        server.faults.stop()
        server.stop()
