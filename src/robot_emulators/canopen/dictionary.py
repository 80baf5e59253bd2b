"""The object dictionary of a CANopen node, as its electronic data sheet (EDS) defines it, and the
server that clients read and write it by.

SDO: expedited writing, expedited and segmented reading, one transfer at a time.
Sources: CiA 301 (data types 7.1.6, SDO 7.2.4.3, object dictionary 7.4); CiA 306-1 (EDS).
"""

import configparser
import enum
import functools
import re
import struct
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

Key = tuple[int, int]
"""Index and subindex of an object."""
_TYPES = {
    0x02: (1, True), 0x03: (2, True), 0x04: (4, True), 0x05: (1, False), 0x06: (2, False),
    0x07: (4, False), 0x09: (0, False),
}  # fmt: skip
"""Number of a CiA 301 data type → its size [byte], 0 for text, and whether it has a sign."""
_SECTION = re.compile(r"([0-9A-Fa-f]{4})(?:sub([0-9A-Fa-f]{1,2}))?")
_PART = 7
"""Data bytes of one segment of an SDO transfer."""
_EXPEDITED = 4
"""Most data bytes of an expedited SDO transfer."""


class Abort(enum.IntEnum):
    """Abort codes of CANopen (CiA 301): why a node refuses to read or write an object by SDO."""

    TOGGLE = 0x05030000
    COMMAND = 0x05040001
    WRITE_ONLY = 0x06010001
    READ_ONLY = 0x06010002
    NO_OBJECT = 0x06020000
    NOT_MAPPABLE = 0x06040041
    TOO_LONG = 0x06040042
    LENGTH_HIGH = 0x06070012
    LENGTH_LOW = 0x06070013
    NO_SUBINDEX = 0x06090011
    VALUE = 0x06090030
    VALUE_HIGH = 0x06090031
    VALUE_LOW = 0x06090032
    STATE = 0x08000022


class AbortError(Exception):
    """A CANopen node refuses to read or write an object by SDO; ``code``: CiA 301's abort code."""

    def __init__(self, code: int) -> None:
        super().__init__(f"0x{code:08X}")
        self.code = int(code)


@dataclass
class Entry:
    """One value of a CANopen node's object dictionary, with its type and limits.

    Attributes:
        size: bytes of a number, 0 for a text.
        signed: whether the number has a sign.
        access: ``ro``, ``rw``, ``wo`` or ``const``.
        mapped: whether a PDO, a message without request, may carry it.
        default: value after a reset, a number or the bytes of a text.
        low: smallest number that may be written, None where its type decides.
        high: largest number that may be written, None where its type decides.
        check: called with a number before it is written; raises `AbortError` to refuse it.
        value: the present value.
    """

    size: int
    signed: bool
    access: str
    mapped: bool
    default: int | bytes
    low: int | None = None
    high: int | None = None
    check: Callable[[int], None] | None = None
    value: int | bytes = field(init=False)

    def __post_init__(self) -> None:
        self.value = self.default

    @property
    def writable(self) -> bool:
        return self.access in ("rw", "wo")

    def parsed(self, raw: bytes) -> int:
        """Decode little-endian bytes from the bus to a number that may be written to this entry.
        Raises an `AbortError` for a wrong length or a value that is not allowed.
        """
        if len(raw) != self.size:
            raise AbortError(Abort.LENGTH_HIGH if len(raw) > self.size else Abort.LENGTH_LOW)
        value = int.from_bytes(raw, "little", signed=self.signed)
        if self.high is not None and value > self.high:
            raise AbortError(Abort.VALUE_HIGH)
        if self.low is not None and value < self.low:
            raise AbortError(Abort.VALUE_LOW)
        if self.check is not None:
            self.check(value)
        return value

    def raw(self) -> bytes:
        """Return the present value of this entry as bytes for the bus, little endian."""
        if isinstance(self.value, bytes):
            return self.value
        return (self.value % (1 << 8 * self.size)).to_bytes(self.size, "little")


