"""The NETCANOEM transducer: polls the gauges, queries the calibration, and names what is wrong."""

import contextlib
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from wrenchbed.errors import DriverError, LinkError, ParameterError
from wrenchbed.hardware.device import GONE_S, Health, by_age, wait_until
from wrenchbed.hardware.transducers.base import HISTORY, Transducer, WrenchSample
from wrenchbed.hardware.transducers.netcanoem import frames
from wrenchbed.hardware.transducers.netcanoem.frames import GaugeReading, Pairs, Reply
from wrenchbed.hardware.transducers.netcanoem.link import CanLink, open_bus

ANSWER_S, TRIES = 0.3, 3
"""Deadline of an answer [s], which takes a millisecond on a free wire, and attempts at a query,
since a frame may be lost."""
FORCE = {1: 4.4482216152605, 2: 1.0, 3: 4448.2216152605, 4: 1e3, 5: 9.80665, 6: 9.80665e-3}
"""Code of a unit → N: lbf, N, klbf, kN, kgf, gf."""
TORQUE = {1: 0.1129848290276167, 2: 1.3558179483314004, 3: 1.0, 4: 1e-3, 5: 0.0980665, 6: 1e3}
"""Code of a unit → N·m: lbf·in, lbf·ft, N·m, N·mm, kgf·cm, kN·m."""
SILENT_S = 0.05
"""Silence after which the board may have restarted, so that its calibration is selected anew [s]: a
lost frame is over after `frames.PATIENCE_S`; `CHECK_S` finds a restart that takes less."""
CHECK_S = 0.2
"""How often a row of the active matrix is compared with the one in use [s]: all six in 1.2 s, with
some ten frames a second."""
FIRST_S = 1.0
"""Deadline of the first reading [s]: a board that answers queries sends it within a poll."""
_ZERO_S = 0.2
"""Time over which gauges are averaged for a zero [s]: ten periods of 50 Hz mains."""
_RAIL = 32767
"""Largest gauge count, by definition of 16 bits."""
_SINCE = (3, 7)
"""Firmware from which counts and units are queried; an older one is taken to use `_COUNTS` per N
and N·m. No manual of an older one is known."""
_COUNTS = 1_000_000


@dataclass(frozen=True, eq=False)
class GaugeCalibration:
    """Conversion of gauge counts to SI.

    Attributes:
        raw: matrix (6, 6) as the board holds it.
        matrix: gauge counts to N and N·m (6, 6).
    """

    raw: np.ndarray
    matrix: np.ndarray


