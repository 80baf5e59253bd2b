"""Process data: what one PDO carries, when it acts, and how both may be changed.

A PDO is changed as CiA 301 asks: it is switched off (bit 31 of its id), then its number of entries
is 0, then entries are written. Entries that must not be mapped are refused, and so is a number of
entries that covers one that was never written. Source: CiA 301, 7.2.2 and 7.5.2.35 … 7.5.2.38.
"""

import itertools

from robot_emulators.canopen.dictionary import (
    U8,
    U16,
    U32,
    Abort,
    AbortError,
    Entry,
    Key,
    Objects,
)

ENTRIES = 8
_OFF, _NO_REMOTE, _EXTENDED, _ID = 1 << 31, 1 << 30, 1 << 29, 0x7FF
_INHIBIT_S = 1e-4
"""Unit of the inhibit time."""
_SYNCHRONOUS, _SAMPLED, _ASKED, _EVENT = 240, 252, 253, 254
"""Transmission types: up to 240 by SYNC; on a remote frame, sampled at SYNC or at once; events."""
_RESTRICTED = (
    (0x000, 0x000), (0x001, 0x07F), (0x101, 0x180), (0x581, 0x5FF), (0x601, 0x67F),
    (0x6E0, 0x6FF), (0x701, 0x77F), (0x780, 0x7FF),
)  # fmt: skip
"""Ids that may not be configured; source: CiA 301, 7.3.5."""


def check_free(can_id: int) -> None:
    """Refuse a restricted id.

    Raises:
        AbortError: it is one.
    """
    if any(first <= can_id <= last for first, last in _RESTRICTED):
        raise AbortError(Abort.VALUE)


