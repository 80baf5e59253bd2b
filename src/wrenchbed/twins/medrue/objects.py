"""A CANopen object dictionary: values of one to four bytes, and what a client may do with them.

Sources: CiA 301 (communication objects, abort codes), CiA 402 (drive objects).
"""

from collections.abc import Callable
from dataclasses import dataclass

Key = tuple[int, int]
"""Index and subindex."""

NO_OBJECT, NO_SUBINDEX, READ_ONLY = 0x06020000, 0x06090011, 0x06010002
WRONG_LENGTH, WRONG_VALUE, WRONG_STATE = 0x06070010, 0x06090030, 0x08000022
NOT_MAPPABLE, TOO_LONG, BAD_COMMAND = 0x06040041, 0x06040042, 0x05040001


class AbortError(Exception):
    """An SDO transfer that the drive refuses, with CiA 301's code."""

    def __init__(self, code: int) -> None:
        super().__init__(f"0x{code:08X}")
        self.code = code


@dataclass
class Entry:
    """One value: its size [byte], sign, access, whether a PDO may carry it, and a check that runs
    before it is written."""

    value: int
    size: int
    signed: bool = False
    writable: bool = True
    mappable: bool = False
    check: Callable[[int], None] | None = None

    def read(self, raw: bytes) -> int:
        """The value that some bytes would make it.

        Raises:
            AbortError: it may not have that value.
        """
        value = int.from_bytes(raw, "little", signed=self.signed)
        if self.check is not None:
            self.check(value)
        return value


class Objects:
    """The dictionary of one node."""

    def __init__(self) -> None:
        self._entries: dict[Key, Entry] = {}

    def add(
        self,
        index: int,
        sub: int,
        value: int,
        size: int,
        *,
        signed: bool = False,
        writable: bool = True,
        mappable: bool = False,
        check: Callable[[int], None] | None = None,
    ) -> None:
        """Define a value of 1, 2 or 4 bytes, or make it anew."""
        self._entries[index, sub] = Entry(value, size, signed, writable, mappable, check)

    def __getitem__(self, key: Key) -> int:
        return self._entries[key].value

    def __setitem__(self, key: Key, value: int) -> None:
        self._entries[key].value = value

    def size(self, key: Key) -> int | None:
        """Bytes of a value, None where there is none."""
        entry = self._entries.get(key)
        return None if entry is None else entry.size

    def pack(self, key: Key) -> bytes:
        """A value as it goes over the bus, little endian.

        Raises:
            AbortError: there is none.
        """
        entry = self._find(key)
        span = 1 << 8 * entry.size
        return (entry.value % span).to_bytes(entry.size, "little")

    def carried(self, key: Key, writing: bool) -> int | None:
        """Bits of a value that a PDO may carry, None where it may not.

        Args:
            key: of the value.
            writing: whether the PDO would write it.
        """
        entry = self._entries.get(key)
        if entry is None or not entry.mappable or (writing and not entry.writable):
            return None
        return 8 * entry.size

    def read(self, key: Key, raw: bytes) -> int:
        """The value that some bytes of a PDO would make it.

        Raises:
            AbortError: there is no such value, or it may not be that.
        """
        return self._find(key).read(raw)

    def write(self, key: Key, raw: bytes) -> None:
        """Take a value from an SDO client.

        Raises:
            AbortError: it may not be written, or not so.
        """
        entry = self._find(key)
        if not entry.writable:
            raise AbortError(READ_ONLY)
        if len(raw) != entry.size:
            raise AbortError(WRONG_LENGTH)
        entry.value = entry.read(raw)

    def _find(self, key: Key) -> Entry:
        if key in self._entries:
            return self._entries[key]
        known = any(index == key[0] for index, _ in self._entries)
        raise AbortError(NO_SUBINDEX if known else NO_OBJECT)
