"""The CAN wire: one frame at a time, the lowest id first, each as long as its bits take.

Every sender transmits its frames in order. Where several senders wait, the lowest id wins (ISO
11898-1, arbitration). Time is an argument; nothing here waits.

Length of a classic frame in bits (ISO 11898-1): from start of frame to the end of the CRC, five
equal bits are followed by a stuff bit of the other value. Delimiters, acknowledge, end of frame
(10 bits) and intermission (3) are not stuffed. CRC and stuffing use tables of a byte.
"""

from collections import deque
from functools import lru_cache
from typing import NamedTuple

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


QUEUE = 512
"""Frames that a sender may have waiting; more are dropped and counted, as a full driver does."""
_SLICE_S = 0.05
_SLICES = 20


class Frame(NamedTuple):
    """A frame: id, data, whether the id has 29 bits, and whether it only asks for data."""

    can_id: int
    data: bytes
    extended: bool = False
    remote: bool = False

    @property
    def bits(self) -> int:
        """Its length on the wire."""
        return exact(self.can_id, self.data, self.extended)

    @property
    def rank(self) -> int:
        """The lower, the earlier on the wire; an 11-bit id wins over a 29-bit one it begins."""
        return self.can_id if self.extended else self.can_id << 18


class Sent(NamedTuple):
    """What the wire carried: when it ended [s], who sent it, and whether an error destroyed it."""

    end: float
    sender: int
    frame: Frame
    spoiled: bool


class WireLoad:
    """Bits of the last second."""

    def __init__(self, bitrate: int) -> None:
        self.bitrate = bitrate
        self._slices: deque[tuple[int, int]] = deque(maxlen=_SLICES)

    def add(self, t: float, bits: int) -> None:
        """Bits that ended at a time [s]."""
        number = int(t / _SLICE_S)
        if self._slices and self._slices[-1][0] == number:
            self._slices[-1] = (number, self._slices[-1][1] + bits)
        else:
            self._slices.append((number, bits))

    def share(self, t: float) -> float:
        """Share of the wire's capacity that the second before a time [s] used."""
        now = int(t / _SLICE_S)
        bits = sum(b for n, b in self._slices if now - _SLICES < n <= now)
        return bits / (self.bitrate * _SLICES * _SLICE_S)


class BusArbiter:
    """Frames that wait for the wire, and the order and times at which they leave it.

    Args:
        bitrate: [bit/s].
    """

    def __init__(self, bitrate: int) -> None:
        self.load = WireLoad(bitrate)
        self.dropped = 0
        self.errors = 0
        self._waiting: dict[int, deque[tuple[float, Frame]]] = {}
        self._free = 0.0
        self._spoil = 0

    def offer(self, t: float, sender: int, frame: Frame) -> None:
        """A sender wants to send a frame from a time on [s]."""
        queue = self._waiting.setdefault(sender, deque())
        if len(queue) >= QUEUE:
            self.dropped += 1
        else:
            queue.append((t, frame))

    def spoil(self, count: int) -> None:
        """Destroy the next transmissions by an error frame; their senders repeat them."""
        self._spoil += count

    @property
    def spoiling(self) -> bool:
        """Whether the next transmission will be destroyed."""
        return self._spoil > 0

    def forget(self, sender: int) -> None:
        """A sender is gone, and what it had waiting."""
        self._waiting.pop(sender, None)

    def due(self) -> float | None:
        """When the next transmission can begin [s], None where nothing waits."""
        heads = [queue[0][0] for queue in self._waiting.values() if queue]
        return max(self._free, min(heads)) if heads else None

    def transmit(self, now: float) -> Sent | None:
        """The next transmission, if one began by now; contenders after its begin come later."""
        begin = self.due()
        if begin is None or begin > now:
            return None
        sender = min(
            (s for s, queue in self._waiting.items() if queue and queue[0][0] <= begin),
            key=lambda s: self._waiting[s][0][1].rank,
        )
        spoiled = self._spoil > 0
        frame = self._waiting[sender][0][1]
        bits = frame.bits
        if spoiled:
            self._spoil -= 1
            self.errors += 1
            bits = bits // 2 + ERROR_BITS
        else:
            self._waiting[sender].popleft()
        self._free = begin + bits / self.load.bitrate
        self.load.add(self._free, bits)
        return Sent(self._free, sender, frame, spoiled)
