"""Base class of emulators: servers that unmodified client libraries take for the device.
An emulator is best run in a process of its own: client libraries may hold Python's lock."""

import ipaddress
import threading
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar, Self

from robot_emulators.base.faults import Faults
from robot_emulators.errors import SettingError
from robot_emulators.plant import PlantMaker


@dataclass(frozen=True)
class Options:
    """Options that every emulator takes.

    Attributes:
        host: address of this machine to serve at, 127.0.0.1 … 127.255.255.254.
        seed: seed of the emulator's random numbers.
        setting: name → value as text, of settings that this kind of emulator has.
    """

    host: str = "127.0.0.1"
    seed: int = 0
    setting: Mapping[str, str] = field(default_factory=dict)


class Emulator(ABC):
    """Base class of servers that speak a device's protocols, to clients on this machine only.

    Args:
        options: address, seed and settings of the emulator.
        make_plant: makes the robot model behind the emulator, a `Plant`.

    Attributes:
        name, title: word that names the emulator in commands, and a line on what it emulates.

    Raises:
        SettingError: the host is not one of 127.0.0.0/8, or an option is impossible.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    settings: ClassVar[Mapping[str, str]]
    """Name of each setting → what it does and its default."""

    def __init__(self, options: Options, make_plant: PlantMaker) -> None:
        try:
            local = ipaddress.IPv4Address(options.host).is_loopback
        except ValueError:
            local = False
        if not local:
            raise SettingError(
                f"--host {options.host}: an emulator serves this machine only: give 127.0.0.1 … "
                "127.255.255.254"
            )
        self.options, self.make_plant = options, make_plant
        self.faults = Faults()
        self.addresses: dict[str, str] = {}
        self.failed = threading.Event()
        self.failure: BaseException | None = None

    def start(self) -> dict[str, str]:
        """Begin to serve; return link name → address (as ``host:port``). Raises an `EmulatorError`,
        which names port and remedy, if a port is taken or not allowed.
        """
        try:
            self.addresses = self.serve()
        except BaseException:
            self.stop()
            raise
        return self.addresses

    def fail(self, error: BaseException) -> None:
        """Record an error, from any thread, as the reason why this emulator no longer serves."""
        self.failure = self.failure or error
        self.failed.set()

    @abstractmethod
    def serve(self) -> dict[str, str]:
        """Open the links, return link name → address; if it raises, `start` calls `stop`."""

    @abstractmethod
    def stop(self) -> None:
        """Close all links of the emulator; may be called twice."""

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *error: object) -> None:
        self.stop()