class BoardQueries:
    """Queries of one board, one at a time.

    Args:
        link: the bus.
        base: upper seven bits of the board's ids.
    """

    def __init__(self, link: CanLink, base: int) -> None:
        self._link, self._base = link, base
        self._came = threading.Condition()
        self._answers: list[Reply] = []
        self._asking = threading.Lock()

    def take(self, reply: Reply) -> None:
        """Take an answer that is not a gauge reading."""
        with self._came:
            if len(self._answers) < 16:
                self._answers.append(reply)
                self._came.notify_all()

    def calibrate(self, slot: int) -> GaugeCalibration:
        """Select a calibration and read its matrix, counts and units.

        Raises:
            LinkError: the board does not answer.
            DriverError: its calibration cannot be used.
        """
        firmware = self._ask(frames.FIRMWARE)
        (active,) = self._ask(frames.SELECT, bytes([slot]))
        if active != slot:
            raise DriverError(f"the sensor's board selected calibration {active}, not {slot}")
        raw = self._matrix()
        counts, units = (_COUNTS, _COUNTS), (2, 3)
        if firmware[:2] >= _SINCE:
            counts, units = self._ask(frames.COUNTS), self._ask(frames.UNITS)
        return GaugeCalibration(raw, _si(raw, counts, units, slot))

    def _matrix(self) -> np.ndarray:
        """The active matrix (6, 6), read twice: its frames do not say which row they are of.

        Raises:
            LinkError: the board does not answer, or not the same each time.
        """
        before = None
        for _ in range(TRIES + 1):
            now = np.array([self.row(k) for k in range(6)])
            if before is not None and np.array_equal(before, now, equal_nan=True):
                return now
            before = now
        raise LinkError("the sensor's board sends another matrix each time")

    def row(self, axis: int) -> tuple[float, ...]:
        """A row of the active matrix, 0 … 5 for Fx … Tz.

        Raises:
            LinkError: the board does not answer.
        """
        parts = dict(self._collect(frames.MATRIX, bytes([axis]), 3))
        if sorted(parts) != [2, 3, 4]:
            raise LinkError("the sensor's board sent a matrix row in pieces that do not fit")
        return (*parts[2], *parts[3], *parts[4])

    def _ask(self, opcode: int, data: bytes = b"") -> tuple[Any, ...]:
        return self._collect(opcode, data, 1)[0].values

    def _collect(self, opcode: int, data: bytes, n: int) -> list[Reply]:
        with self._asking:
            for tries in range(TRIES):
                with self._came:
                    self._answers.clear()
                self._link.send(self._base << 4 | opcode, data)
                answers = self._wait(opcode, n, n, ANSWER_S)
                if len(answers) >= n:
                    if tries:  # a late answer to the try before would pass for the next one's
                        self._wait(opcode, n, (tries + 1) * n, ANSWER_S)
                    return answers[:n]
        raise LinkError(
            f"no answer of the sensor's board to opcode 0x{opcode:X} at base 0x{self._base:02X}: "
            "check its base address, bit rate, power and bus termination"
        )

    def _wait(self, opcode: int, frames_each: int, n: int, seconds: float) -> list[Reply]:
        """Answers to an opcode, which come in some frames each, when n are there or time is up."""
        deadline = time.monotonic() + seconds
        with self._came:
            while True:
                answers = [a for a in self._answers if 0 <= a.opcode - opcode < frames_each]
                remaining = deadline - time.monotonic()
                if len(answers) >= n or remaining <= 0.0:
                    return answers
                self._came.wait(remaining)


def _si(raw: np.ndarray, counts: tuple[int, ...], units: tuple[int, ...], slot: int) -> np.ndarray:
    """Gauge counts to N and N·m (6, 6).

    Args:
        raw: matrix (6, 6) as the board holds it.
        counts: per unit of force and of torque.
        units: codes of both.
        slot: of the calibration, for people.

    Raises:
        DriverError: a matrix, counts or units that make no sense.
    """
    usable = np.isfinite(raw).all() and np.abs(raw).max() < 1e12
    if not usable or np.linalg.matrix_rank(raw / max(np.abs(raw).max(), 1e-30)) < 6:
        raise DriverError(f"calibration {slot} of the sensor's board holds no usable matrix")
    if not all(counts):
        raise DriverError(f"calibration {slot} of the sensor's board has 0 counts per unit")
    if units[0] not in FORCE or units[1] not in TORQUE:
        raise DriverError(
            f"the sensor's board names units {units[0]} and {units[1]}, which do not exist"
        )
    scale = np.repeat([FORCE[units[0]] / counts[0], TORQUE[units[1]] / counts[1]], 3)
    return np.asarray(scale[:, None] * raw)


@dataclass(frozen=True)
class NetcanoemOptions:
    """Where the board is.

    Attributes:
        interface: of python-can; SocketCAN, or socketcand where a host is given, if empty.
        channel: name of the bus.
        host: of a socketcand server.
        port: of a socketcand server.
        bitrate: for interfaces that set it [bit/s].
        base: upper seven bits of the board's ids. The maker's 0x20 collides with CANopen.
        slot: calibration to use, 0 … 15.
        rate: of the polls, where the transducer opens the bus itself [Hz].
    """

    interface: str = ""
    channel: str = "can0"
    host: str = ""
    port: int = 29536
    bitrate: int = 1_000_000
    base: int = 0x68
    slot: int = 0
    rate: float = 250.0

    def __post_init__(self) -> None:
        if not 0 <= self.base <= 0x7F or not 0 <= self.slot <= 15:
            raise ParameterError(
                f"sensor base 0x{self.base:02X} must be 0 … 0x7F and slot {self.slot} 0 … 15"
            )
        if not 1.0 <= self.rate <= 2000.0:
            raise ParameterError(f"sensor rate {self.rate:g} Hz must be 1 … 2000 Hz")


