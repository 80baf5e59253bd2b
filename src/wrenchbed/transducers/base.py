"""What a transducer is: it reads a force/torque sensor and says how far to trust each reading.

A reading is never frozen silently: it carries its age, and `health` names what is wrong. Nothing
here blocks but `connect`, which has a deadline.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from types import TracebackType
from typing import ClassVar

import numpy as np

from wrenchbed.errors import DriverError
from wrenchbed.health import Health


@dataclass(frozen=True, eq=False)
class WrenchSample:
    """One reading.

    Attributes:
        t: `time.monotonic` of this machine when it arrived [s].
        device_time: on the sensor's own clock [s], None where it has none.
        sequence: of the sensor's samples, or of the replies where it counts none.
        age: time between arrival and the call that returned this [s].
        fresh: newer than what the call before returned.
        wrench: load on the tool side (6,) [N, N·m].
        frame: whose axes: ``sensor``, ``flange``, ``tcp`` or ``base``.
        reference: about whose origin the torques are: ``sensor``, ``flange`` or ``tcp``.
        status: the sensor's own status word.
        saturated: bit i is set where channel i is at the end of its range.
        lost: readings known to be lost since `connect`.
        bias_id: how often the zero was changed since `connect`.
        faults: what the status word says is wrong, in words.
    """

    t: float
    device_time: float | None
    sequence: int
    age: float
    fresh: bool
    wrench: np.ndarray
    frame: str = "sensor"
    reference: str = "sensor"
    status: int = 0
    saturated: int = 0
    lost: int = 0
    bias_id: int = 0
    faults: tuple[str, ...] = ()


class Transducer(ABC):
    """A force/torque sensor with its electronics. Use as a context manager."""

    name: ClassVar[str]
    title: ClassVar[str]
    options: ClassVar[type]
    """A dataclass of what the constructor takes."""

    def __init__(self) -> None:
        self._connected = False

    def connect(self) -> None:
        """Open the device and wait for its first reading.

        Raises:
            LinkError: it does not answer within its deadline.
            DriverError: it answers what cannot be used.
        """
        if not self._connected:
            try:
                self._open()
            except BaseException:
                self._shut()
                raise
            self._connected = True

    def close(self) -> None:
        """Let go of the device; may be called twice."""
        if self._connected:
            self._connected = False
            self._shut()

    def read(self) -> WrenchSample:
        """The newest reading; never blocks."""
        self._check_connected()
        return self._read()

    def at(self, t: float) -> np.ndarray | None:
        """Wrench (6,) as it was at a time of `time.monotonic` [s]; None where nothing is known."""
        self._check_connected()
        return self._at(t)

    def zero(self) -> int:
        """Make the present load read as zero; returns the new bias id.

        Raises:
            DriverError: this device cannot.
        """
        self._check_connected()
        return self._zero()

    def health(self) -> Health:
        """What is wrong, if anything."""
        return self._health() if self._connected else Health("closed", "call connect() first")

    @abstractmethod
    def _open(self) -> None: ...

    @abstractmethod
    def _shut(self) -> None:
        """Must bear a half-open device."""

    @abstractmethod
    def _read(self) -> WrenchSample: ...

    @abstractmethod
    def _health(self) -> Health: ...

    def _at(self, t: float) -> np.ndarray | None:
        """The newest reading, where a device keeps no earlier ones."""
        return self._read().wrench

    def _zero(self) -> int:
        raise DriverError(f"transducer {self.name!r} cannot change its zero")

    def _check_connected(self) -> None:
        if not self._connected:
            raise DriverError(f"transducer {self.name!r} is not connected: call connect() first")

    def __enter__(self) -> "Transducer":
        self.connect()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
