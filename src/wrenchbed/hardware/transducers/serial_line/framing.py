"""Frames of a fixed size in a stream of bytes that may lose, add and change some.

A frame begins with its header and is believed when its check holds. Where the check fails, the
search goes on one byte later, not behind the frame: header bytes inside data, or a frame that lost
a byte, cost no other frame.
"""

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class FrameShape:
    """How frames look.

    Attributes:
        header: first bytes, one at least.
        size: of a whole frame [bytes].
        holds: whether the check of a whole frame holds.
    """

    header: bytes
    size: int
    holds: Callable[[bytes], bool]


class Framer:
    """Finds frames however the stream is cut into pieces.

    Attributes:
        frames: found so far.
        skipped: bytes that belong to no frame.
        damaged: frames that were lost, as far as the bytes between good frames tell; those before
            the first frame do not count, since the stream was joined in mid-frame.
    """

    def __init__(self, shape: FrameShape) -> None:
        self._shape = shape
        self._kept = bytearray()
        self._run = 0
        self.frames = self.skipped = self.damaged = 0

    @property
    def waiting(self) -> int:
        """Bytes that are kept because a frame may begin in them; less than one frame."""
        return len(self._kept)

    def feed(self, data: bytes) -> list[bytes]:
        """Take the next bytes; the frames that they complete, oldest first."""
        shape, kept = self._shape, self._kept
        kept += data
        found: list[bytes] = []
        at = 0
        while True:
            begin = kept.find(shape.header, at)
            if begin < 0:
                begin = len(kept) - self._tail(kept, at)
                self._skip(begin - at)
                at = begin
                break
            self._skip(begin - at)
            at = begin
            if len(kept) - at < shape.size:
                break
            frame = bytes(kept[at : at + shape.size])
            if shape.holds(frame):
                found.append(frame)
                self._good()
                at += shape.size
            else:
                self._skip(1)
                at += 1
        del kept[:at]
        return found

    def clear(self) -> None:
        """Forget what is kept, as after a pause of the stream."""
        self._kept.clear()
        self._run = 0

    def _tail(self, kept: bytearray, at: int) -> int:
        """Length of the beginning of a header at the end of the bytes from ``at`` on."""
        header = self._shape.header
        longest = min(len(header) - 1, len(kept) - at)
        return next((n for n in range(longest, 0, -1) if kept.endswith(header[:n])), 0)

    def _skip(self, count: int) -> None:
        self.skipped += count
        self._run += count

    def _good(self) -> None:
        if self.frames:
            self.damaged += (self._run + self._shape.size // 2) // self._shape.size
        self.frames += 1
        self._run = 0
