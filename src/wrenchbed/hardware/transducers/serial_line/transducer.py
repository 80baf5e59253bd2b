"""What transducers on a serial line share: the reading thread, the zero, and what can go wrong.

A transducer of this kind fills in how a session with its sensor begins and ends, and what a frame
says. A stream that repeats itself, or whose clock stands still, is a fault.
"""

import contextlib
import threading
import time
from abc import abstractmethod
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar
from urllib.parse import SplitResult

import numpy as np

from wrenchbed import registry
from wrenchbed.errors import DriverError, LinkError, ParameterError
from wrenchbed.hardware.device import STALE_S, Health, by_age, wait_until
from wrenchbed.hardware.transducers.address import numbers_of
from wrenchbed.hardware.transducers.base import HISTORY, Transducer, WrenchSample
from wrenchbed.hardware.transducers.serial_line.framing import Framer, FrameShape
from wrenchbed.hardware.transducers.serial_line.port import SerialPort

WAIT_S = 0.05
"""Longest wait for bytes [s]; estimate."""
_FIRST_S = 1.5
"""Deadline of the first reading [s]; estimate."""
_SAME = 20
"""Equal readings after which a stream may be frozen; estimate."""
_ZERO_S = 0.2
"""Time over which readings are averaged for a zero [s]; estimate."""
_FULL = 0.9999
"""Share of full scale from which a channel counts as saturated; estimate."""
ALL_CHANNELS = 0x3F
"""Bits of all six channels."""


@dataclass(frozen=True)
class SerialOptions:
    """Where a sensor is.

    Attributes:
        port: of this machine, for instance ``/dev/ttyUSB0``.
        sensor: registry name; its range tells which channel saturates. Empty: unknown.
        frozen_s: time without any change after which readings count as frozen [s]; 0 never.
    """

    port: str
    sensor: str = ""
    frozen_s: float = 0.5

    def __post_init__(self) -> None:
        if not self.port.startswith("/"):
            raise ParameterError(f"port {self.port!r}: give its path, for instance /dev/ttyUSB0")
        if not 0.0 <= self.frozen_s < 1e6:
            raise ParameterError(f"frozen_s = {self.frozen_s:g} s must be 0 or more")


@dataclass(frozen=True, eq=False)
class Decoded:
    """What one frame says.

    Attributes:
        wrench: (6,) [N, N·m].
        status: the sensor's own status word.
        stamp: of the sensor's clock, in its own counts; None where it has none.
    """

    wrench: np.ndarray
    status: int = 0
    stamp: int | None = None


@dataclass(frozen=True, eq=False)
class Received:
    """The newest reading, and since when nothing in it has changed."""

    sample: WrenchSample
    raw: Decoded
    since: float
    same: int
    stamp_since: float
    stamp_same: int


