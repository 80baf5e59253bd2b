"""What sensors on a serial line share: the body's readings on time, and faults of the sensor."""

import time
from abc import ABC, abstractmethod
from asyncio import TimerHandle
from collections.abc import Callable
from typing import ClassVar

import numpy as np

from robot_emulators.base import arguments
from robot_emulators.base.arguments import Argument
from robot_emulators.base.body import Body
from robot_emulators.base.event_loop import LoopThread
from robot_emulators.base.faults import Faults, TimedFault
from robot_emulators.base.timeline import Timeline
from robot_emulators.serial_sensors.line import SerialLine

FAULTS: dict[str, dict[str, Argument]] = {
    "freeze": {}, "mute": {}, "restart": {}, "saturate": {"channel": arguments.integer(0, 5, 0)},
}  # fmt: skip
_BURST_S = 2.5e-3
"""Shortest time between two looks at what is due [s]."""
_LATE_S = 0.1
"""Lag beyond which readings are left out instead of sent at once [s]."""


class SerialSensor(ABC):
    """A sensor whose stream a client reads; someone else steps the body in real time.

    Faults besides those of the line: ``freeze``: the same bytes again and again, ``mute``: no
    answers, ``restart``: power off and on, ``saturate`` a ``channel`` 0 … 5.

    Args:
        body: whose sensor; its `Body.readings` are this sensor's alone.
        host: tells lines of several emulators apart.
        faults: where its faults are registered.
        seed: of faults that draw at random.
        failed: called with an error of the sensor itself.
    """

    name: ClassVar[str]
    baud: ClassVar[int]
    sensor: ClassVar[str]
    """Registry name, whose range and noise it has."""
    faults: ClassVar[dict[str, dict[str, Argument]]] = {}
    """Kinds of faults that this sensor has more."""

    def __init__(
        self, body: Body, host: str, faults: Faults, seed: int, failed: Callable[[Exception], None]
    ) -> None:
        self._body = body
        self._thread = LoopThread(f"{self.name} sensor", failed)
        self._line = SerialLine(
            self._thread, self.name, host, self.baud, self._received, faults,
            FAULTS | self.faults, seed,
        )  # fmt: skip
        self._line.faults.at_once("restart", self._restarted)
        self._timeline = Timeline(body.cycle)
        self._range = np.asarray(body.sensor.calibration().range)
        self._timer: TimerHandle | None = None
        self._frozen: bytes | None = None
        self._since = 0.0
        self._sent = 0
        self.streams = False

    @property
    @abstractmethod
    def period(self) -> float:
        """Time between two readings [s]."""

    @abstractmethod
    def _received(self, data: bytes) -> None:
        """Take bytes of a client, in the loop's thread."""

    @abstractmethod
    def _frame(self, wrench: np.ndarray, over: bool, number: int) -> bytes:
        """Bytes of one reading (6,) [N, N·m]: the number-th since the stream began."""

    @abstractmethod
    def _restart(self) -> None:
        """Do what power off and on does."""

    def start(self) -> dict[str, str]:
        """Serve from now on; the path of the line by the sensor's name.

        Raises:
            DriverError: another emulator serves it.
        """
        self._line.open()
        self._body.readings(self._body.ahead + 1e-6 * np.arange(64))  # loads what noise needs
        self._thread.start()
        self._thread.soon(lambda: self._turn(time.monotonic()))
        return {self.name: str(self._line.path)}

    def stop(self) -> None:
        """Close the line; may be called twice."""
        if self._thread.running:
            self._thread.call(self._end)
        else:
            self._line.close()
        self._thread.stop()

    def answer(self, data: bytes) -> None:
        """Send an answer, unless the sensor is mute."""
        if self._line.faults.now("mute") is None:
            self._line.send(data)

    def stream(self) -> None:
        """Stream from now on, from reading 0."""
        self.streams, self._since, self._sent = True, time.monotonic(), 0

    def _end(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._line.close()

    def _restarted(self, fault: TimedFault) -> None:
        self._thread.soon(self._restart)

    def _turn(self, due: float) -> None:
        """Send what is due, on absolute deadlines [s]."""
        now = time.monotonic()
        self._timeline.observe(*self._body.punctual)
        if self.streams:
            n = int((now - self._since) / self.period) + 1 - self._sent
            if n * self.period > _LATE_S:
                self._sent += n - 1
                n = 1
            if n > 0:
                self._send(n)
        due = max(due + max(self.period, _BURST_S), now)
        self._timer = self._thread.loop.call_at(due, self._turn, due)

    def _send(self, n: int) -> None:
        """Send the next n readings, which are drawn together."""
        times = self._since + (self._sent + np.arange(n)) * self.period
        values, flagged = self._body.readings(times + self._timeline.simulated(0.0))
        rows = np.nan_to_num(values)
        if one := self._line.faults.now("saturate"):
            rows[:, int(one["channel"])] = self._range[int(one["channel"])]
        over = (flagged != 0) | (np.abs(rows) >= self._range).any(axis=1)
        rows = np.clip(rows, -self._range, self._range)
        for row, beyond in zip(rows, over, strict=True):
            self._show(self._frame(row, bool(beyond), self._sent))
            self._sent += 1

    def _show(self, frame: bytes) -> None:
        if self._line.faults.now("freeze") is None:
            self._frozen = None
        elif self._frozen is None:
            self._frozen = frame
        self._line.send(frame if self._frozen is None else self._frozen)