class Pdo:
    """A PDO in a node's dictionary.

    Args:
        objects: of the node.
        number: from 0 on.
        can_id: that it has after a reset.
        mapped: keys of what it carries after a reset.
        received: whether it is an RPDO, which writes what it carries.
        on: whether it is switched on after a reset.
    """

    def __init__(
        self, objects: Objects, number: int, can_id: int, mapped: tuple[Key, ...],
        received: bool, on: bool,
    ) -> None:  # fmt: skip
        self._objects, self._received = objects, received
        self.index = (0x1400 if received else 0x1800) + number
        self._map = self.index + 0x200
        words = [k[0] << 16 | k[1] << 8 | 8 * objects.size(k) for k in mapped]
        parameters = {
            1: Entry(
                "COB-ID", U32, can_id | (0 if on else _OFF), "rw", check=self._check_id,
                of_node=True,
            ),
            2: Entry("Transmission type", U8, 1, "rw", check=self._check_type),
            3: Entry("Inhibit time", U16, 0, "rw", check=self._check_inhibit),
            5: Entry("Event timer", U16, 0, "rw"),
        }  # fmt: skip
        word = "RPDO" if received else "TPDO"
        objects.record(self.index, f"{word}{number + 1} communication parameter", parameters)
        count = Entry("Number of mapped objects", U8, len(words), "rw", check=self._check_count)
        words += [0] * (ENTRIES - len(words))
        entries = {
            k: Entry(f"Mapped object {k}", U32, w, "rw", check=self._check_entry)
            for k, w in enumerate(words, start=1)
        }
        objects.record(self._map, f"{word}{number + 1} mapping parameter", entries, count=count)
        self.heard = self.sent = 0.0
        """When it was last received or transmitted [s], 0 for never."""
        self.waiting: list[tuple[Key, int]] | None = None
        """Of an RPDO: values that wait for SYNC."""
        self.sample = b""
        self._last: bytes | None = None
        self._syncs = 0

    @property
    def can_id(self) -> int | None:
        """The id that it uses, None while it is switched off."""
        value = self._objects[self.index, 1]
        return None if value & _OFF else value & _ID

    @property
    def type(self) -> int:
        """Its transmission type."""
        return self._objects[self.index, 2]

    @property
    def synchronous(self) -> bool:
        """Whether SYNC makes it act."""
        return self.type <= _SYNCHRONOUS

    @property
    def timer(self) -> float:
        """Event timer [s], 0 where it is off."""
        return self._objects[self.index, 5] / 1000.0

    @timer.setter
    def timer(self, seconds: float) -> None:
        self._objects[self.index, 5] = round(seconds * 1000.0)

    @property
    def remote(self) -> bool:
        """Whether a remote frame makes it transmit."""
        return not self._objects[self.index, 1] & _NO_REMOTE

    def keys(self) -> list[Key]:
        """What it carries, in order."""
        entries = [self._objects[self._map, k + 1] for k in range(self._objects[self._map, 0])]
        return [(entry >> 16, entry >> 8 & 0xFF) for entry in entries]

    def forget(self) -> None:
        """The node enters or leaves OPERATIONAL."""
        self.heard = self.sent = 0.0
        self.waiting, self._last, self._syncs = None, None, 0

    def pack(self) -> bytes:
        """Its data now."""
        return self._objects.pack(self.keys())

    def unpack(self, data: bytes) -> list[tuple[Key, int]] | None:
        """Values of its data; None where they are too short, empty where one is out of range."""
        keys = self.keys()
        ends = list(itertools.accumulate((self._objects.size(key) for key in keys), initial=0))
        if len(data) < ends[-1]:
            return None
        parts = [data[begin:end] for begin, end in itertools.pairwise(ends)]
        try:
            pairs = zip(keys, parts, strict=True)
            values = [(key, self._objects.entry(key).parsed(part)) for key, part in pairs]
        except AbortError:
            return []
        return [(key, value) for key, value in values if isinstance(value, int)]

    def at_sync(self) -> bytes | None:
        """What a TPDO transmits at a SYNC, None where nothing."""
        kind = self.type
        if kind == _SAMPLED:
            self.sample = self.pack()
        if self.can_id is None or kind > _SYNCHRONOUS:
            return None
        self._syncs += 1
        data = self.pack()
        if data == self._last if kind == 0 else self._syncs % kind:
            return None
        self._last = data
        return data

    def at_event(self, t: float) -> bytes | None:
        """What an event-driven TPDO transmits at a time [s], None where nothing."""
        if self.can_id is None or self.type < _EVENT:
            return None
        if self.sent and t - self.sent < self._objects[self.index, 3] * _INHIBIT_S - 1e-9:
            return None
        data, timer = self.pack(), self.timer
        if data == self._last and not (timer and t - self.sent >= timer - 1e-9):
            return None
        self._last = data
        due = self.sent + timer
        self.sent = due if timer and self.sent and t - due < 0.5 * timer and t >= due else t
        return data

    def asked(self) -> bytes | None:
        """What a TPDO answers to a remote frame, None where nothing."""
        if not self.remote:
            return None
        return self.sample or self.pack() if self.type == _SAMPLED else self.pack()

    def late(self, t: float) -> bool:
        """Whether an RPDO has not come again for longer than its event timer, at a time [s]."""
        return self.heard > 0.0 and 0.0 < self.timer < t - self.heard

    def _check_id(self, value: int) -> None:
        old = self._objects[self.index, 1]
        if value & _EXTENDED:
            raise AbortError(Abort.VALUE)
        if not (value | old) & _OFF and (value ^ old) & 0x3FFFFFFF:
            raise AbortError(Abort.STATE)
        if not value & _OFF:
            check_free(value & _ID)

    def _check_type(self, kind: int) -> None:
        if _SYNCHRONOUS < kind < (_EVENT if self._received else _SAMPLED):
            raise AbortError(Abort.VALUE)

    def _check_inhibit(self, _: int) -> None:
        if self.can_id is not None:
            raise AbortError(Abort.STATE)

    def _check_count(self, count: int) -> None:
        if self.can_id is not None:
            raise AbortError(Abort.STATE)
        if count > ENTRIES:
            raise AbortError(Abort.TOO_LONG)
        entries = [self._objects[self._map, k + 1] for k in range(count)]
        for entry in entries:
            self._check_carried(entry)
        if sum(entry & 0xFF for entry in entries) > 64:
            raise AbortError(Abort.TOO_LONG)

    def _check_entry(self, entry: int) -> None:
        if self.can_id is not None or self._objects[self._map, 0] != 0:
            raise AbortError(Abort.STATE)
        self._check_carried(entry)

    def _check_carried(self, entry: int) -> None:
        key = (entry >> 16, entry >> 8 & 0xFF)
        if self._objects.carried(key, self._received) != entry & 0xFF:
            raise AbortError(Abort.NOT_MAPPABLE)
