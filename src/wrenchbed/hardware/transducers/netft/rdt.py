"""RDT over UDP, big endian: requests, 36-byte records and their two counters, status words, and the
thread that receives records and repeats the request. Source: ATI 9620-05 Net F/T manual."""

import contextlib
import select
import socket
import struct
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from wrenchbed.errors import DriverError, LinkError
from wrenchbed.hardware.device_base import ClockFit

START, STOP = 0x0002, 0x0000
_REQUEST = struct.Struct(">HHI")
"""Layout of a request: mark 0x1234, command, and number of records, 0 for an endless stream."""
_RECORD = np.dtype([("rdt", ">u4"), ("ft", ">u4"), ("status", ">u4"), ("counts", ">i4", 6)])
SIZE = _RECORD.itemsize
"""Size of a record [byte]: 36."""
LARGEST = 40 * SIZE
"""Size of the longest datagram that a box sends [byte]."""
_ANY = 1 << 31
_WINDOW = 64
"""Number of records by which one may come too late; a network swaps neighbours."""
_AFTER = 8
"""Number of records within which a jump of the counters must be confirmed by another one."""
SILENT_S, _PATIENCE_S = 0.25, 2.0
"""Silence until the request is repeated [s], doubled each time up to the second one: a box that
starts must not be flooded."""
_PAUSE_S, _WAIT_S = 1e-3, 0.05
"""Pause between two readings of the socket, which adds to the age of a reading; longest wait for a
datagram, after which `Receiver.stop` is noticed [s]."""
_ROOM = 128 * 1024
"""Size of the receive buffer [byte]: half a second of records at 7 kHz."""
_STRETCH_S = 0.1
"""Length of the stretches of which the least late reading fits the clocks [s], 100 × `_PAUSE_S`."""
_HELD_S = 0.1
"""Greatest delay of a reading [s]; a larger difference of the clocks means that one has jumped."""


_WORDS = {
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
}  # fmt: skip
"""Bit of the status word → its meaning."""
SATURATED = 1 << 17
"""Status bit of a reading outside the sensor's range."""
_NO_ERROR = SATURATED | 1 << 16 | 1 << 1
"""Status bits with which the reading can be used."""


def faults(status: int) -> tuple[str, ...]:
    """Faults in a Net F/T box's status word, one text each; the summary bit only if it is alone."""
    words = tuple(word for bit, word in _WORDS.items() if status >> bit & 1)
    unknown = status & ~_ANY & ~sum(1 << bit for bit in _WORDS)
    if unknown:
        words = (*words, f"unknown bits 0x{unknown:08x}")
    return words or (("error of an unknown kind",) if status & _ANY else ())


def broken(status: int) -> bool:
    """Whether a Net F/T box's status word has an error other than a reading out of range."""
    errors = status & ~_NO_ERROR
    only_summary = errors == _ANY and status & _NO_ERROR
    return errors != 0 and not only_summary


def decode(data: bytes) -> np.ndarray:
    """Decode datagrams of a Net F/T box into RDT records (n,) with ``rdt``, ``ft``, ``status`` and
    ``counts`` (6,); a `DriverError` if the bytes are no whole number of records."""
    if len(data) % SIZE:
        raise DriverError(f"{len(data)} bytes are no whole number of RDT records")
    return np.frombuffer(data, dtype=_RECORD)


def signed(difference: int) -> int:
    """Interpret the difference of two 32-bit counters as a signed number, −2³¹ … 2³¹ − 1."""
    return (difference + 2**31) % 2**32 - 2**31


class Tracker:
    """Follows a Net F/T box's stream of RDT records, and counts those lost, repeated or impossible.

    A far jump of the counters is accepted only if the next record confirms it. ``rate`` is that of
    records [Hz], ``every`` the number of the box's samples per record.

    Attributes:
        last: (rdt_sequence, ft_sequence) of the newest record: number of the record, of the sample.
        lost: number of records that did not come in time, known from gaps.
        disordered: number of records that came twice, or after a newer one; they are left out.
        implausible: number of records with impossible counters, left out.
        restarts: number of restarts of the device, when ft_sequence went back.
    """

    def __init__(self, rate: float, every: float) -> None:
        self.last = (0, 0)
        self.lost = self.disordered = self.implausible = self.restarts = 0
        self._far = max(1000, round(rate))
        self._every = every
        self._begun, self._asked = False, True
        self._jump: tuple[int, int] | None = None

    def asked(self) -> None:
        """Note a new request to the box, after which its record counters may start again at 1."""
        self._asked = True

    def take(self, records: np.ndarray) -> np.ndarray:
        """Return the arrived records (n,) without repeated, late and impossible ones, in order."""
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
        """Accept a jump to ``pair``, numbers of record and sample; count losses by the sample's."""
        if self._begun:
            samples = signed(pair[1] - self.last[1])
            if samples > 0:
                self.lost += max(0, round(samples / self._every) - 1)
            else:
                self.restarts += 1
        self._asked, self._begun = False, True
        self.last, self._jump = pair, None


