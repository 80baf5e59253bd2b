"""Process data objects (PDO): what each carries, when it is sent, and how both may be changed.

A PDO is changed as CiA 301 asks: it is switched off (bit 31 of its id), then its number of entries
is set to 0, then entries are written. Objects that must not be mapped are refused, and so is a
number of entries that covers an unwritten one. Source: CiA 301, 7.2.2 and 7.5.2.35 … 7.5.2.38.
"""

import itertools

from robot_emulators.canopen.dictionary import Abort, AbortError, Key, Objects

ENTRIES = 8
"""Most objects that one PDO carries."""
_BITS = 64
"""Most bits that a PDO carries."""
_OFF, _WIDE, _ID = 1 << 31, 0x3FFFF800, 0x7FF
"""Bits of the word that holds a PDO's CAN id: switched off, more than 11 bits, the id itself."""
_SYNCHRONOUS, _EVENT = 240, 254
"""Transmission types: up to 240 sent at SYNC, from 254 on by events; those between are refused."""


class Pdo:
    """A CANopen process data object (PDO): which objects of a node a message carries, and when.

    Args:
        objects: the node's object dictionary.
        index: index of its communication parameters: from 0x1400 on of an RPDO, which the node
            receives; from 0x1800 on of a TPDO. The mapping parameters have 0x200 more.
    """

    def __init__(self, objects: Objects, index: int) -> None:
        self._objects, self._received = objects, index < 0x1800
        self.index, self._map = index, index + 0x200
        objects.entry((index, 1)).check = self._check_id
        objects.entry((index, 2)).check = self._check_type
        objects.entry((self._map, 0)).check = self._check_count
        for k in range(1, ENTRIES + 1):
            objects.entry((self._map, k)).check = self._check_entry
        self.forget()

    def forget(self) -> None:
        """Forget past transfers of the PDO; called when the node enters or leaves OPERATIONAL."""
        self.heard = self.sent = 0.0
        """When the PDO was last received or transmitted [s], 0 for never."""
        self.waiting: list[tuple[Key, int]] | None = None
        """Values of a received RPDO that take effect at the next SYNC: (object, number) of each."""
        self._last: bytes | None = None
        self._syncs = 0

    @property
    def can_id(self) -> int | None:
        """CAN id of this PDO (a CANopen message); None while it is switched off."""
        value = self._objects[self.index, 1]
        return None if value & _OFF else value & _ID

    @property
    def type(self) -> int:
        """Transmission type of the PDO (CiA 301): up to 240 at SYNC, from 254 on by events."""
        return self._objects[self.index, 2]

    @property
    def synchronous(self) -> bool:
        return self.type <= _SYNCHRONOUS

    @property
    def timer(self) -> float:
        """Event timer of this PDO, a CANopen message [s]; 0 if it is off."""
        return self._objects[self.index, 5] / 1000.0

    def keys(self) -> list[Key]:
        """Index and subindex of each object that this PDO carries, in order."""
        entries = [self._objects[self._map, k + 1] for k in range(self._objects[self._map, 0])]
        return [(entry >> 16, entry >> 8 & 0xFF) for entry in entries]

    def pack(self) -> bytes:
        """Return the PDO's data bytes with the present values of its objects."""
        return self._objects.pack(self.keys())

    def unpack(self, data: bytes) -> list[tuple[Key, int]]:
        """Decode a received PDO's data to (object, number) pairs; empty if too short or refused."""
        entries = [(key, self._objects.entry(key)) for key in self.keys()]
        ends = list(itertools.accumulate((entry.size for _, entry in entries), initial=0))
        if len(data) < ends[-1]:
            return []
        parts = [data[begin:end] for begin, end in itertools.pairwise(ends)]
        try:
            return [
                (key, entry.parsed(raw)) for (key, entry), raw in zip(entries, parts, strict=True)
            ]
        except AbortError:
            return []

    def at_sync(self) -> bytes | None:
        """Return the data that this PDO, if it is sent by the node, has for a SYNC; else None."""
        if self.can_id is None or not self.synchronous:
            return None
        self._syncs += 1
        data = self.pack()
        if self._syncs % self.type if self.type else data == self._last:
            return None
        self._last = data
        return data

    def at_event(self, t: float) -> bytes | None:
        """Return the data that an event-driven PDO transmits at time t [s]; None if not due."""
        if self.can_id is None or self.type < _EVENT:
            return None
        data, timer = self.pack(), self.timer
        if data == self._last and not (timer and t - self.sent >= timer - 1e-9):
            return None
        self._last = data
        due = self.sent + timer
        self.sent = due if timer and self.sent and t - due < 0.5 * timer and t >= due else t
        return data

    def late(self, t: float) -> bool:
        """Whether, at t [s], a received PDO's event timer has run out since it last came."""
        return self.heard > 0.0 and 0.0 < self.timer < t - self.heard

    def _check_id(self, value: int) -> None:
        before = self._objects[self.index, 1]
        if value & _WIDE:
            raise AbortError(Abort.VALUE)
        if not (value | before) & _OFF and (value ^ before) & 0x3FFFFFFF:
            raise AbortError(Abort.STATE)

    def _check_type(self, kind: int) -> None:
        if _SYNCHRONOUS < kind < _EVENT:
            raise AbortError(Abort.VALUE)

    def _check_count(self, count: int) -> None:
        if self.can_id is not None:
            raise AbortError(Abort.STATE)
        if count > ENTRIES:
            raise AbortError(Abort.TOO_LONG)
        entries = [self._objects[self._map, k + 1] for k in range(count)]
        for entry in entries:
            self._check_carried(entry)
        if sum(entry & 0xFF for entry in entries) > _BITS:
            raise AbortError(Abort.TOO_LONG)

    def _check_entry(self, entry: int) -> None:
        if self.can_id is not None or self._objects[self._map, 0] != 0:
            raise AbortError(Abort.STATE)
        self._check_carried(entry)

    def _check_carried(self, word: int) -> None:
        """Raise `AbortError` if this PDO may not carry the object that a mapping ``word`` names."""
        key = (word >> 16, word >> 8 & 0xFF)
        entry = self._objects.entry(key) if key in self._objects else None
        if (
            entry is None
            or not entry.mapped
            or (self._received and not entry.writable)
            or 8 * entry.size != word & 0xFF
        ):
            raise AbortError(Abort.NOT_MAPPABLE)
