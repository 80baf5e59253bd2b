"""How long a classic CAN frame is on the wire, in bits (ISO 11898-1).

Between start of frame and the end of the CRC, five equal bits are followed by a stuff bit of the
other value. Delimiters, acknowledge, end of frame (10 bits) and intermission (3) are not stuffed.
Both the CRC and the stuffing go through tables of a byte.
"""

from functools import lru_cache

_POLYNOMIAL = 0x4599
_TAIL = 13
ERROR_BITS = 23
"""Longest error frame: 12 bits of superposed flags, 8 of delimiter, 3 of intermission."""


def _crc_table() -> tuple[int, ...]:
    table = []
    for byte in range(256):
        crc = byte << 7
        for _ in range(8):
            crc = ((crc << 1) ^ _POLYNOMIAL if crc & 0x4000 else crc << 1) & 0x7FFF
        table.append(crc)
    return tuple(table)


def _run(state: int, bits: int, width: int) -> tuple[int, int]:
    """State (value of the last bit << 3 | its run) and stuff bits after ``width`` more bits."""
    value, run, stuffed = state >> 3, state & 7, 0
    for k in reversed(range(width)):
        bit = bits >> k & 1
        run = run + 1 if bit == value else 1
        value = bit
        if run == 5:
            stuffed += 1
            value, run = 1 - bit, 1
    return value << 3 | run, stuffed


_CRC = _crc_table()
_STUFF = tuple(tuple(_run(state, byte, 8) for byte in range(256)) for state in range(16))
_IDLE = 1 << 3


def header(can_id: int, length: int, extended: bool = False) -> tuple[int, int]:
    """Start of frame to data length code of a data frame: its bits and how many they are."""
    if not extended:
        return (can_id & 0x7FF) << 7 | length, 19
    first = (can_id >> 18 & 0x7FF) << 2 | 0b11
    return (first << 18 | can_id & 0x3FFFF) << 7 | length, 39


def crc15(bits: int, width: int) -> int:
    """CRC of the frame up to its data; leading zeros do not change it."""
    crc = 0
    for byte in bits.to_bytes((width + 7) // 8, "big"):
        crc = (crc << 8 ^ _CRC[crc >> 7 ^ byte]) & 0x7FFF
    return crc


def unstuffed(length: int, extended: bool = False) -> int:
    """Bits of a frame of some data bytes, without stuff bits."""
    return (54 if extended else 34) + 8 * length + _TAIL


def worst(length: int, extended: bool = False) -> int:
    """Most bits that a frame of some data bytes can take."""
    stuffable = (54 if extended else 34) + 8 * length
    return stuffable + (stuffable - 1) // 4 + _TAIL


@lru_cache(maxsize=4096)
def exact(can_id: int, data: bytes, extended: bool = False) -> int:
    """Bits of this very data frame, with its stuff bits and the intermission after it."""
    head, width = header(can_id, len(data), extended)
    bits = head << 8 * len(data) | int.from_bytes(data, "big")
    width += 8 * len(data)
    bits, width = bits << 15 | crc15(bits, width), width + 15
    odd = width % 8
    state, stuffed = _run(_IDLE, bits >> (width - odd), odd)
    for byte in (bits & (1 << (width - odd)) - 1).to_bytes(width // 8, "big"):
        state, more = _STUFF[state][byte]
        stuffed += more
    return width + stuffed + _TAIL