class NetcanoemTransducer(Transducer):
    """An ATI sensor on a NETCANOEM board; over `use`'s bus it is polled by that bus's owner."""

    name = "netcanoem"
    title = "ATI sensor on a NETCANOEM board over CAN"
    options: ClassVar[type] = NetcanoemOptions

    def __init__(self, options: NetcanoemOptions | None = None) -> None:
        super().__init__()
        self.setting = options or NetcanoemOptions()
        self._shared_link: CanLink | None = None
        self._link: CanLink | None = None
        self._calibration: GaugeCalibration | None = None
        self._pairs = Pairs()
        self._bias, self._bias_id, self._lost = np.zeros(6), 0, 0
        self._reset_state()

    def _reset_state(self) -> None:
        self._verified = self._alive = False
        self._suspect = threading.Event()
        self._running = threading.Event()
        self._threads: list[threading.Thread] = []
        self._newest: WrenchSample | None = None
        self._past.clear()
        self._gauges: deque[tuple[float, np.ndarray]] = deque(maxlen=HISTORY)
        self._count = self._restarts = 0
        self._heard_at = 0.0
        self._unusable = ""

    def poll(self) -> None:
        """Request one reading; nothing happens before `connect` and after `close`.

        Raises:
            LinkError: the bus is gone.
        """
        if self._link is not None and self._running.is_set():
            now = time.monotonic()
            if self._alive and now - self._heard_at > SILENT_S:
                self._doubt()
            if self._pairs.poll(now):
                self._link.send(self.setting.base << 4 | frames.GAUGES, b"")

    def use(self, link: CanLink | None) -> None:
        """Be polled by the owner of an open bus from the next `connect` on; None: open one."""
        self._shared_link = link

    def _connect(self) -> None:
        self._reset_state()
        self._lost += self._pairs.lost
        self._pairs = Pairs()
        s = self.setting
        self._link = self._shared_link or open_bus(
            s.interface, s.channel, s.host, s.port, s.bitrate
        )
        self._board = BoardQueries(self._link, s.base)
        self._link.listen(self._received)
        self._calibration = self._board.calibrate(s.slot)
        self._verified = True
        self._heard_at = time.monotonic()
        self._running.set()
        self._start(self._check_calibration, "netcanoem calibration")
        if self._shared_link is None:
            self._start(self._poll_on, "netcanoem poll")
        if not wait_until(lambda: self._newest is not None, FIRST_S) or self._newest is None:
            raise LinkError(
                f"the sensor's board answers but sends no gauges ({self._pairs.lost} polls "
                f"lost, {self._pairs.odd} odd frames): is a second node at its ids?"
            )
        if self._newest.status & frames.BAD_CALIBRATION:
            raise DriverError(
                f"the sensor's board holds no calibration in slot {s.slot}: give the slot of the "
                "mounted sensor"
            )

    def _close(self) -> None:
        self._running.clear()
        self._suspect.set()
        for thread in self._threads:
            thread.join(2.0)
        self._threads = []
        if self._link is not None:
            self._link.leave(self._received)
            if self._shared_link is None:
                self._link.close()

    def _start(self, run: Callable[[], None], name: str) -> None:
        thread = threading.Thread(target=run, name=name, daemon=True)
        self._threads.append(thread)
        thread.start()

    def _received(self, t: float, can_id: int, data: bytes) -> None:
        reply = frames.parse(can_id, data, self.setting.base)
        if reply is None:
            return
        if reply.opcode not in (frames.GAUGES, frames.ODD):
            self._board.take(reply)
            return
        reading = self._pairs.take(t, reply)
        if reading is None:
            return
        if self._alive and t - self._heard_at > SILENT_S and self._running.is_set():
            self._doubt()
        self._heard_at = t
        self._alive = self._verified
        before = 0 if self._newest is None else self._newest.status
        if reading.status & ~before & frames.WATCHDOG_RESET and self._newest is not None:
            self._doubt()
        if self._verified and self._calibration is not None:
            self._publish(reading, self._calibration.matrix)

    def _publish(self, reading: GaugeReading, matrix: np.ndarray) -> None:
        gauges = np.array(reading.gauges, dtype=float)
        wrench = matrix @ (gauges - self._bias)
        railed = np.abs(gauges + 0.5) > _RAIL
        channels = (matrix[:, railed] != 0.0).any(axis=1)
        saturated = sum(1 << k for k in range(6) if channels[k])
        self._count += 1
        self._gauges.append((reading.t, gauges))
        self._newest = sample = WrenchSample(
            reading.t, None, self._count, 0.0, True, wrench, status=reading.status,
            saturated=saturated, lost=self._lost + self._pairs.lost, bias_id=self._bias_id,
            faults=frames.faults(reading.status),
        )  # fmt: skip
        self._past.add(sample)

    def _doubt(self) -> None:
        """The board may have restarted: publish nothing until its calibration is in force."""
        self._verified = self._alive = False
        self._suspect.set()

    def _check_calibration(self) -> None:
        """Select the calibration anew after a restart, and detect restarts without silence."""
        axis = 0
        while self._running.is_set():
            doubted = self._suspect.wait(CHECK_S)
            if not self._running.is_set():
                return
            with contextlib.suppress(DriverError):
                if not doubted:
                    known = self._calibration
                    if known is None or tuple(known.raw[axis]) == self._board.row(axis):
                        axis = (axis + 1) % 6
                        continue
                    self._doubt()
                self._restore()
                continue
            time.sleep(0.01)

    def _restore(self) -> None:
        self._suspect.clear()
        try:
            self._calibration = self._board.calibrate(self.setting.slot)
        except DriverError as error:
            self._unusable = "" if isinstance(error, LinkError) else str(error)
            self._suspect.set()
            raise
        self._unusable = ""
        self._restarts += 1
        self._heard_at = time.monotonic()
        self._verified = not self._suspect.is_set()

    def _poll_on(self) -> None:
        period, due = 1.0 / self.setting.rate, time.monotonic()
        while self._running.is_set():
            try:
                self.poll()
            except LinkError:
                return
            due = max(due + period, time.monotonic() - period)
            time.sleep(max(0.0, due - time.monotonic()))

    def _read(self) -> WrenchSample:
        newest = self._newest
        if newest is None:
            raise LinkError("the sensor has sent no reading yet")
        lost = self._lost + self._pairs.lost
        return replace(newest, wrench=newest.wrench.copy(), lost=lost, bias_id=self._bias_id)

    def _zero(self) -> int:
        since = time.monotonic() - _ZERO_S
        recent = [gauges for t, gauges in list(self._gauges) if t > since]
        if not recent:
            raise DriverError("the sensor sent nothing lately: its zero cannot be set")
        self._bias = np.mean(recent, axis=0)
        self._bias_id += 1
        return self._bias_id

    def _health(self) -> Health:
        now, link = time.monotonic(), self._link
        counters = {
            "readings": float(self._count), "lost": float(self._pairs.lost),
            "odd frames": float(self._pairs.odd), "calibrations": 1.0 + self._restarts,
            "error frames": float(link.error_frames if link else 0),
            "queue full": float(link.full if link else 0),
        }  # fmt: skip
        status = self._newest.status if self._newest else 0
        age = now - self._newest.t if self._newest else np.inf
        if link is None or link.dead:
            why = link.dead if link else "it is not open"
            return Health("lost", f"CAN bus of the sensor: {why}", counters)
        if self._pairs.clash(now):
            ids = f"0x{self.setting.base << 4:03X}"
            why = f"a second node answers at the sensor's ids {ids} …: move one of them"
            return Health("fault", why, counters)
        if self._unusable:
            return Health("fault", self._unusable, counters)
        if status & frames.CRITICAL and age < GONE_S:
            words = ", ".join(frames.faults(status & frames.CRITICAL))
            return Health("fault", f"the sensor's board reports: {words}", counters)
        if not (self._verified and self._alive) and age < GONE_S:
            why = "the sensor's board fell silent: its calibration is being selected anew"
            return Health("stale", why, counters)
        return by_age(float(age), "sensor", counters)
