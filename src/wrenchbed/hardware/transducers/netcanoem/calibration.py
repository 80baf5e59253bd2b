"""Queries to the board, each with a deadline, and the calibration from its answers."""

import threading
import time
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from wrenchbed.errors import DriverError, LinkError
from wrenchbed.hardware.transducers.netcanoem import frames
from wrenchbed.hardware.transducers.netcanoem.link import CanLink

ANSWER_S, TRIES = 0.3, 3
"""Deadline of an answer [s] and attempts at a query; estimates."""
FORCE = {1: 4.4482216152605, 2: 1.0, 3: 4448.2216152605, 4: 1e3, 5: 9.80665, 6: 9.80665e-3}
"""Code of a unit → N: lbf, N, klbf, kN, kgf, gf."""
TORQUE = {1: 0.1129848290276167, 2: 1.3558179483314004, 3: 1.0, 4: 1e-3, 5: 0.0980665, 6: 1e3}
"""Code of a unit → N·m: lbf·in, lbf·ft, N·m, N·mm, kgf·cm, kN·m."""
_REPORTS_UNITS = (3, 7)
"""Firmware from which counts and units are queried; estimate."""
_DEFAULT_COUNTS = 1_000_000
"""Counts per unit of older firmware; estimate."""
Answer = TypeVar("Answer")


@dataclass(frozen=True, eq=False)
class GaugeCalibration:
    """Conversion of gauge counts to SI.

    Attributes:
        raw: matrix (6, 6) as the board holds it.
        matrix: gauge counts to N and N·m (6, 6).
        serial: of the sensor.
        firmware: of the board.
    """

    raw: np.ndarray
    matrix: np.ndarray
    serial: str
    firmware: frames.Firmware


class BoardQueries:
    """Queries of one board, one at a time.

    Args:
        link: the bus.
        base: upper seven bits of the board's ids.
    """

    def __init__(self, link: CanLink, base: int) -> None:
        self._link, self._base = link, base
        self._came = threading.Condition()
        self._answers: list[frames.Reply] = []
        self._asking = threading.Lock()

    def take(self, reply: frames.Reply) -> None:
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
        firmware = self._ask(frames.FIRMWARE, b"", frames.Firmware)
        serial = self._ask(frames.SERIAL, b"", frames.Serial).text
        active = self._ask(frames.SELECT, bytes([slot]), frames.ActiveCalibration)
        if active.slot != slot:
            raise DriverError(f"the sensor's board selected calibration {active.slot}, not {slot}")
        raw = self._matrix()
        counts = frames.Counts(_DEFAULT_COUNTS, _DEFAULT_COUNTS)
        units = frames.Units(2, 3)
        if (firmware.major, firmware.minor) >= _REPORTS_UNITS:
            counts = self._ask(frames.COUNTS, b"", frames.Counts)
            units = self._ask(frames.UNITS, b"", frames.Units)
        return GaugeCalibration(raw, _si(raw, counts, units, slot), serial, firmware)

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
        parts = self._collect(frames.MATRIX, bytes([axis]), frames.Coefficients, 3)
        by_part = {part.part: part.values for part in parts}
        if sorted(by_part) != [0, 1, 2]:
            raise LinkError("the sensor's board sent a matrix row in pieces that do not fit")
        return by_part[0] + by_part[1] + by_part[2]

    def _ask(self, opcode: int, data: bytes, kind: type[Answer]) -> Answer:
        return self._collect(opcode, data, kind, 1)[0]

    def _collect(self, opcode: int, data: bytes, kind: type[Answer], n: int) -> list[Answer]:
        with self._asking:
            for tries in range(TRIES):
                with self._came:
                    self._answers.clear()
                self._link.send(self._base << 4 | opcode, data)
                answers = self._wait(kind, n, ANSWER_S)
                if len(answers) >= n:
                    if tries:  # a late answer to the try before would pass for the next one's
                        self._wait(kind, (tries + 1) * n, ANSWER_S)
                    return answers[:n]
        raise LinkError(
            f"no answer of the sensor's board to opcode 0x{opcode:X} at base 0x{self._base:02X}: "
            "check its base address, bit rate, power and bus termination"
        )

    def _wait(self, kind: type[Answer], n: int, seconds: float) -> list[Answer]:
        deadline = time.monotonic() + seconds
        with self._came:
            while True:
                answers: list[Answer] = [a for a in self._answers if isinstance(a, kind)]
                remaining = deadline - time.monotonic()
                if len(answers) >= n or remaining <= 0.0:
                    return answers
                self._came.wait(remaining)


def _si(raw: np.ndarray, counts: frames.Counts, units: frames.Units, slot: int) -> np.ndarray:
    """Gauge counts to N and N·m (6, 6).

    Raises:
        DriverError: a matrix, counts or units that make no sense.
    """
    usable = np.isfinite(raw).all() and np.abs(raw).max() < 1e12
    if not usable or np.linalg.matrix_rank(raw / max(np.abs(raw).max(), 1e-30)) < 6:
        raise DriverError(f"calibration {slot} of the sensor's board holds no usable matrix")
    if not counts.force or not counts.torque:
        raise DriverError(f"calibration {slot} of the sensor's board has 0 counts per unit")
    if units.force not in FORCE or units.torque not in TORQUE:
        raise DriverError(
            f"the sensor's board names units {units.force} and {units.torque}, which do not exist"
        )
    scale = [FORCE[units.force] / counts.force] * 3 + [TORQUE[units.torque] / counts.torque] * 3
    return np.asarray(np.array(scale)[:, None] * raw)
