"""The CAN wire: one frame at a time, the lowest id first, each as long as its bits take.

Every sender transmits its frames in order. Where several senders wait, the lowest id wins (ISO
11898-1, arbitration). Time is an argument; nothing here waits.
"""

import re
from collections import deque
from functools import lru_cache
from typing import NamedTuple

ERROR_BITS = 23
"""Longest error frame: 12 bits of superposed flags, 8 of delimiter, 3 of intermission."""
QUEUE = 512
"""Frames that a sender may have waiting; more are dropped and counted, as a full driver does."""
_GENERATOR = 0b1100010110011001
"""Of the CRC: x¹⁵ + x¹⁴ + x¹⁰ + x⁸ + x⁷ + x⁴ + x³ + 1; source: ISO 11898-1."""
_TAIL = 13
"""Bits after the CRC, which are not stuffed: from its delimiter to the intermission."""
_STUFFED = re.compile("0{5}(?:1{4}0{4})*(?:1{4})?|1{5}(?:0{4}1{4})*(?:0{4})?")
"""Five equal bits are followed by a stuff bit of the other value, which counts as the first of the
next five: a match of 5, 9, 13 … bits has 1, 2, 3 … stuff bits."""


def _divided(number: int) -> int:
    """Remainder of a polynomial by the CRC's."""
    while number >> 15:
        number ^= _GENERATOR << number.bit_length() - 16
    return number


_CRC = tuple(_divided(byte << 15) for byte in range(256))


@lru_cache(maxsize=4096)
def exact(can_id: int, data: bytes, extended: bool = False) -> int:
    """Bits of a data frame, with its stuff bits and the intermission after it."""
    if extended:
        bits = f"0{can_id >> 18:011b}11{can_id & 0x3FFFF:018b}000{len(data):04b}"
    else:
        bits = f"0{can_id:011b}000{len(data):04b}"
    if data:
        bits += f"{int.from_bytes(data, 'big'):0{8 * len(data)}b}"
    crc = 0  # leading zeros do not change it
    for byte in int(bits, 2).to_bytes((len(bits) + 7) // 8, "big"):
        crc = (crc << 8 ^ _CRC[crc >> 7 ^ byte]) & 0x7FFF
    bits += f"{crc:015b}"
    return len(bits) + sum((len(run) - 1) // 4 for run in _STUFFED.findall(bits)) + _TAIL


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


class BusArbiter:
    """Frames that wait for the wire, and the order and times at which they leave it.

    Args:
        bitrate: [bit/s].

    Attributes:
        dropped: frames that found `QUEUE` others of their sender waiting.
    """

    def __init__(self, bitrate: int) -> None:
        self.bitrate = bitrate
        self.dropped = 0
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
        contenders = [
            sender for sender, queue in self._waiting.items() if queue and queue[0][0] <= begin
        ]
        sender = min(contenders, key=lambda s: self._waiting[s][0][1].rank)
        frame = self._waiting[sender][0][1]
        spoiled, bits = self.spoiling, frame.bits
        if spoiled:
            self._spoil -= 1
            bits = bits // 2 + ERROR_BITS
        else:
            self._waiting[sender].popleft()
        self._free = begin + bits / self.bitrate
        return Sent(self._free, sender, frame, spoiled)
