"""RDT, big endian: requests, 36-byte records and their two counters, status words of each product.

Sources: ATI 9620-05 Net F/T manual (RDT, system status codes) and ATI 9620-05-C Ethernet Axia (its
status codes).
"""

import struct
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from wrenchbed.errors import DriverError, ParameterError

START, STOP = 0x0002, 0x0000
_REQUEST = struct.Struct(">HHI")
_RECORD = np.dtype([("rdt", ">u4"), ("ft", ">u4"), ("status", ">u4"), ("counts", ">i4", 6)])
SIZE = _RECORD.itemsize
"""Bytes of a record: 36."""
LARGEST = 40 * SIZE
"""Bytes of the longest datagram that a box sends."""
_ANY = 1 << 31
_WINDOW = 64
"""How late a record may come [records]; a network swaps neighbours."""
_AFTER = 8
"""Records within which another one must follow a jump before it is believed."""


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


def request(command: int, samples: int = 0) -> bytes:
    """A request; 0 samples are endless."""
    return _REQUEST.pack(0x1234, command, samples)


def decode(data: bytes) -> np.ndarray:
    """Records (n,) of complete datagrams: ``rdt``, ``ft``, ``status`` and ``counts`` (6,) of each.

    Raises:
        DriverError: not an integer number of records.
    """
    if len(data) % SIZE:
        raise DriverError(f"{len(data)} bytes are no whole number of RDT records")
    return np.frombuffer(data, dtype=_RECORD)


def signed(difference: int) -> int:
    """A difference of 32-bit counters, −2³¹ … 2³¹ − 1."""
    return (difference + 2**31) % 2**32 - 2**31


class Tracker:
    """Follows one stream of records; a far jump is believed only when the next record confirms it.

    Args:
        rate: of the records [Hz].
        every: samples of the box from one record to the next.

    Attributes:
        last: (rdt_sequence, ft_sequence) of the newest record.
        lost: records that did not come in time, known from gaps.
        disordered: records that came twice, or after a newer one; they are left out.
        implausible: records with an impossible number, left out.
        jumps: of rdt_sequence, which starts again with every request.
        restarts: of the device, whose ft_sequence went back.
    """

    def __init__(self, rate: float, every: float) -> None:
        self.last = (0, 0)
        self.lost = self.disordered = self.implausible = self.jumps = self.restarts = 0
        self._far = max(1000, round(rate))
        self._every = every
        self._begun, self._asked = False, True
        self._jump: tuple[int, int] | None = None

    def asked(self) -> None:
        """A new request was sent: the stream may begin again at 1."""
        self._asked = True

    def take(self, records: np.ndarray) -> np.ndarray:
        """Those of some records (n,) to keep, in order."""
        rdt = records["rdt"].astype(np.int64)
        if self._begun and not self._asked and (np.diff(rdt, prepend=self.last[0]) == 1).all():
            self.last, self._jump = (int(rdt[-1]), int(records["ft"][-1])), None
            return records
        pairs = zip(rdt.tolist(), records["ft"].tolist(), strict=True)
        return records[[self._keep(pair) for pair in pairs]]

    def _keep(self, pair: tuple[int, int]) -> bool:
        ahead = signed(pair[0] - self.last[0])
        if self._asked and pair[0] == 1 and self._begun and ahead <= 0:
            self._begin(pair)
        elif 0 < ahead <= self._far:
            self._asked = self._asked and self._begun
            self.lost += ahead - 1
            self.last, self._begun, self._jump = pair, True, None
        elif -_WINDOW <= ahead <= 0:
            self.disordered += 1
            return False
        elif self._jump is not None and 0 < signed(pair[0] - self._jump[0]) <= _AFTER:
            self.implausible -= 1
            self._begin(self._jump)
            return self._keep(pair)
        else:
            self._jump = pair
            self.implausible += 1
            return False
        return True

    def _begin(self, pair: tuple[int, int]) -> None:
        """The stream goes on elsewhere; the device's own clock tells what was lost between."""
        if self._begun:
            samples = signed(pair[1] - self.last[1])
            if samples > 0:
                self.lost += max(0, round(samples / self._every) - 1)
            else:
                self.restarts += 1
        self.jumps += 1
        self._asked, self._begun = False, True
        self.last, self._jump = pair, None
