"""Frames of a NETCANOEM board, and gauge readings of two frames each.

Source: ATI 9610-05-1030, sections 7 and 10. The frames carry no number, so at most one request is
under way. One without a complete answer is given up after `PATIENCE_S`; frames that still arrive
until the next request are dropped.
"""

import struct
from dataclasses import dataclass
from typing import NamedTuple

GAUGES, MATRIX, SERIAL, SELECT, COUNTS, UNITS, FIRMWARE = 0x0, 0x2, 0x5, 0x6, 0x7, 0x8, 0xF
"""Opcodes of the requests that are ever sent. Reset (0xC), set base (0xD) and set baud rate (0xE)
are left out on purpose: the last two stay after power is cut."""

STATUS = (
    "watchdog reset", "converter high", "converter low", "artificial ground", "supply high",
    "supply low", "bad active calibration", "EEPROM", "configuration invalid", "", "",
    "temperature high", "temperature low", "", "CAN bus error", "any error",
)  # fmt: skip
"""Meaning of each bit of the status word."""
CRITICAL = 0b0001_1000_1111_1110
"""Bits with which readings cannot be trusted; the board sends them all the same."""
BAD_CALIBRATION, WATCHDOG_RESET = 1 << 6, 1 << 0


@dataclass(frozen=True)
class EvenGauges:
    """First frame of a reading: status word and gauges 0, 2, 4."""

    status: int
    values: tuple[int, int, int]


@dataclass(frozen=True)
class OddGauges:
    """Second frame of a reading: gauges 1, 3, 5."""

    values: tuple[int, int, int]


@dataclass(frozen=True)
class Coefficients:
    """A third of a matrix row: which, and its two values."""

    part: int
    values: tuple[float, float]


@dataclass(frozen=True)
class Serial:
    """Serial number of the sensor."""

    text: str


@dataclass(frozen=True)
class ActiveCalibration:
    """Calibration that is active now."""

    slot: int


@dataclass(frozen=True)
class Counts:
    """Counts per unit of force and of torque."""

    force: int
    torque: int


@dataclass(frozen=True)
class Units:
    """Codes of the units of force and of torque."""

    force: int
    torque: int


@dataclass(frozen=True)
class Firmware:
    """Version of the board's program."""

    major: int
    minor: int
    build: int


Reply = (
    EvenGauges | OddGauges | Coefficients | Serial | ActiveCalibration | Counts | Units | Firmware
)


def parse(arbitration_id: int, data: bytes, base: int) -> Reply | None:
    """The reply that a frame of an 11-bit id is, None if it is none of the board at ``base``."""
    if arbitration_id >> 4 != base:
        return None
    match arbitration_id & 0xF, len(data):
        case 0x0, 8:
            status, a, b, c = struct.unpack(">Hhhh", data)
            return EvenGauges(status, (a, b, c))
        case 0x1, 6:
            a, b, c = struct.unpack(">hhh", data)
            return OddGauges((a, b, c))
        case (0x2 | 0x3 | 0x4) as opcode, 8:
            x, y = struct.unpack(">ff", data)
            return Coefficients(opcode - 0x2, (x, y))
        case 0x5, 8:
            return Serial(data.split(b"\0")[0].decode("ascii", "replace").strip())
        case 0x6, 1:
            return ActiveCalibration(data[0])
        case 0x7, 8:
            return Counts(*struct.unpack(">II", data))
        case 0x8, 2:
            return Units(data[0], data[1])
        case 0xF, 4:
            return Firmware(*struct.unpack(">BBH", data))
    return None


def faults(status: int) -> tuple[str, ...]:
    """Meaning of a status word."""
    return tuple(name for bit, name in enumerate(STATUS[:15]) if name and status >> bit & 1) or (
        ("error without a name",) if status >> 15 & 1 else ()
    )


PATIENCE_S = 0.02
"""How long the two frames of an answer may take [s]; estimate; on the wire they take
0.3 ms at 1 Mbit/s."""
_OUTSTANDING = 250
"""Requests that may still be answered; estimate."""
_EXCESS_S, _EXCESS = 1.0, 2
"""Time [s] and number of unrequested answers that reveal a second node; estimates."""


class GaugeReading(NamedTuple):
    """A complete reading: arrival of its first frame [s], status word, gauges 0 … 5."""

    t: float
    status: int
    gauges: tuple[int, ...]


class Pairs:
    """Combines the two frames of a reading, and counts what it drops.

    Attributes:
        lost: requests without a complete answer.
        odd: frames that belong to no request or came in the wrong order.
    """

    def __init__(self) -> None:
        self.polls = self.lost = self.odd = 0
        self._first: tuple[float, EvenGauges] | None = None
        self._waiting = False
        self._outstanding = 0
        self._asked = 0.0
        self._excess: list[float] = []

    def poll(self, t: float) -> bool:
        """Whether to send a request at a time [s]."""
        if self._waiting:
            if t - self._asked > PATIENCE_S:
                self.lost += 1
                self._waiting, self._first = False, None
            return False
        self.polls += 1
        self._waiting, self._first, self._asked = True, None, t
        self._outstanding = min(self._outstanding + 1, _OUTSTANDING)
        return True

    def take(self, t: float, frame: EvenGauges | OddGauges) -> GaugeReading | None:
        """A frame that arrived at a time [s]; the reading that it completes."""
        if isinstance(frame, EvenGauges):
            self._count(t)
            if not self._waiting or self._first is not None:
                self.odd += 1
            if self._waiting:
                self._first = (t, frame)
            return None
        if self._first is None:
            self.odd += 1
            return None
        begun, first = self._first
        self._waiting, self._first = False, None
        (g0, g2, g4), (g1, g3, g5) = first.values, frame.values
        return GaugeReading(begun, first.status, (g0, g1, g2, g3, g4, g5))

    def clash(self, t: float) -> bool:
        """Whether there were more answers than requests: a second node uses the board's ids."""
        return sum(t - when < _EXCESS_S for when in self._excess) >= _EXCESS

    def _count(self, t: float) -> None:
        if self._outstanding > 0:
            self._outstanding -= 1
        else:
            self._excess = [*self._excess[-_EXCESS:], t]
