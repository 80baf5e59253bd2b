"""The NETCANOEM board of an ATI gauge sensor: polling, query of its calibration, health."""

import threading
import time
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from wrenchbed.errors import DriverError, LinkError
from wrenchbed.hardware.device_base import GONE_S, Health, by_age, wait_until
from wrenchbed.hardware.drivers.can import netcanoem_frames
from wrenchbed.hardware.drivers.can.bus import CanLink
from wrenchbed.hardware.drivers.can.netcanoem_frames import Pairs, Reply
from wrenchbed.hardware.transducers.base import Transducer, WrenchSample

ANSWER_S, TRIES = 0.3, 3
"""Deadline of an answer [s], which takes a millisecond on a free bus, and number of attempts at a
query, since a frame may be lost."""
FORCE = {1: 4.4482216152605, 2: 1.0, 3: 4448.2216152605, 4: 1e3, 5: 9.80665, 6: 9.80665e-3}
"""Code of a unit of force → its size [N]: lbf, N, klbf, kN, kgf, gf."""
TORQUE = {1: 0.1129848290276167, 2: 1.3558179483314004, 3: 1.0, 4: 1e-3, 5: 0.0980665, 6: 1e3}
"""Code of a unit of torque → its size [N·m]: lbf·in, lbf·ft, N·m, N·mm, kgf·cm, kN·m."""
SILENT_S = 0.05
"""Silence after which the board may have restarted, so that its calibration is selected anew [s]:
longer than two lost frames. Shorter restarts are detected by `CHECK_S`."""
CHECK_S = 0.2
"""Time between two comparisons of a row of the board's matrix with the one in use [s]."""
FIRST_S = 1.0
"""Deadline of the first reading [s]: a board that answers queries sends it at the first poll."""
_AGAIN_S = 0.01
"""Pause before a lost calibration is queried again [s]."""
_RAIL = 32767
"""Largest gauge count, by definition of 16 bits; beyond it a gauge is saturated."""
_MOST_ANSWERS = 16
"""Most answers of the board that wait to be read; a query has three at most."""


class GaugeCalibration(NamedTuple):
    """Calibration of a sensor: ``raw`` (6, 6) as stored on the board, and ``matrix`` (6, 6) from
    gauge counts to wrenches [N, N·m]."""

    raw: np.ndarray
    matrix: np.ndarray


class BoardQueries:
    """Sends queries to a sensor board, one at a time; ``base``: upper seven bits of its CAN ids."""

    def __init__(self, link: CanLink, base: int) -> None:
        self._link, self._base = link, base
        self._came = threading.Condition()
        self._answers: list[Reply] = []

    def take(self, reply: Reply) -> None:
        """Store a frame that answers a query; the bus reader passes all but gauge readings."""
        with self._came:
            if len(self._answers) < _MOST_ANSWERS:
                self._answers.append(reply)
                self._came.notify_all()

    def calibrate(self, slot: int) -> GaugeCalibration:
        """Select the calibration in a slot, 0 … 15; read its matrix, counts and units. Raises a
        `LinkError` if the board does not answer, a `DriverError` if the calibration is unusable."""
        (active,) = self._collect(netcanoem_frames.SELECT, bytes([slot]))[0].values
        if active != slot:
            raise DriverError(f"the sensor's board selected calibration {active}, not {slot}")
        raw = self._matrix()
        counts = self._collect(netcanoem_frames.COUNTS)[0].values
        units = self._collect(netcanoem_frames.UNITS)[0].values
        return GaugeCalibration(raw, in_si(raw, counts, units, slot))

    def _matrix(self) -> np.ndarray:
        """Read the active matrix (6, 6) until two readings agree: frames do not state their row."""
        before = None
        for _ in range(TRIES + 1):
            now = np.array([self.row(k) for k in range(6)])
            if before is not None and np.array_equal(before, now, equal_nan=True):
                return now
            before = now
        raise LinkError("the sensor's board sends another matrix each time")

    def row(self, axis: int) -> tuple[float, ...]:
        """Read a row of the active matrix, 0 … 5 for Fx … Tz; a `LinkError` without an answer."""
        for _ in range(TRIES):  # a late piece of the row before may come first
            parts = dict(self._collect(netcanoem_frames.MATRIX, bytes([axis]), 3))
            if sorted(parts) == [2, 3, 4]:
                return (*parts[2], *parts[3], *parts[4])
        raise LinkError("the sensor's board sent a matrix row in pieces that do not fit")

    def _collect(self, opcode: int, data: bytes = b"", n: int = 1) -> list[Reply]:
        """Send query ``opcode`` with ``data``; return the n answers; a `LinkError` without them."""
        for tries in range(TRIES):
            with self._came:
                self._answers.clear()
            self._link.send(self._base << 4 | opcode, data)
            answers = self._wait(opcode, n, n)
            if len(answers) >= n:
                if tries:  # a late answer to the try before would pass for the next one's
                    self._wait(opcode, n, (tries + 1) * n)
                return answers[:n]
        raise LinkError(
            f"no answer of the sensor's board to opcode 0x{opcode:X} at base 0x{self._base:02X}: "
            "check its base address, bit rate, power and bus termination"
        )

    def _wait(self, opcode: int, each: int, n: int) -> list[Reply]:
        """Return up to n answers to opcodes ``opcode`` … + ``each`` − 1 within `ANSWER_S`."""

        def answers() -> list[Reply]:
            return [a for a in self._answers if 0 <= a.opcode - opcode < each]

        with self._came:
            self._came.wait_for(lambda: len(answers()) >= n, ANSWER_S)
            return answers()


