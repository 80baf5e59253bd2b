"""The thread that receives RDT records, counts lost ones and repeats the request.

The records of the last second are kept as bytes and decoded on demand.
"""

import contextlib
import select
import socket
import threading
import time
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from wrenchbed.errors import LinkError
from wrenchbed.hardware.device import STALE_S
from wrenchbed.hardware.transducers.base import weight
from wrenchbed.hardware.transducers.netft import datagrams
from wrenchbed.hardware.transducers.netft.datagrams import LARGEST, Record
from wrenchbed.hardware.transducers.netft.sequence import DeviceClock, Tracker

SILENT_S, _PATIENCE_S = 0.25, 2.0
"""Silence until the request is repeated [s], doubled each time up to a longest: a box that starts
must not be flooded."""
_PAUSE_S, _WAIT_S = 1e-3, 0.05
"""Pause between two drains: the age that it adds to a reading; and longest wait for a datagram,
after which `Receiver.stop` is noticed [s]."""
_ROOM = 128 * 1024
"""Bytes of the receive buffer: half a second of records at 7 kHz."""
_HISTORY_S = 1.5
"""Time of which records are kept [s]: longer than a row of a motion waits for its wrench."""
_BATCHES = 8192
"""Batches of records that are kept: `_HISTORY_S` of one in each `_PAUSE_S`, and room."""
_AROUND_S = 0.005
"""Time around a moment within which batches are decoded [s], a few `_PAUSE_S`."""
_MOST_BEHIND = 2048
"""Records by which one may be older than the newest of its batch: more are a damaged number."""


class KnownRecord(NamedTuple):
    """Counts (6,) at a time, the status bits around it, and how far the nearest record is [s]."""

    counts: np.ndarray
    status: int
    age: float


class History:
    """Counts at any time of the last ``seconds``; written by one thread, read by others."""

    def __init__(self, seconds: float, period: float) -> None:
        self._seconds, self._period = seconds, period
        self._batches: deque[tuple[float, bytes]] = deque(maxlen=_BATCHES)

    def add(self, t: float, data: bytes) -> None:
        """Keep complete records whose last arrived at t [s], or would have, had it been in time."""
        self._batches.append((t, data))
        while self._batches[0][0] < t - self._seconds:
            self._batches.popleft()

    def at(self, t: float) -> KnownRecord | None:
        """Counts at a time [s], interpolated by `weight`; None where unknown."""
        around: list[tuple[float, bytes]] = []
        for batch in reversed(self._batches.copy()):
            around.append(batch)
            if batch[0] < t - _AROUND_S:
                break
            if len(around) > 1 and batch[0] > t + _AROUND_S:
                del around[0]
        if not around:
            return None
        times, status, counts = self._decode(around[::-1])
        if not times[0] <= t <= times[-1]:
            return None
        k = int(np.clip(np.searchsorted(times, t), min(1, len(times) - 1), len(times) - 1))
        span = times[k] - times[k - 1]
        if span > STALE_S:
            return None
        later = weight(t - times[k - 1], span)
        between = counts[k - 1] + later * (counts[k] - counts[k - 1])
        age = min(abs(t - times[k - 1]), abs(times[k] - t))
        return KnownRecord(between, int(status[k - 1] | status[k]), float(age))

    def _decode(
        self, batches: list[tuple[float, bytes]]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        times, status, counts = [], [], []
        for arrived, data in batches:
            words = np.frombuffer(data, dtype=">u4").reshape(-1, datagrams.SIZE // 4)
            behind = (words[-1, 0].astype(np.int64) - words[:, 0]) & 0xFFFFFFFF
            behind = np.where(behind < 1 << 31, behind, 0).clip(0, _MOST_BEHIND)
            times.append(arrived - behind * self._period)
            status.append(words[:, 2])
            counts.append(words[:, 3:].astype(np.int32))
        t = np.concatenate(times)
        order = np.argsort(t, kind="stable")
        flags, values = np.concatenate(status)[order], np.concatenate(counts)[order]
        return t[order], flags, values.astype(float)


@dataclass(frozen=True, eq=False)
class Received:
    """The newest record: when it arrived [s], on the device's clock [s], since when its counts
    have been the same [s], and how many records that is."""

    t: float
    device_time: float
    record: Record
    since: float
    same: int


class Receiver:
    """Takes the records of one box.

    Args:
        box: address of its RDT.
        rate: of its records [Hz].
        internal_rate: of its samples [Hz].

    Raises:
        LinkError: there is no way to this address.
    """

    def __init__(self, box: tuple[str, int], rate: float, internal_rate: float) -> None:
        self.box = box
        self.tracker = Tracker(rate, internal_rate / rate)
        self.history = History(_HISTORY_S, 1.0 / rate)
        self.clock = DeviceClock(internal_rate)
        self.newest: Received | None = None
        self.records = self.foreign = self.misshapen = self.requests = 0
        self._status = 0
        self._lock = threading.Lock()
        self._socket = _socket(box)
        self._buffer = bytearray(_ROOM)
        self._heard = 0.0
        self._patience = SILENT_S
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="netft receiver", daemon=True)

    def start(self) -> None:
        """Request the stream and start the thread."""
        self._ask()
        self._thread.start()

    def stop(self) -> None:
        """Stop the stream, end the thread and close the socket."""
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join(2.0)
        if time.monotonic() - self._heard < SILENT_S:
            self.send(datagrams.STOP)
        self._socket.close()

    def send(self, command: int) -> None:
        """Send a request; one that cannot be sent now is lost, as any datagram may be."""
        with contextlib.suppress(OSError):
            self._socket.sendto(datagrams.request(command), self.box)

    def flagged(self) -> int:
        """Status bits that any record showed since the last call."""
        with self._lock:
            word, self._status = self._status, 0
        return word

    def _ask(self) -> None:
        self._heard = time.monotonic()
        self.requests += 1
        self.tracker.asked()
        self.send(datagrams.START)

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
        """Fill the buffer with all that arrived; number of bytes of complete records."""
        view, used, box = memoryview(self._buffer), 0, self.box
        receive = self._socket.recvfrom_into
        while used < _ROOM - LARGEST - 1:
            try:
                length, sender = receive(view[used:], LARGEST + 1)
            except OSError:
                break
            if sender != box:
                self.foreign += 1
                if self.foreign % 256 == 0:
                    break
            elif datagrams.is_complete(length):
                used += length
            else:
                self.misshapen += 1
        return used

    def _take(self, data: bytes, now: float) -> None:
        numbers = datagrams.numbers(data)
        kept = self.tracker.take(numbers)
        if kept is not None:
            if not kept:
                return
            size = datagrams.SIZE
            data = b"".join(data[k * size : (k + 1) * size] for k in kept)
            numbers = [numbers[k] for k in kept]
        self.records += len(numbers)
        if status := datagrams.flagged(data):
            with self._lock:
                self._status |= status
        last = self.tracker.last
        if last in numbers:
            self._show(datagrams.record(data, numbers.index(last)), now, len(numbers))
        self.history.add(self.clock.punctual(now, numbers[-1][1]), data)

    def _show(self, record: Record, now: float, n: int) -> None:
        before = self.newest
        if before is not None and record.counts == before.record.counts:
            since, same = before.since, before.same + n
        else:
            since, same = now, 1
        self.newest = Received(now, self.clock.take(now, record.ft), record, since, same)


def _socket(box: tuple[str, int]) -> socket.socket:
    """A socket that listens only at the address of this machine that faces the box."""
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