class DeviceClock:
    """Unwraps a device's 32-bit counter, at ``rate`` [Hz], and fits it to this machine's clock."""

    def __init__(self, rate: float) -> None:
        self._rate = rate
        self._stamp: int | None = None
        self._samples = 0
        self._fit = ClockFit(_STRETCH_S)

    @property
    def ppm(self) -> float | None:
        """Drift of the device's clock against this machine's [1e-6]; None in the first 2 s."""
        return self._fit.ppm

    def take(self, host: float, stamp: int) -> tuple[float, float]:
        """Add a reading's arrival [s] and 32-bit counter ``stamp``; return device time [s] and the
        arrival that it would have had without delay [s]."""
        step = 0 if self._stamp is None else signed(stamp - self._stamp)
        if step < 0:
            self._fit.clear()
        self._samples = stamp if self._stamp is None or step < 0 else self._samples + step
        self._stamp = stamp
        device = self._samples / self._rate
        self._fit.add(device, host)
        return device, min(host, max(self._fit.host(device), host - _HELD_S))


@dataclass(frozen=True, eq=False)
class Received:
    """The newest RDT record of a Net F/T box: arrival [s], device time [s], sample number, status
    word, counts (6,), since when the counts are unchanged [s], and for how many records."""

    t: float
    device_time: float
    ft: int
    status: int
    counts: np.ndarray
    since: float
    same: int


class Receiver:
    """Thread that receives the records of a Net F/T box, which it sends over UDP (RDT).

    Args:
        box: host and UDP port of the box's RDT.
        rate, internal_rate: rates of its records and of its samples [Hz].
        keep: called in the thread with the times (n,) [s] at which records would have arrived
            without delay, and the records (n,).

    Raises:
        LinkError: there is no way to this address.
    """

    def __init__(
        self, box: tuple[str, int], rate: float, internal_rate: float,
        keep: Callable[[np.ndarray, np.ndarray], None],
    ) -> None:  # fmt: skip
        self.box, self._period, self._keep = box, 1.0 / rate, keep
        self.tracker = Tracker(rate, internal_rate / rate)
        self.clock = DeviceClock(internal_rate)
        self.newest: Received | None = None
        self.records = self.foreign = self.misshapen = self.requests = 0
        self._status = 0
        self._lock = threading.Lock()
        self._socket = _socket(box)
        self._buffer = bytearray(_ROOM)
        self._heard, self._patience = 0.0, SILENT_S
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="netft receiver", daemon=True)

    def start(self) -> None:
        """Request the stream of records from the box and start the thread that receives it."""
        self._ask()
        self._thread.start()

    def stop(self) -> None:
        """Stop the stream, end the thread and close the socket."""
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join(2.0)
        if time.monotonic() - self._heard < SILENT_S:
            self._send(STOP)
        self._socket.close()

    def flagged(self) -> int:
        """Return the status bits of all the box's records since the last call, combined by "or"."""
        with self._lock:
            word, self._status = self._status, 0
        return word

    def _send(self, command: int) -> None:
        """Send the box an RDT request by command number; if it cannot be sent now, it is lost."""
        with contextlib.suppress(OSError):
            self._socket.sendto(_REQUEST.pack(0x1234, command, 0), self.box)

    def _ask(self) -> None:
        self._heard = time.monotonic()
        self.requests += 1
        self.tracker.asked()
        self._send(START)

    def _run(self) -> None:
        poller = select.poll()
        poller.register(self._socket, select.POLLIN)
        while not self._ended.is_set():
            poller.poll(1e3 * _WAIT_S)
            used = self._drain()
            now = time.monotonic()
            if used:
                self._heard, self._patience = now, SILENT_S
                self._take(bytes(self._buffer[:used]), now)
            elif now - self._heard > self._patience:
                self._patience = min(2.0 * self._patience, _PATIENCE_S)
                self._ask()
            time.sleep(_PAUSE_S)

    def _drain(self) -> int:
        """Fill the buffer with all waiting datagrams; return how many bytes are whole records."""
        view, used = memoryview(self._buffer), 0
        while used < _ROOM - LARGEST - 1:
            try:
                length, sender = self._socket.recvfrom_into(view[used:], LARGEST + 1)
            except OSError:
                break
            if sender != self.box:
                self.foreign += 1
                if self.foreign % 256 == 0:
                    break
            elif 0 < length <= LARGEST and length % SIZE == 0:
                used += length
            else:
                self.misshapen += 1
        return used

    def _take(self, data: bytes, now: float) -> None:
        batch = self.tracker.take(decode(data))
        if not len(batch):
            return
        self.records += len(batch)
        if status := int(np.bitwise_or.reduce(batch["status"])):
            with self._lock:
                self._status |= status
        last, before = batch[-1], self.newest
        device, punctual = self.clock.take(now, int(last["ft"]))
        since, same = now, 1
        if before is not None and np.array_equal(last["counts"], before.counts):
            since, same = before.since, before.same + len(batch)
        self.newest = Received(
            now, device, int(last["ft"]), int(last["status"]), last["counts"], since, same
        )
        behind = (int(last["rdt"]) - batch["rdt"].astype(np.int64)) % 2**32
        self._keep(punctual - behind * self._period, batch)


def _socket(box: tuple[str, int]) -> socket.socket:
    """Open a UDP socket, bound to the one local address from which the box is reached."""
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.connect(box)
            here = probe.getsockname()[0]
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    except OSError as error:
        raise LinkError(f"{box[0]}:{box[1]}: {error.strerror}: check the address") from error
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
    sock.setblocking(False)
    try:
        sock.bind((here, 0))
    except OSError as error:
        sock.close()
        raise LinkError(f"{here}: {error.strerror}: no port to listen at") from error
    return sock
