"""The life of whatever is connected: a robot's driver, a sensor's electronics."""

from abc import ABC, abstractmethod
from types import TracebackType
from typing import ClassVar, Self

from wrenchbed.errors import DriverError
from wrenchbed.health import Health


class Device(ABC):
    """Something that is opened, used and let go of. Use as a context manager."""

    name: ClassVar[str]
    title: ClassVar[str]
    options: ClassVar[type]
    """A dataclass of what the constructor takes."""

    def __init__(self) -> None:
        self._connected = False

    def connect(self) -> None:
        """Open the device and wait until it tells something; nothing moves.

        Raises:
            LinkError: it cannot be reached, or does not answer within its deadline.
            DriverError: it answers what cannot be used.
        """
        if not self._connected:
            try:
                self._connect()
            except BaseException:
                self._close()
                raise
            self._connected = True

    def close(self) -> None:
        """Let go of the device; may be called twice."""
        if self._connected:
            self._connected = False
            self._close()

    def health(self) -> Health:
        """What is wrong, if anything."""
        return self._health() if self._connected else Health("closed", "call connect() first")

    @abstractmethod
    def _connect(self) -> None: ...

    @abstractmethod
    def _close(self) -> None:
        """Must bear a half-open device."""

    @abstractmethod
    def _health(self) -> Health: ...

    def _check_connected(self) -> None:
        if not self._connected:
            raise DriverError(f"{self.name!r} is not connected: call connect() first")

    def __enter__(self) -> Self:
        self.connect()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