class Objects:
    """Object dictionary of a CANopen node: (index, subindex) → number. It is built from the
    ``text`` of an EDS file (data sheet), in which the id ``node`` replaces ``$NODEID``."""

    def __init__(self, text: str, node: int) -> None:
        sheet = _parsed(text)
        self._entries: dict[Key, Entry] = {}
        for title in sheet.sections():
            numbers = _SECTION.fullmatch(title)
            if numbers and "DataType" in sheet[title]:
                key = int(numbers[1], 16), int(numbers[2] or "0", 16)
                self._entries[key] = _entry(sheet[title], node)

    def __iter__(self) -> Iterator[Key]:
        return iter(sorted(self._entries))

    def __contains__(self, key: Key) -> bool:
        return key in self._entries

    def __getitem__(self, key: Key) -> int:
        value = self._entries[key].value
        assert isinstance(value, int)
        return value

    def __setitem__(self, key: Key, value: int) -> None:
        self._entries[key].value = value

    def reset(self, area: range) -> None:
        """Set every object whose index is in ``area`` to its value after power-up."""
        for (index, _), entry in self._entries.items():
            if index in area:
                entry.value = entry.default

    def entry(self, key: Key) -> Entry:
        """Return the entry of (index, subindex) ``key``; `AbortError` if there is none."""
        entry = self._entries.get(key)
        if entry is None:
            known = any(index == key[0] for index, _ in self._entries)
            raise AbortError(Abort.NO_SUBINDEX if known else Abort.NO_OBJECT)
        return entry

    def pack(self, keys: Sequence[Key]) -> bytes:
        """Concatenate the bytes of the values of objects ``keys``, (index, subindex), in order."""
        return b"".join(self._entries[key].raw() for key in keys)


@functools.cache
def _parsed(text: str) -> configparser.RawConfigParser:
    """Parse an EDS file (CANopen data sheet) into its sections; the result is shared: do not
    change."""
    sheet = configparser.RawConfigParser()
    sheet.read_string(text)
    return sheet


def _entry(section: configparser.SectionProxy, node: int) -> Entry:
    def number(name: str) -> int | None:
        terms = section[name].split("+") if name in section else []
        return sum(node if term == "$NODEID" else int(term, 0) for term in terms) if terms else None

    size, signed = _TYPES[int(section["DataType"], 0)]
    text = section.get("DefaultValue", "")
    return Entry(
        size, signed, section["AccessType"], section["PDOMapping"] == "1",
        number("DefaultValue") or 0 if size else text.encode("ascii"),
        number("LowLimit"), number("HighLimit"),
    )  # fmt: skip


class SdoServer:
    """Answers a client's SDO requests to read and write a node's ``objects``. ``locked`` is called
    with (index, subindex) before an object is written, and may raise `AbortError` to refuse it;
    ``written`` is called with them afterwards."""

    def __init__(
        self, objects: Objects, locked: Callable[[Key], None], written: Callable[[Key], None]
    ) -> None:
        self._objects, self._locked, self._written = objects, locked, written
        self._transfer: Key | None = None
        """Object sent in segments; `_left`: its data not sent yet; `_toggle`: next toggle bit."""
        self._left, self._toggle = b"", 0

    def answer(self, request: bytes) -> list[bytes]:
        """Return the data of the response frames to a request of 8 bytes; none to a shorter one."""
        if len(request) < 8:
            return []
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

    def _aborted(self, key: Key, code: int) -> bytes:
        """Return an SDO abort frame for object ``key`` and abort code; drop the transfer under
        way."""
        if self._transfer is not None:
            key, self._transfer = self._transfer, None
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
        self._transfer, self._left, self._toggle = key, raw, 0
        return struct.pack("<BHBI", 0x41, *key, len(raw))

    def _give_segment(self, request: bytes) -> bytes:
        if self._transfer is None:
            raise AbortError(Abort.COMMAND)
        if request[0] >> 4 & 1 != self._toggle:
            raise AbortError(Abort.TOGGLE)
        part, self._left = self._left[:_PART], self._left[_PART:]
        last = not self._left
        if last:
            self._transfer = None
        first = self._toggle << 4 | (_PART - len(part)) << 1 | last
        self._toggle ^= 1
        return bytes([first]) + part.ljust(_PART, b"\0")