def in_si(
    raw: np.ndarray, counts: tuple[Any, ...], units: tuple[Any, ...], slot: int
) -> np.ndarray:
    """Convert a calibration as a board states it to a matrix (6, 6) from gauge counts to N and N·m.
    ``raw`` (6, 6) is its matrix; ``counts`` and ``units`` are counts per unit, and code of the
    unit, of force and of torque; ``slot`` is its number, for errors: a `DriverError` if values are
    unusable."""
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


class GaugeBoard(Transducer):
    """Transducer of an ATI sensor on a NETCANOEM board (ATI's CAN electronics), polled by the owner
    of its CAN bus; ``base``: upper seven bits of the board's ids; ``slot``: number of the sensor's
    calibration, 0 … 15."""

    name = "netcanoem"
    title = "ATI sensor on a NETCANOEM board over CAN"

    def __init__(self, base: int, slot: int) -> None:
        super().__init__()
        self._base, self._slot = base, slot
        self._link: CanLink | None = None
        self._pairs = Pairs()
        self._lost = 0
        self._start_anew()

    def _start_anew(self) -> None:
        self._lost += self._pairs.lost
        self._pairs = Pairs()
        self._running = False
        self._calibration: GaugeCalibration | None = None
        """Calibration active on the board; None while it is uncertain: no reading is published."""
        self._suspect = threading.Event()
        self._newest: WrenchSample | None = None
        self._past.clear()
        self._count = self._restarts = 0
        self._restored_at = 0.0  # readings of before may be of another calibration [s]
        self._heard_at = np.inf
        """When the last reading came [s]; infinite until the first with a new calibration."""
        self._unusable = ""

    def use(self, link: CanLink) -> None:
        """Set the open CAN bus that the next `connect` uses; the caller keeps and closes it."""
        self._link = link

    def poll(self) -> None:
        """Request a sensor reading, unless closed; a `LinkError` if the bus is gone."""
        if self._link is not None and self._running:
            now = time.monotonic()
            self._doubt_after_silence(now)
            if self._pairs.poll(now):
                self._link.send(self._base << 4 | netcanoem_frames.GAUGES, b"")

    def _connect(self) -> None:
        if self._link is None:
            raise DriverError("the sensor's board has no bus: call use() first")
        self._start_anew()
        self._board = BoardQueries(self._link, self._base)
        self._link.listen(self._received)
        self._calibration = self._board.calibrate(self._slot)
        self._running = True
        self._thread = threading.Thread(target=self._check, name="netcanoem", daemon=True)
        self._thread.start()
        if not wait_until(lambda: self._newest is not None, FIRST_S) or self._newest is None:
            raise LinkError(
                f"the sensor's board answers but sends no gauges ({self._pairs.lost} polls "
                f"lost, {self._pairs.odd} odd frames): is a second node at its ids?"
            )
        if self._newest.status & netcanoem_frames.BAD_CALIBRATION:
            raise DriverError(
                f"the sensor's board holds no calibration in slot {self._slot}: give the slot of "
                "the mounted sensor"
            )

    def _close(self) -> None:
        if self._running:
            self._running = False
            self._suspect.set()
            self._thread.join(2.0)
        if self._link is not None:
            self._link.leave(self._received)

    def _received(self, t: float, can_id: int, data: bytes) -> None:
        reply = netcanoem_frames.parse(can_id, data, self._base)
        if reply is None:
            return
        if reply.opcode not in (netcanoem_frames.GAUGES, netcanoem_frames.ODD):
            self._board.take(reply)
            return
        reading = self._pairs.take(t, reply)
        if reading is None:
            return
        self._doubt_after_silence(t)
        self._heard_at = t
        before = self._newest
        if before and reading.status & ~before.status & netcanoem_frames.WATCHDOG_RESET:
            self._doubt()
        if (calibration := self._calibration) is None:
            return
        gauges = np.array(reading.gauges, dtype=float)
        channels = (calibration.matrix[:, np.abs(gauges + 0.5) > _RAIL] != 0.0).any(axis=1)
        self._count += 1
        self._newest = sample = WrenchSample(
            reading.t, None, self._count, 0.0, True, calibration.matrix @ gauges, reading.status,
            int(channels @ (1 << np.arange(6))), self._lost + self._pairs.lost,
            faults=netcanoem_frames.faults(reading.status),
        )  # fmt: skip
        self._past.add(sample.t, sample.wrench, sample.status, sample.saturated)

    def _doubt_after_silence(self, now: float) -> None:
        if self._calibration is not None and now - self._heard_at > SILENT_S:
            self._doubt()

    def _doubt(self) -> None:
        """Publish nothing until the calibration is selected again: the board may have restarted."""
        self._calibration = None
        self._suspect.set()

    def _check(self) -> None:
        """Run in a thread: select the calibration anew after a restart of the board, and compare
        its matrix all the time to detect restarts without silence."""
        axis = 0
        while self._running:
            doubted, known = self._suspect.wait(CHECK_S), self._calibration
            if not self._running:
                return
            try:
                if doubted or known is None:
                    self._suspect.clear()
                    calibration = self._board.calibrate(self._slot)
                    self._unusable = ""
                    self._restarts += 1
                    self._heard_at = np.inf
                    if not self._suspect.is_set():
                        self._restored_at = time.monotonic()
                        self._calibration = calibration
                elif tuple(known.raw[axis]) != self._board.row(axis):
                    self._doubt()
                axis = (axis + 1) % 6
            except DriverError as error:
                if self._calibration is None:
                    self._suspect.set()
                self._unusable = "" if isinstance(error, LinkError) else str(error)
                time.sleep(_AGAIN_S)

    def _read(self) -> WrenchSample:
        newest = self._newest
        if newest is None:
            raise LinkError("the sensor has sent no reading yet")
        return replace(newest, lost=self._lost + self._pairs.lost)

    def _health(self) -> Health:
        now, newest, link = time.monotonic(), self._newest, self._link
        counters = {
            "readings": float(self._count), "lost": float(self._pairs.lost),
            "odd frames": float(self._pairs.odd), "calibrations": 1.0 + self._restarts,
        }  # fmt: skip
        age = now - newest.t if newest else np.inf
        if link is None or link.dead:
            why = link.dead if link else "it is not open"
            return Health("lost", f"CAN bus of the sensor: {why}", counters)
        if self._pairs.clash(now):
            ids = f"0x{self._base << 4:03X}"
            why = f"a second node answers at the sensor's ids {ids} …: move one of them"
            return Health("fault", why, counters)
        if self._unusable:
            return Health("fault", self._unusable, counters)
        if newest and newest.status & netcanoem_frames.CRITICAL and age < GONE_S:
            words = ", ".join(netcanoem_frames.faults(newest.status & netcanoem_frames.CRITICAL))
            return Health("fault", f"the sensor's board reports: {words}", counters)
        doubtful = self._calibration is None or (newest and newest.t < self._restored_at)
        if doubtful and age < GONE_S:
            why = "the sensor's board fell silent: its calibration is being selected anew"
            return Health("stale", why, counters)
        return by_age(float(age), "sensor", counters)
