"""The SDO server: expedited writing, expedited and segmented reading; all else is refused.

One transfer at a time; a new request ends the one before. A client that stays away for `PATIENCE_S`
gets an abort. Source: CiA 301, 7.2.4.3 (protocols of SDO).
"""

import struct
from collections.abc import Callable
from dataclasses import dataclass

from robot_emulators.canopen.dictionary import Abort, AbortError, Key, Objects

PATIENCE_S = 2.0
"""Longest pause of a client within a transfer [s]. CiA 301 states none; shorter than that, the
client of `canopen`, which waits 0.3 s and repeats, could lose a transfer on a busy machine."""
_PART = 7
"""Data bytes of a segment."""
_EXPEDITED = 4
"""Data bytes of an expedited transfer."""


@dataclass
class _Upload:
    """A segmented transfer of an object to the client: data still to send, and the toggle bit of
    the next segment."""

    key: Key
    data: bytes
    toggle: int = 0


class SdoServer:
    """Answers the requests of a client."""

    def __init__(
        self, objects: Objects, locked: Callable[[Key], None], written: Callable[[Key], None]
    ) -> None:
        self._objects, self._locked, self._written = objects, locked, written
        self._transfer: _Upload | None = None
        self._due = 0.0

    def answer(self, t: float, request: bytes) -> list[bytes]:
        """Frames that answer a request of 8 bytes at a time [s]."""
        if len(request) < 8:
            return []
        self._due = t + PATIENCE_S
        try:
            match request[0] >> 5:
                case 1:
                    return [self._download(request)]
                case 2:
                    return [self._begin_upload(request)]
                case 3:
                    return [self._give_segment(request)]
                case 4:
                    self._transfer = None
                    return []
            raise AbortError(Abort.COMMAND)
        except AbortError as abort:
            return [self._aborted(struct.unpack_from("<HB", request, 1), abort.code)]

    def expired(self, t: float) -> list[bytes]:
        """The abort of a transfer whose client stayed away, at a time [s]."""
        if self._transfer is None or t < self._due:
            return []
        return [self._aborted(self._transfer.key, Abort.TIMEOUT)]

    def _aborted(self, key: Key, code: int) -> bytes:
        """The abort frame; it ends the transfer under way, whose key it names."""
        if self._transfer is not None:
            key, self._transfer = self._transfer.key, None
        return struct.pack("<BHBI", 0x80, *key, code)

    def _download(self, request: bytes) -> bytes:
        self._transfer = None
        key = struct.unpack_from("<HB", request, 1)
        entry = self._objects.entry(key)
        if not entry.writable:
            raise AbortError(Abort.READ_ONLY)
        self._locked(key)
        expedited, sized = request[0] & 0x02, request[0] & 0x01
        if not expedited:  # no object is longer
            raise AbortError(Abort.LENGTH_HIGH)
        unused = request[0] >> 2 & 3 if sized else _EXPEDITED - entry.size
        entry.value = entry.parsed(request[4 : 8 - unused])
        self._written(key)
        return struct.pack("<BHB4x", 0x60, *key)

    def _begin_upload(self, request: bytes) -> bytes:
        self._transfer = None
        key = struct.unpack_from("<HB", request, 1)
        entry = self._objects.entry(key)
        if entry.access == "wo":
            raise AbortError(Abort.WRITE_ONLY)
        raw = entry.raw()
        if 0 < len(raw) <= _EXPEDITED:
            first = 0x43 | (_EXPEDITED - len(raw)) << 2
            return struct.pack("<BHB", first, *key) + raw.ljust(4, b"\0")
        self._transfer = _Upload(key, raw)
        return struct.pack("<BHBI", 0x41, *key, len(raw))

    def _give_segment(self, request: bytes) -> bytes:
        transfer = self._transfer
        if transfer is None:
            raise AbortError(Abort.COMMAND)
        if request[0] >> 4 & 1 != transfer.toggle:
            raise AbortError(Abort.TOGGLE)
        part, transfer.data = transfer.data[:_PART], transfer.data[_PART:]
        last = not transfer.data
        if last:
            self._transfer = None
        first = transfer.toggle << 4 | (_PART - len(part)) << 1 | last
        transfer.toggle ^= 1
        return bytes([first]) + part.ljust(_PART, b"\0")
