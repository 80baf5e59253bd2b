"""Frames of the stream: 0xAA, 34 bytes of data, CRC-16/X-25 of the data; all low byte first.

The data are status (uint16), six float32 [N, N·m], time stamp (uint32 [µs]) and temperature
(float32 [°C]). Source: the maker's ROS driver (rokubimini_serial) and Python example.
"""

import struct

import numpy as np

from wrenchbed.hardware.transducers.serial_line.checksums import crc16_x25
from wrenchbed.hardware.transducers.serial_line.framing import FrameShape
from wrenchbed.hardware.transducers.serial_line.transducer import Decoded

HEADER, SIZE = b"\xaa", 37
STAMP_HZ = 1e6
"""Counts of the time stamp in a second [Hz]; source: as above."""
_DATA = struct.Struct("<xH6fI6x")
_TEMPERATURE = struct.Struct("<31xf2x")
_CHECK = struct.Struct("<35xH")
STATUS = {
    0: "readings are skipped: raise sinc",
    1: "out of range",
    2: "readings are invalid",
    3: "raw gage values, no forces: its calibration is switched off",
}
"""Bit of the status word → what it means; source: as above."""
SKIPPED, OVER, INVALID, RAW = 1, 2, 4, 8


def holds(frame: bytes) -> bool:
    """Whether the check of 37 bytes holds."""
    return bool(_CHECK.unpack(frame)[0] == crc16_x25(frame[1:-2]))


SHAPE = FrameShape(HEADER, SIZE, holds)


def decoded(frame: bytes) -> Decoded:
    """Wrench (6,) [N, N·m], status word and time stamp [µs] of a frame."""
    status, *wrench, stamp = _DATA.unpack(frame)
    return Decoded(np.array(wrench), status, stamp)


def temperature(frame: bytes) -> float:
    """Of the sensor [°C]."""
    return float(_TEMPERATURE.unpack(frame)[0])


def faults(status: int) -> tuple[str, ...]:
    """Meaning of a status word."""
    words = tuple(word for bit, word in STATUS.items() if status >> bit & 1)
    unknown = status & ~sum(1 << bit for bit in STATUS)
    return (*words, f"unknown bits 0x{unknown:04x}") if unknown else words
