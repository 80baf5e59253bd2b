"""RDT datagrams, big endian: requests, 36-byte records, and the status words of each product.

Sources: ATI 9620-05 Net F/T manual (RDT, system status codes) and ATI 9620-05-C Ethernet Axia (its
status codes).
"""

import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from wrenchbed.errors import DriverError, ParameterError

_ANY = 1 << 31
SIZE = 36
"""Bytes of a record."""
LARGEST = 40 * SIZE
"""Bytes of the longest datagram that a box sends."""
START, BIAS, STOP = 0x0002, 0x0042, 0x0000
_REQUEST = struct.Struct(">HHI")
_RECORD = struct.Struct(">3I6i")
_NUMBERS = struct.Struct(">II28x")
_STATUS = struct.Struct(">8xI24x")


@dataclass(frozen=True)
class StatusTable:
    """Bits of a product's status word.

    Attributes:
        words: bit → what it means.
        saturated: bits that say that a reading left the sensor's range.
        harmless: bits that are no error.
    """

    words: Mapping[int, str]
    saturated: int
    harmless: int

    def faults(self, status: int) -> tuple[str, ...]:
        """Meaning of a status word; the summary bit only where no other bit is set."""
        words = tuple(word for bit, word in self.words.items() if status >> bit & 1)
        unknown = status & ~_ANY & ~sum(1 << bit for bit in self.words)
        if unknown:
            words = (*words, f"unknown bits 0x{unknown:08x}")
        return words or (("error of an unknown kind",) if status & _ANY else ())

    def broken(self, status: int) -> bool:
        """Whether a status word names an error other than a reading out of range."""
        errors = status & ~(self.saturated | self.harmless)
        only_summary = errors == _ANY and status & (self.saturated | self.harmless)
        return errors != 0 and not only_summary

    def out_of_range(self, status: int) -> bool:
        """Whether a reading left the sensor's range."""
        return bool(status & self.saturated)


_NETBOX = StatusTable(
    {
        30: "processor or memory error", 29: "digital board error", 28: "analog board error",
        27: "serial link error", 26: "program memory error", 25: "halted by its configuration",
        24: "invalid settings", 23: "configuration does not fit the calibration",
        22: "network failure", 21: "CAN failure", 20: "RDT failure", 19: "EtherNet/IP failure",
        18: "DeviceNet failure", 17: "transducer saturated or converter error",
        16: "monitor condition latched", 14: "watchdog timeout", 13: "stack check error",
        12: "EEPROM failure", 11: "flash failure", 10: "analog board watchdog timeout",
        9: "gage excitation current too high", 8: "gage excitation current too low",
        7: "artificial ground out of range", 6: "analog supply too high",
        5: "analog supply too low", 4: "no data from the transducer",
        3: "reference voltage error", 2: "temperature error", 1: "HTTP failure",
    },
    saturated=1 << 17,
    harmless=1 << 16 | 1 << 1,
)  # fmt: skip
_AXIA = StatusTable(
    {
        0: "temperature out of range", 1: "supply voltage out of range", 2: "broken gage",
        3: "busy", 5: "other error", 7: "calibration not accessible",
        16: "monitor condition latched", 27: "gage out of range", 28: "simulated error",
        29: "calibration checksum error", 30: "force or torque out of range",
    },
    saturated=1 << 30 | 1 << 27,
    harmless=1 << 3 | 1 << 16,
)  # fmt: skip
TABLES: Mapping[str, StatusTable] = {"netbox": _NETBOX, "axia": _AXIA}
"""Product → its table."""


def table(product: str) -> StatusTable:
    """Table of a product.

    Raises:
        ParameterError: no such product.
    """
    if product not in TABLES:
        raise ParameterError(f"there is no product {product!r}. Known: {', '.join(TABLES)}")
    return TABLES[product]


class Record(NamedTuple):
    """One sample: both counters, the status word, and six counts fx fy fz tx ty tz."""

    rdt: int
    ft: int
    status: int
    counts: tuple[int, ...]


def request(command: int, samples: int = 0) -> bytes:
    """A request; 0 samples are endless."""
    return _REQUEST.pack(0x1234, command, samples)


def is_complete(length: int) -> bool:
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
    """(rdt_sequence, ft_sequence) of each record of complete datagrams.

    Raises:
        DriverError: not an integer number of records.
    """
    return [(rdt, ft) for rdt, ft in _each(_NUMBERS, data)]


def flagged(data: bytes | memoryview) -> int:
    """All status words of complete datagrams, or-ed.

    Raises:
        DriverError: not an integer number of records.
    """
    word = 0
    for (status,) in _each(_STATUS, data):
        word |= status
    return word


def _each(shape: struct.Struct, data: bytes | memoryview) -> Iterator[tuple[int, ...]]:
    if len(data) % SIZE:
        raise DriverError(f"{len(data)} bytes are no whole number of RDT records")
    return shape.iter_unpack(data)
