"""The object dictionary of a CANopen node: values with type, access, range, and abort codes.

Source: CiA 301 (data types 7.1.6, abort codes 7.2.4.3.17, object dictionary 7.4).
"""

import enum
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

Key = tuple[int, int]
"""Index and subindex."""


class Abort(enum.IntEnum):
    """Why an SDO transfer ends early; source: CiA 301, table of SDO abort codes."""

    TOGGLE = 0x05030000
    TIMEOUT = 0x05040000
    COMMAND = 0x05040001
    BLOCK_SIZE = 0x05040002
    SEQUENCE = 0x05040003
    CRC = 0x05040004
    WRITE_ONLY = 0x06010001
    READ_ONLY = 0x06010002
    NO_OBJECT = 0x06020000
    NOT_MAPPABLE = 0x06040041
    TOO_LONG = 0x06040042
    INCOMPATIBLE = 0x06040043
    LENGTH = 0x06070010
    LENGTH_HIGH = 0x06070012
    LENGTH_LOW = 0x06070013
    NO_SUBINDEX = 0x06090011
    VALUE = 0x06090030
    VALUE_HIGH = 0x06090031
    VALUE_LOW = 0x06090032
    NOT_STORED = 0x08000020
    STATE = 0x08000022
    NO_DATA = 0x08000024


class AbortError(Exception):
    """An SDO transfer that the node refuses, with CiA 301's code."""

    def __init__(self, code: int) -> None:
        super().__init__(f"0x{code:08X}")
        self.code = int(code)


class DataType(NamedTuple):
    """Number of a type in an EDS file, its size [byte] (0: any) and whether it has a sign."""

    code: int
    size: int
    signed: bool = False


I8, I16, I32 = DataType(0x02, 1, True), DataType(0x03, 2, True), DataType(0x04, 4, True)
U8, U16, U32 = DataType(0x05, 1), DataType(0x06, 2), DataType(0x07, 4)
TEXT = DataType(0x09, 0)
"""Types of values; source: CiA 301, 7.4.7 (VISIBLE_STRING is `TEXT`)."""


@dataclass
class Entry:
    """One value.

    Attributes:
        name: for the EDS file.
        kind: its data type.
        value: a number, or the bytes of a text.
        access: ``ro``, ``rw``, ``wo`` or ``const``.
        mapped: whether a PDO may carry it.
        low: smallest that may be written, None where its type decides.
        high: largest, likewise.
        check: runs before it is written; raises `AbortError`.
        kept: whether 0x1010 stores it.
        of_node: whether its default contains the node's id.
    """

    name: str
    kind: DataType
    value: int | bytes
    access: str = "ro"
    mapped: bool = False
    low: int | None = None
    high: int | None = None
    check: Callable[[int], None] | None = None
    kept: bool = True
    of_node: bool = False
    default: int | bytes = field(init=False)

    def __post_init__(self) -> None:
        self.default = self.value

    @property
    def writable(self) -> bool:
        """Whether a client may write it."""
        return self.access in ("rw", "wo")

    def parsed(self, raw: bytes) -> int | bytes:
        """The value that some bytes would make it.

        Raises:
            AbortError: wrong length, or it may not have that value.
        """
        if self.kind.size == 0:
            return raw
        if len(raw) != self.kind.size:
            raise AbortError(Abort.LENGTH_HIGH if len(raw) > self.kind.size else Abort.LENGTH_LOW)
        value = int.from_bytes(raw, "little", signed=self.kind.signed)
        if self.high is not None and value > self.high:
            raise AbortError(Abort.VALUE_HIGH)
        if self.low is not None and value < self.low:
            raise AbortError(Abort.VALUE_LOW)
        if self.check is not None:
            self.check(value)
        return value

    def raw(self) -> bytes:
        """Its bytes on the bus, little endian."""
        if isinstance(self.value, bytes):
            return self.value
        span = 1 << 8 * self.kind.size
        return (self.value % span).to_bytes(self.kind.size, "little")


class Objects:
    """The dictionary of one node.

    Attributes:
        names: index → name of the object.
        arrays: indices whose entries are all alike.
    """

    def __init__(self) -> None:
        self._entries: dict[Key, Entry] = {}
        self.names: dict[int, str] = {}
        self.arrays: set[int] = set()

    def add(self, index: int, entry: Entry) -> None:
        """Define an object that is one value, or make it anew."""
        self.names[index] = entry.name
        self._entries[index, 0] = entry

    def record(
        self, index: int, name: str, entries: dict[int, Entry], *, array: bool = False,
        count: Entry | None = None,
    ) -> None:  # fmt: skip
        """Define an object of several values; its entry 0 is the highest subindex, or ``count``."""
        self.names[index] = name
        if array:
            self.arrays.add(index)
        top = Entry("Highest sub-index supported", U8, max(entries), "const")
        self._entries[index, 0] = count or top
        for sub, entry in entries.items():
            self._entries[index, sub] = entry

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

    def entry(self, key: Key) -> Entry:
        """An entry.

        Raises:
            AbortError: there is none.
        """
        found = self._entries.get(key)
        if found is None:
            raise AbortError(Abort.NO_SUBINDEX if key[0] in self.names else Abort.NO_OBJECT)
        return found

    def readable(self, key: Key) -> Entry:
        """An entry that a client may read.

        Raises:
            AbortError: there is none, or it is write-only.
        """
        found = self.entry(key)
        if found.access == "wo":
            raise AbortError(Abort.WRITE_ONLY)
        return found

    def writable(self, key: Key) -> Entry:
        """An entry that a client may write.

        Raises:
            AbortError: there is none, or it is read-only.
        """
        found = self.entry(key)
        if not found.writable:
            raise AbortError(Abort.READ_ONLY)
        return found

    def size(self, key: Key) -> int:
        """Bytes of a value."""
        return self._entries[key].kind.size

    def pack(self, keys: Sequence[Key]) -> bytes:
        """Values one after the other, as a PDO carries them."""
        return b"".join(self._entries[key].raw() for key in keys)

    def carried(self, key: Key, writing: bool) -> int | None:
        """Bits of a value that a PDO may carry, None where it may not.

        Args:
            key: of the value.
            writing: whether the PDO would write it.
        """
        entry = self._entries.get(key)
        if entry is None or not entry.mapped or (writing and not entry.writable):
            return None
        return 8 * entry.kind.size

    def kept(self) -> dict[Key, int | bytes]:
        """Every value that 0x1010 stores."""
        return {k: e.value for k, e in self._entries.items() if e.writable and e.kept}

    def restore(self, values: dict[Key, int | bytes]) -> None:
        """Set stored values."""
        for key, value in values.items():
            if key in self._entries:
                self._entries[key].value = value
