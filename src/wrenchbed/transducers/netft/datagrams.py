"""Bytes of RDT, big endian: the requests sent and the 36-byte records received."""

import struct
from collections.abc import Iterator
from typing import NamedTuple

from wrenchbed.errors import DriverError

SIZE = 36
"""Bytes of a record."""
LARGEST = 40 * SIZE
"""Bytes of the longest datagram that a box sends."""
START, BIAS, STOP = 0x0002, 0x0042, 0x0000

_REQUEST = struct.Struct(">HHI")
_RECORD = struct.Struct(">3I6i")
_NUMBERS = struct.Struct(">II28x")
_STATUS = struct.Struct(">8xI24x")


class Record(NamedTuple):
    """One sample: both counters, the status word, and six counts fx fy fz tx ty tz."""

    rdt: int
    ft: int
    status: int
    counts: tuple[int, ...]


def request(command: int, samples: int = 0) -> bytes:
    """A request; 0 samples are endless."""
    return _REQUEST.pack(0x1234, command, samples)


def whole(length: int) -> bool:
    """Whether a datagram of some bytes can be records."""
    return 0 < length <= LARGEST and length % SIZE == 0


def record(data: bytes | memoryview, index: int) -> Record:
    """One record of a datagram.

    Raises:
        DriverError: the datagram holds no such record.
    """
    if not 0 <= index * SIZE <= len(data) - SIZE:
        raise DriverError(f"a datagram of {len(data)} bytes holds no record {index}")
    rdt, ft, status, *counts = _RECORD.unpack_from(data, index * SIZE)
    return Record(rdt, ft, status, tuple(counts))


def numbers(data: bytes | memoryview) -> list[tuple[int, int]]:
    """(rdt_sequence, ft_sequence) of each record of whole datagrams.

    Raises:
        DriverError: not a whole number of records.
    """
    return [(rdt, ft) for rdt, ft in _each(_NUMBERS, data)]


def flagged(data: bytes | memoryview) -> int:
    """All status words of whole datagrams, or-ed.

    Raises:
        DriverError: not a whole number of records.
    """
    word = 0
    for (status,) in _each(_STATUS, data):
        word |= status
    return word


def _each(shape: struct.Struct, data: bytes | memoryview) -> Iterator[tuple[int, ...]]:
    if len(data) % SIZE:
        raise DriverError(f"{len(data)} bytes are no whole number of RDT records")
    return shape.iter_unpack(data)
