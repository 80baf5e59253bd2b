"""A serial sensor in this process, its faults, and a transducer on it."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from robot_emulators.base.emulator import Emulator, EmulatorOptions
from robot_emulators.base.faults import TimedFault
from wrenchbed import registry
from wrenchbed.hardware.transducers.address import transducer_at
from wrenchbed.hardware.transducers.serial_line.transducer import SerialTransducer

NAMES = ("robotiq-ft300", "bota")


class SerialScene:
    """An emulator, and the path of its line."""

    def __init__(self, emulator: Emulator) -> None:
        self.emulator = emulator
        self.path = emulator.addresses[emulator.name]

    @property
    def address(self) -> str:
        return f"{self.emulator.name}://{self.path}"

    @property
    def load(self) -> np.ndarray:
        """Mean reading of the resting robot (6,), from the simulation itself."""
        body = self.emulator.body
        return body.model.read(body.load, body.theta)

    def fault(self, kind: str, seconds: float = 0.0, **values) -> None:
        self.emulator.faults.inject(TimedFault("serial", kind, 0.0, seconds, values))

    def made(self, query: str = "") -> SerialTransducer:
        found = transducer_at(self.address + query)
        assert isinstance(found, SerialTransducer)
        return found


@contextmanager
def on_a_line(name: str, host: str, noise: str = "white", **setting: str) -> Iterator[SerialScene]:
    """A sensor that serves until the block ends."""
    kind = registry.load("emulators", name)
    emulator = kind(EmulatorOptions(host, noise=noise, seed=4, setting=setting))
    try:
        emulator.addresses = emulator.start()
        yield SerialScene(emulator)
    finally:
        emulator.stop()
