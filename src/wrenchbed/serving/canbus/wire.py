"""The wire: one frame at a time, the lowest id first, each as long as its bits take.

Every sender puts its frames on the wire in its own order; where several senders wait, the lowest
id wins (ISO 11898-1 arbitration). Time is passed in, nothing here waits.
"""

from collections import deque
from typing import NamedTuple

from wrenchbed.serving.canbus.bits import ERROR_BITS, exact

QUEUE = 512
"""Frames that a sender may have waiting; more are dropped and counted, as a full driver does."""
_SLICE_S = 0.05
_SLICES = 20


class Frame(NamedTuple):
    """A data frame: id, data, whether the id has 29 bits."""

    can_id: int
    data: bytes
    extended: bool = False

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


class Load:
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


class Wire:
    """Frames that wait for the wire, and the order and times at which they leave it.

    Args:
        bitrate: [bit/s].
    """

    def __init__(self, bitrate: int) -> None:
        self.load = Load(bitrate)
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
