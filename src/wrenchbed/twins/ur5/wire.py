"""RTDE's packets: header, types, recipes. Everything is big endian.

Header: uint16 size of the whole packet, uint8 type. Universal Robots, "Real-Time Data Exchange
(RTDE) guide".
"""

import struct
from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any

from wrenchbed.errors import LinkError

VERSION, CONTROLLER, TEXT, DATA = ord("V"), ord("v"), ord("M"), ord("U")
OUTPUTS, INPUTS, START, PAUSE = ord("O"), ord("I"), ord("S"), ord("P")

HEADER = 3
FORMATS = {
    "BOOL": "?", "UINT8": "B", "UINT32": "I", "UINT64": "Q", "INT32": "i", "DOUBLE": "d",
    "VECTOR3D": "3d", "VECTOR6D": "6d", "VECTOR6INT32": "6i", "VECTOR6UINT32": "6I",
}  # fmt: skip
"""Name of a type → its format in `struct`."""
WARNING = 2
"""Level of a text message."""
_LONGEST_NAMES = 2048

Values = tuple[Any, ...]
"""One field: as many numbers as its type holds."""


def packet(kind: int, payload: bytes = b"") -> bytes:
    """A packet of a type."""
    return struct.pack(">HB", HEADER + len(payload), kind) + payload


def text(message: str, source: str, level: int, version: int) -> bytes:
    """A text message as the protocol version writes it."""
    said, by = message.encode()[:255], source.encode()[:255]
    if version == 1:
        return packet(TEXT, bytes([level]) + said)
    return packet(TEXT, bytes([len(said)]) + said + bytes([len(by)]) + by + bytes([level]))


def names(raw: bytes) -> list[str] | None:
    """Names of a recipe, joined by commas; None where the list is longer than allowed."""
    if len(raw) > _LONGEST_NAMES:
        return None
    return [name for name in raw.decode("latin-1").split(",") if name]


class Splitter:
    """Cuts a stream of bytes into packets; holds less than one packet."""

    def __init__(self) -> None:
        self._held = bytearray()

    @property
    def held(self) -> int:
        """Bytes of an unfinished packet."""
        return len(self._held)

    def feed(self, data: bytes) -> list[tuple[int, bytes]]:
        """Type and payload of each packet that is complete.

        Raises:
            LinkError: a header states less than its own size.
        """
        self._held += data
        found, at = [], 0
        while len(self._held) - at >= HEADER:
            size, kind = struct.unpack_from(">HB", self._held, at)
            if size < HEADER:
                raise LinkError(f"packet of {size} bytes: its header alone has {HEADER}")
            if len(self._held) - at < size:
                break
            found.append((kind, bytes(self._held[at + HEADER : at + size])))
            at += size
        del self._held[:at]
        return found


class Recipe:
    """Fields in the order in which a packet holds them.

    Args:
        number: of the recipe; None in protocol 1, where data packets do not carry it.
        fields: name → type.
    """

    def __init__(self, number: int | None, fields: Sequence[tuple[str, str]]) -> None:
        self.number = number
        self.names = tuple(name for name, _ in fields)
        self.types = tuple(kind for _, kind in fields)
        self._struct = struct.Struct(">" + "".join(FORMATS[kind] for kind in self.types))
        self._widths = tuple(int(FORMATS[kind][:-1] or 1) for kind in self.types)

    @property
    def size(self) -> int:
        """Bytes of its values."""
        return self._struct.size

    def pack(self, values: Mapping[str, Values]) -> bytes:
        """A data packet."""
        flat = chain.from_iterable([values[name] for name in self.names])
        head = b"" if self.number is None else bytes([self.number])
        return packet(DATA, head + self._struct.pack(*flat))

    def unpack(self, payload: bytes) -> dict[str, Values] | None:
        """Values from the start of a payload; None where it is too short."""
        if len(payload) < self._struct.size:
            return None
        flat = self._struct.unpack_from(payload)
        result, at = {}, 0
        for name, width in zip(self.names, self._widths, strict=True):
            result[name] = flat[at : at + width]
            at += width
        return result
