"""Packets of the stream: 0x20 0x4E, six int16 low byte first, CRC-16/MODBUS low byte first.

Source: Robotiq FT 150/300 instruction manual (2016), p. 44; FT 300-S manual, p. 34: data stream.
"""

import struct

import numpy as np

from wrenchbed.hardware.transducers.serial_line.checksums import crc16_modbus
from wrenchbed.hardware.transducers.serial_line.framing import FrameShape

HEADER, SIZE = b"\x20\x4e", 16
RATE = 100.0
"""Packets per second [Hz]; source: as above."""
PER_SI = np.array([100.0, 100.0, 100.0, 1000.0, 1000.0, 1000.0])
"""Counts per newton and newton metre; source: as above."""
_COUNTS = struct.Struct("<2x6h2x")
_CHECK = struct.Struct("<14xH")


def holds(packet: bytes) -> bool:
    """Whether the check of 16 bytes holds."""
    return bool(_CHECK.unpack(packet)[0] == crc16_modbus(packet[:-2]))


SHAPE = FrameShape(HEADER, SIZE, holds)


def wrench(packet: bytes) -> np.ndarray:
    """Forces and moments (6,) of a packet [N, N·m]."""
    return np.array(_COUNTS.unpack(packet), dtype=float) / PER_SI