class SerialTransducer(Transducer):
    """A sensor that streams frames over a serial line.

    `zero` subtracts the mean of the last 0.2 s from then on; the sensor itself is left as it is.
    """

    options: ClassVar[type] = SerialOptions
    shape: ClassVar[FrameShape]
    maker: ClassVar[str]
    """Name for people."""
    clocked: ClassVar[bool] = False
    """Whether the sensor's clock tells which readings are lost, else the bytes between frames."""

    def __init__(self, options: SerialOptions) -> None:
        super().__init__()
        self._options = options
        self._range: np.ndarray | None = None
        if options.sensor:
            sensor = registry.load("sensors", options.sensor)
            self._range = np.asarray(sensor.calibration(None).range)
        self._bias, self._bias_id, self._lost = np.zeros(6), 0, 0
        self._identity: dict[str, str] = {}
        self._reset()

    def _reset(self) -> None:
        self._port: SerialPort | None = None
        self._framer = Framer(self.shape)
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None
        self._newest: Received | None = None
        self._raw: deque[tuple[float, np.ndarray]] = deque(maxlen=HISTORY)
        self._gone = self._trouble = ""
        self._missed = 0
        self._past.clear()

    @classmethod
    def at_address(cls, parts: SplitResult) -> "SerialTransducer":
        if parts.netloc or not parts.path.startswith("/"):
            raise ParameterError("give the path of its port")
        return cls(cls.options(port=parts.path, **numbers_of(parts.query, cls.options)))

    @property
    def sensor_model(self) -> str:
        return self._options.sensor

    @property
    def full_scale(self) -> np.ndarray | None:
        return self._range if self._connected else None

    @property
    def identity(self) -> Mapping[str, str]:
        return self._identity if self._connected else {}

    @abstractmethod
    def _open(self) -> SerialPort:
        """The open port."""

    @abstractmethod
    def _begin(self, port: SerialPort) -> dict[str, str]:
        """Make the sensor stream; what it says of itself.

        Raises:
            LinkError: it does not answer.
            DriverError: something else answers.
        """

    @abstractmethod
    def _end(self, port: SerialPort) -> None:
        """Leave the sensor as the next program expects it."""

    @abstractmethod
    def _decode(self, frame: bytes) -> Decoded:
        """What a frame says, whose check holds."""

    @abstractmethod
    def _timed(self, now: float, k: int, n: int, raw: Decoded) -> tuple[float, float | None]:
        """When frame k of n that were read at once came, or would have without delay, and the
        sensor's own time [s]."""

    def _faults(self, status: int) -> tuple[str, ...]:
        """Meaning of a status word."""
        return ()

    def _broken(self, status: int) -> bool:
        """Whether a status word says that readings are wrong."""
        return False

    def _over(self, status: int) -> bool:
        """Whether a status word says that a reading left the range."""
        return False

    def _between(self, before: Decoded, raw: Decoded, gap: float) -> int:
        """Readings that never came between two, a time [s] apart."""
        return 0

    def _renewed(self, before: Decoded, raw: Decoded) -> str:
        """What is wrong with a sensor that started anew between two readings; else empty."""
        return ""

    @property
    def what(self) -> str:
        """Sensor and port, for messages."""
        return f"{self.maker} at {self._options.port}"

    def _connect(self) -> None:
        self._reset()
        self._port = port = self._open()
        self._identity = self._begin(port)
        self._thread = threading.Thread(target=self._run, name=f"{self.name} reader", daemon=True)
        self._thread.start()
        wait_until(lambda: self._newest is not None or bool(self._gone), _FIRST_S)
        if self._newest is None:
            bytes_came = self._framer.skipped + self._framer.waiting
            raise LinkError(self._gone or self._silent(bytes_came, "does not stream"))

    def _close(self) -> None:
        self._ended.set()
        if self._thread is not None:
            self._thread.join(2.0)
        self._lost = self._total_lost
        if self._port is not None:
            if not self._gone:
                with contextlib.suppress(LinkError):
                    self._end(self._port)
            self._port.close()
        self._port = None

    def _silent(self, came: int, what: str) -> str:
        """Why nothing usable came, from how many bytes did."""
        if came:
            return (
                f"{self.what}: {came} bytes came that are none of this sensor's: another device "
                "is at this port, or it runs at another bit rate: give the sensor's port "
                "(ls -l /dev/serial/by-id)"
            )
        return (
            f"{self.what}: {what}: check its power, the two signal wires (swapped they are "
            "silent) and the port"
        )

    def _run(self) -> None:
        port = self._port
        assert port is not None
        try:
            while not self._ended.is_set():
                data = port.read(WAIT_S)
                frames = self._framer.feed(data) if data else []
                now = time.monotonic()
                for k, frame in enumerate(frames):
                    self._take(self._decode(frame), now, k, len(frames))
        except LinkError as error:
            self._gone = str(error)

    def _take(self, raw: Decoded, now: float, k: int, n: int) -> None:
        if not np.isfinite(raw.wrench).all():
            self._missed += 1
            return
        t, device = self._timed(now, k, n, raw)
        before = self._newest
        since = stamp_since = now
        same = stamp_same = 1
        renewed = ""
        if before is not None:
            t = max(t, self._raw[-1][0] + 1e-6)
            self._missed += self._between(before.raw, raw, t - self._raw[-1][0])
            renewed = self._renewed(before.raw, raw)
            if np.array_equal(before.raw.wrench, raw.wrench):
                since, same = before.since, before.same + 1
            if raw.stamp is not None and raw.stamp == before.raw.stamp:
                stamp_since, stamp_same = before.stamp_since, before.stamp_same + 1
        self._trouble = renewed or self._trouble
        self._raw.append((t, raw.wrench))
        sample = WrenchSample(
            now, device, self._framer.frames, 0.0, True, raw.wrench - self._bias, status=raw.status,
            saturated=self._saturated(raw), lost=self._total_lost, bias_id=self._bias_id,
            faults=self._faults(raw.status),
        )  # fmt: skip
        self._newest = Received(sample, raw, since, same, stamp_since, stamp_same)
        self._past.add(replace(sample, t=t))

    @property
    def _total_lost(self) -> int:
        return self._lost + self._missed + (0 if self.clocked else self._framer.damaged)

    def _saturated(self, raw: Decoded) -> int:
        mask = 0
        if self._range is not None:
            over = np.abs(raw.wrench) >= _FULL * self._range
            mask = int(sum(1 << k for k in range(6) if over[k]))
        return mask or (ALL_CHANNELS if self._over(raw.status) else 0)

    def _read(self) -> WrenchSample:
        newest = self._newest
        if newest is None:
            raise LinkError(f"{self.what}: no reading came yet")
        return replace(newest.sample, lost=self._total_lost)

    def _zero(self) -> int:
        now = time.monotonic()
        recent = [wrench for t, wrench in list(self._raw) if now - t <= _ZERO_S]
        if not recent:
            raise DriverError(f"{self.what}: no reading came in the last {_ZERO_S:g} s to zero at")
        self._bias = np.mean(recent, axis=0)
        self._bias_id += 1
        return self._bias_id

    def _health(self) -> Health:
        newest, counters = self._newest, self._counters()
        if self._gone:
            return Health("lost", self._gone, counters)
        if newest is None:
            return Health("starting", "no reading came yet", counters)
        age = time.monotonic() - newest.sample.t
        if age < STALE_S and (frozen := self._frozen(newest)):
            return Health("fault", f"{self.what}: frozen: {frozen}: switch it off and on", counters)
        health = by_age(age, self.what, counters)
        if not health.ok:
            return replace(health, detail=f"{health.detail}: check its cable and power")
        if self._trouble:
            return Health("fault", f"{self.what}: {self._trouble}", counters)
        words = ", ".join(newest.sample.faults)
        if self._broken(newest.sample.status):
            status = newest.sample.status
            return Health("fault", f"{self.what}: status 0x{status:04x}: {words}", counters)
        return Health("ok", words, counters)

    def _frozen(self, newest: Received) -> str:
        """What stands still, empty if nothing does."""
        limit, t = self._options.frozen_s, newest.sample.t
        if not limit:
            return ""
        if newest.stamp_same > _SAME and t - newest.stamp_since >= limit:
            return f"its clock stands still for {t - newest.stamp_since:.2f} s"
        if newest.same > _SAME and t - newest.since >= limit:
            return f"the same readings for {t - newest.since:.2f} s"
        return ""

    def _counters(self) -> dict[str, float]:
        framer = self._framer
        return {
            "readings": framer.frames, "lost": self._total_lost, "damaged": framer.damaged,
            "stray bytes": framer.skipped,
        }  # fmt: skip
