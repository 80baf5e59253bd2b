"""What a NETCANOEM board sends, frame by frame. Source: ATI 9610-05-1030, sections 7 and 10.

`parse` takes anything that a bus may carry: what is no reply of this board is None.
"""

import struct
from dataclasses import dataclass

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
class Active:
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


Reply = EvenGauges | OddGauges | Coefficients | Serial | Active | Counts | Units | Firmware


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
            return Active(data[0])
        case 0x7, 8:
            return Counts(*struct.unpack(">II", data))
        case 0x8, 2:
            return Units(data[0], data[1])
        case 0xF, 4:
            return Firmware(*struct.unpack(">BBH", data))
    return None


def faults(status: int) -> tuple[str, ...]:
    """What a status word says, in words."""
    return tuple(name for bit, name in enumerate(STATUS[:15]) if name and status >> bit & 1) or (
        ("error without a name",) if status >> 15 & 1 else ()
    )
