"""The SDO server: expedited, segmented and block transfers.

One transfer at a time; a new request ends the one before. A client that stays away for `PATIENCE_S`
gets an abort. Source: CiA 301, 7.2.4.3 (protocols of SDO).
"""

import struct
from binascii import crc_hqx
from collections.abc import Callable

from robot_emulators.canopen.dictionary import Abort, AbortError, Entry, Key, Objects

PATIENCE_S = 2.0
"""Longest pause of a client within a transfer [s]; an estimate."""
BLOCK = 127
"""Segments of a block that the server takes at a time, the most that CiA 301 allows."""
_PART = 7
"""Data bytes of a segment."""
_EXPEDITED = 4


class _Transfer:
    """A transfer between its first and its last frame."""

    def __init__(self, key: Key, phase: str, data: bytes = b"") -> None:
        self.key, self.phase, self.data = key, phase, bytearray(data)
        self.toggle = 0
        self.begin = 0
        """First byte that is not acknowledged yet."""
        self.sequence = 0
        self.size: int | None = None
        self.block = BLOCK
        self.crc = False


class SdoServer:
    """Answers the requests of a client.

    Args:
        objects: of the node.
        locked: raises `AbortError` where an object must not be written in this state.
        written: called with a key after it was written.
    """

    def __init__(
        self, objects: Objects, locked: Callable[[Key], None], written: Callable[[Key], None]
    ) -> None:
        self._objects, self._locked, self._written = objects, locked, written
        self._transfer: _Transfer | None = None
        self._due = 0.0

    def answer(self, t: float, data: bytes) -> list[bytes]:
        """Frames that answer a request of 8 bytes at a time [s]."""
        if len(data) < 8:
            return []
        self._due = t + PATIENCE_S
        try:
            if self._transfer is not None and self._transfer.phase == "take block":
                return self._take_part(self._transfer, data)
            return self._dispatch(data)
        except AbortError as abort:
            ongoing = self._transfer
            key = struct.unpack_from("<HB", data, 1) if ongoing is None else ongoing.key
            self._transfer = None
            return [struct.pack("<BHBI", 0x80, *key, abort.code)]

    def expired(self, t: float) -> list[bytes]:
        """The abort of a transfer whose client stayed away, at a time [s]."""
        if self._transfer is None or t < self._due:
            return []
        index, sub = self._transfer.key
        self._transfer = None
        return [struct.pack("<BHBI", 0x80, index, sub, Abort.TIMEOUT)]

    def _dispatch(self, data: bytes) -> list[bytes]:
        match data[0] >> 5:
            case 0:
                return self._take_segment(data)
            case 1:
                return self._begin_download(data)
            case 2:
                return self._begin_upload(data)
            case 3:
                return self._give_segment(data)
            case 4:
                self._transfer = None
                return []
            case 5:
                return self._block_upload(data)
            case 6:
                return self._block_download(data)
        raise AbortError(Abort.COMMAND)

    def _ongoing(self, *phases: str) -> _Transfer:
        if self._transfer is None or self._transfer.phase not in phases:
            raise AbortError(Abort.COMMAND)
        return self._transfer

    def _target(self, data: bytes) -> tuple[Key, Entry]:
        """The object of a download; its existence, access and lock are checked."""
        self._transfer = None
        key = struct.unpack_from("<HB", data, 1)
        entry = self._objects.writable(key)
        self._locked(key)
        return key, entry

    def _store(self, key: Key, raw: bytes) -> None:
        entry = self._objects.writable(key)
        entry.value = entry.parsed(raw)
        self._written(key)

    def _begin_download(self, data: bytes) -> list[bytes]:
        key, entry = self._target(data)
        command = data[0]
        if command & 0x02:
            length = entry.kind.size or _EXPEDITED
            if command & 0x01:
                length = _EXPEDITED - (command >> 2 & 3)
            self._store(key, data[4 : 4 + length])
        else:
            self._transfer = transfer = _Transfer(key, "take")
            if command & 0x01:
                transfer.size = self._announced(entry, data)
        return [struct.pack("<BHB4x", 0x60, *key)]

    @staticmethod
    def _announced(entry: Entry, data: bytes) -> int:
        (size,) = struct.unpack_from("<I", data, 4)
        if entry.kind.size and size != entry.kind.size:
            raise AbortError(Abort.LENGTH_HIGH if size > entry.kind.size else Abort.LENGTH_LOW)
        return int(size)

    def _take_segment(self, data: bytes) -> list[bytes]:
        transfer = self._ongoing("take")
        if data[0] >> 4 & 1 != transfer.toggle:
            raise AbortError(Abort.TOGGLE)
        transfer.data += data[1 : 8 - (data[0] >> 1 & 7)]
        if data[0] & 1:
            self._complete(transfer)
        answer = 0x20 | transfer.toggle << 4
        transfer.toggle ^= 1
        return [bytes([answer]).ljust(8, b"\0")]

    def _complete(self, transfer: _Transfer) -> None:
        """All data are here."""
        raw, size = bytes(transfer.data), transfer.size
        if size is not None and len(raw) != size:
            raise AbortError(Abort.LENGTH_HIGH if len(raw) > size else Abort.LENGTH_LOW)
        self._store(transfer.key, raw)
        self._transfer = None

    def _begin_upload(self, data: bytes) -> list[bytes]:
        self._transfer = None
        key = struct.unpack_from("<HB", data, 1)
        return self._upload(key, self._objects.readable(key).raw())

    def _upload(self, key: Key, raw: bytes) -> list[bytes]:
        if 0 < len(raw) <= _EXPEDITED:
            first = 0x43 | (_EXPEDITED - len(raw)) << 2
            return [struct.pack("<BHB", first, *key) + raw.ljust(4, b"\0")]
        self._transfer = _Transfer(key, "give", raw)
        return [struct.pack("<BHBI", 0x41, *key, len(raw))]

    def _give_segment(self, data: bytes) -> list[bytes]:
        transfer = self._ongoing("give")
        if data[0] >> 4 & 1 != transfer.toggle:
            raise AbortError(Abort.TOGGLE)
        part = bytes(transfer.data[transfer.begin : transfer.begin + _PART])
        transfer.begin += _PART
        last = transfer.begin >= len(transfer.data)
        first = transfer.toggle << 4 | (_PART - len(part)) << 1 | last
        transfer.toggle ^= 1
        if last:
            self._transfer = None
        return [bytes([first]) + part.ljust(_PART, b"\0")]

    def _block_download(self, data: bytes) -> list[bytes]:
        if data[0] & 1:
            return self._end_download(data)
        key, entry = self._target(data)
        self._transfer = transfer = _Transfer(key, "take block")
        transfer.crc = bool(data[0] & 4)
        if data[0] & 2:
            try:
                transfer.size = self._announced(entry, data)
            except AbortError:
                self._transfer = None
                raise
        return [struct.pack("<BHBB3x", 0xA4, *key, BLOCK)]

    def _take_part(self, transfer: _Transfer, data: bytes) -> list[bytes]:
        """A segment of a block; one out of order is dropped, and the client repeats from there."""
        if data[0] == 0x80:
            self._transfer = None
            return []
        number, last = data[0] & 0x7F, bool(data[0] & 0x80)
        if number == 0:
            raise AbortError(Abort.SEQUENCE)
        if number == transfer.sequence + 1:
            transfer.data += data[1:]
            transfer.sequence = number
        complete = last and number == transfer.sequence
        if not last and number < BLOCK:
            return []
        answer = struct.pack("<BBB5x", 0xA2, transfer.sequence, BLOCK)
        transfer.sequence = 0
        if complete:
            transfer.phase = "end block"
        return [answer]

    def _end_download(self, data: bytes) -> list[bytes]:
        transfer = self._ongoing("end block")
        unused = data[0] >> 2 & 7
        if unused:
            del transfer.data[-unused:]
        (crc,) = struct.unpack_from("<H", data, 1)
        if transfer.crc and crc != crc_hqx(bytes(transfer.data), 0):
            raise AbortError(Abort.CRC)
        self._complete(transfer)
        return [bytes([0xA1]).ljust(8, b"\0")]

    def _block_upload(self, data: bytes) -> list[bytes]:
        match data[0] & 3:
            case 0:
                return self._begin_block_upload(data)
            case 1:
                self._ongoing("gave all")
                self._transfer = None
                return []
            case 2:
                return self._next_block(data)
        transfer = self._ongoing("start block")
        transfer.phase = "give block"
        return self._block(transfer)

    def _begin_block_upload(self, data: bytes) -> list[bytes]:
        self._transfer = None
        key = struct.unpack_from("<HB", data, 1)
        raw = self._objects.readable(key).raw()
        block, switch = data[4], data[5]
        if not 1 <= block <= BLOCK:
            raise AbortError(Abort.BLOCK_SIZE)
        if switch and len(raw) <= switch:
            return self._upload(key, raw)
        self._transfer = transfer = _Transfer(key, "start block", raw)
        transfer.block, transfer.crc = block, bool(data[0] & 4)
        return [struct.pack("<BHBI", 0xC6, *key, len(raw))]

    def _block(self, transfer: _Transfer) -> list[bytes]:
        """The next segments, as many as the client takes."""
        parts: list[bytes] = []
        at = transfer.begin
        while len(parts) < transfer.block:
            part = bytes(transfer.data[at : at + _PART])
            at += _PART
            last = at >= len(transfer.data)
            number = len(parts) + 1
            parts.append(bytes([last << 7 | number]) + part.ljust(_PART, b"\0"))
            if last:
                break
        transfer.sequence = len(parts)
        return parts

    def _next_block(self, data: bytes) -> list[bytes]:
        transfer = self._ongoing("give block")
        taken, block = data[1], data[2]
        if taken > transfer.sequence:
            raise AbortError(Abort.SEQUENCE)
        if not 1 <= block <= BLOCK:
            raise AbortError(Abort.BLOCK_SIZE)
        transfer.begin += taken * _PART
        transfer.block = block
        if taken and transfer.begin >= len(transfer.data):
            transfer.phase = "gave all"
            unused = (-len(transfer.data)) % _PART if transfer.data else _PART
            crc = crc_hqx(bytes(transfer.data), 0) if transfer.crc else 0
            return [struct.pack("<BH5x", 0xC1 | unused << 2, crc)]
        return self._block(transfer)
