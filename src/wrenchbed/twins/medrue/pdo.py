"""One process data object of a drive: its parameters, its mapping, and the data it carries.

As CiA 301 asks, a mapping is changed while the object is switched off (bit 31 of its id) and its
number of entries is 0. An entry that may not be carried is refused, and so is a number that would
cover one that was never written.
"""

import itertools

from wrenchbed.twins.medrue.objects import (
    NOT_MAPPABLE,
    TOO_LONG,
    WRONG_STATE,
    WRONG_VALUE,
    AbortError,
    Key,
    Objects,
)

ENTRIES = 4
_OFF = 1 << 31


def word(index: int, sub: int, bits: int) -> int:
    """A mapping entry."""
    return index << 16 | sub << 8 | bits


class Pdo:
    """A PDO in a node's dictionary.

    Args:
        objects: of the node.
        parameters: index of its communication parameters, 0x1400 … or 0x1800 …
        can_id: that it has after a reset.
        mapped: what it carries after a reset.
        received: whether it is an RPDO, which writes what it carries.
    """

    def __init__(
        self, objects: Objects, parameters: int, can_id: int, mapped: tuple[tuple[int, int], ...],
        received: bool,
    ) -> None:  # fmt: skip
        self._objects, self._index, self._received = objects, parameters, received
        self._map = parameters + 0x200
        add = objects.add
        add(parameters, 0, 5, 1, writable=False)
        self._default = can_id
        add(parameters, 1, can_id, 4, check=self._check_id)
        add(parameters, 2, 1, 1)
        add(parameters, 5, 0, 2)
        add(self._map, 0, len(mapped), 1, check=self._check_count)
        for k in range(ENTRIES):
            entry = word(mapped[k][0], 0, mapped[k][1]) if k < len(mapped) else 0
            add(self._map, k + 1, entry, 4, check=self._check_entry)

    @property
    def can_id(self) -> int | None:
        """The id that it uses, None while it is switched off."""
        value = self._objects[self._index, 1]
        return None if value & _OFF else value & 0x7FF

    @property
    def synchronous(self) -> bool:
        """Whether SYNC makes it act."""
        return self._objects[self._index, 2] <= 240

    @property
    def every(self) -> int:
        """SYNCs per transmission."""
        return max(1, self._objects[self._index, 2])

    @property
    def timer(self) -> float:
        """Event timer [s], 0 where it is off."""
        return self._objects[self._index, 5] / 1000.0

    @timer.setter
    def timer(self, seconds: float) -> None:
        self._objects[self._index, 5] = round(seconds * 1000.0)

    def keys(self) -> list[Key]:
        """What it carries, in order."""
        entries = [self._objects[self._map, k + 1] for k in range(self._objects[self._map, 0])]
        return [(entry >> 16, entry >> 8 & 0xFF) for entry in entries]

    def pack(self) -> bytes:
        """Its data now."""
        return b"".join(self._objects.pack(key) for key in self.keys())

    def unpack(self, data: bytes) -> bool:
        """Take its data; False where they are too short or out of range: nothing is taken then."""
        keys = self.keys()
        ends = list(itertools.accumulate((self._objects.size(key) or 0 for key in keys), initial=0))
        if len(data) < ends[-1]:
            return False
        parts = [data[begin:end] for begin, end in itertools.pairwise(ends)]
        try:
            values = [self._objects.read(key, part) for key, part in zip(keys, parts, strict=True)]
        except AbortError:
            return False
        for key, value in zip(keys, values, strict=True):
            self._objects[key] = value
        return True

    def _check_id(self, value: int) -> None:
        """It may be switched off and on; its id stays that of the predefined connection set."""
        if value & 0x1FFFFFFF != self._default:
            raise AbortError(WRONG_VALUE)

    def _check_count(self, count: int) -> None:
        if self.can_id is not None:
            raise AbortError(WRONG_STATE)
        if count > ENTRIES:
            raise AbortError(WRONG_VALUE)
        entries = [self._objects[self._map, k + 1] for k in range(count)]
        for entry in entries:
            self._check_carried(entry)
        if sum(entry & 0xFF for entry in entries) > 64:
            raise AbortError(TOO_LONG)

    def _check_entry(self, entry: int) -> None:
        if self.can_id is not None or self._objects[self._map, 0] != 0:
            raise AbortError(WRONG_STATE)
        self._check_carried(entry)

    def _check_carried(self, entry: int) -> None:
        key = (entry >> 16, entry >> 8 & 0xFF)
        if self._objects.carried(key, self._received) != entry & 0xFF:
            raise AbortError(NOT_MAPPABLE)
