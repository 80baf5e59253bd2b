"""The RDT server: answers UDP requests and streams records on time, in the box's event loop.

A request has 8 bytes, a record 36; all is big endian. Faults drop, duplicate, swap or corrupt
datagrams. Deadlines are absolute: up to a record every 0.13 ms, in bursts of 1 ms.
"""

import contextlib
import socket
import time
from asyncio import TimerHandle
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from robot_emulators.base.event_loop import LoopThread
from robot_emulators.base.faults import Faults
from robot_emulators.netft_box.sensing import LARGEST_BUFFER, Sensing

STOP, HIGH_SPEED, BUFFERED, MULTI_UNIT = 0x0000, 0x0002, 0x0003, 0x0004
RESET_LATCH, BIAS = 0x0041, 0x0042
HEADER = 0x1234

REQUEST = np.dtype([("header", ">u2"), ("command", ">u2"), ("samples", ">u4")])
RECORD = np.dtype([("rdt", ">u4"), ("ft", ">u4"), ("status", ">u4"), ("counts", ">i4", (6,))])

Address = tuple[str, int]
_KNOWN = {STOP, HIGH_SPEED, BUFFERED, MULTI_UNIT, RESET_LATCH, BIAS}
_SIZE = RECORD.itemsize
_BURST_S = 1e-3
"""Least time between two sends [s]: seven records at 7000 a second; fewer cost more wake-ups."""
_IDLE_S = 0.05
"""Time between two looks at the plant's clock while nobody listens [s]."""
_CHUNK_S = 2e-3
"""Least time span for which records are made at once [s]: one costs as much as hundreds."""
_LATE_S = 0.25
"""Lag [s] beyond which missed records are left out, as after a sleep of this machine."""
_REQUESTS = 16
"""Most requests read at a time, so that a flood of them does not hold up records."""


class Request(NamedTuple):
    """A client's RDT request to a Net F/T box: command, number of samples wanted (0: endless)."""

    command: int
    samples: int


def parse(data: bytes) -> Request | None:
    """Decode a datagram to an RDT request; None if it is no request that a Net F/T box knows."""
    if len(data) != REQUEST.itemsize:
        return None
    row = np.frombuffer(data, REQUEST)[0]
    command = int(row["command"])
    if int(row["header"]) != HEADER or command not in _KNOWN:
        return None
    return Request(command, int(row["samples"]))


def pack(first: int, ft: np.ndarray, status: np.ndarray, counts: np.ndarray) -> bytes:
    """Return the bytes of n consecutive RDT records, as a Net F/T box sends them by UDP.

    Args:
        first: rdt_sequence (number) of the first record; it wraps after 2³² − 1.
        ft: (n,) ft_sequence, the sample's number, of each record, taken modulo 2³².
        status: (n,) status words.
        counts: (n, 6) force and torque counts, within int32.
    """
    rows = np.empty(len(ft), RECORD)
    rows["rdt"] = (first + np.arange(len(ft), dtype=np.int64)) & 0xFFFFFFFF
    rows["ft"] = np.asarray(ft, dtype=np.int64) & 0xFFFFFFFF
    rows["status"] = status
    rows["counts"] = counts
    return rows.tobytes()


class FaultySender:
    """Sends a Net F/T box's records by UDP, spoilt by active faults; ``counters`` count both."""

    def __init__(self, sock: socket.socket, faults: Faults, seed: int) -> None:
        self._socket, self._faults = sock, faults
        self._random = np.random.default_rng([seed, 49152])
        self._held: memoryview | None = None
        self.counters: Counter[str] = Counter()

    def send(self, data: memoryview, group: int, to: Address) -> None:
        """Send packed RDT records to address ``to``, at most ``group`` records in a datagram."""
        size = group * _SIZE
        parts = [data[k : k + size] for k in range(0, len(data), size)]
        faulty = self._faults.any("rdt") or self._held is not None
        if faulty and self._now("stall") is not None:
            self.counters["silent"] += len(data) // _SIZE
            return
        if faulty:
            parts = self._changed(parts)
        self.counters["sent"] += sum(len(part) for part in parts) // _SIZE
        self.counters["datagrams"] += len(parts)
        self._out(self._socket, parts, to)
        if faulty:
            self._spoil(bytes(data[:_SIZE]), to)

    @staticmethod
    def _out(sock: socket.socket, parts: Sequence[memoryview | bytes], to: Address) -> None:
        with contextlib.suppress(OSError):
            for part in parts:
                sock.sendto(part, to)

    def _now(self, kind: str) -> Mapping[str, Any] | None:
        return self._faults.now("rdt", kind)

    def _hit(self, kind: str) -> bool:
        """Draw at random whether an active fault of this ``kind`` hits the datagram at hand."""
        values = self._now(kind)
        return values is not None and bool(self._random.random() < values["share"])

    def _changed(self, parts: list[memoryview]) -> list[memoryview]:
        """Apply the faults drop, duplicate and swap to datagrams; return those to send."""
        out: list[memoryview] = []
        for part in parts:
            if self._hit("drop"):
                self.counters["dropped"] += len(part) // _SIZE
                continue
            double = self._hit("duplicate")
            self.counters["duplicated"] += double * (len(part) // _SIZE)
            for copy in [part] * (1 + double):
                if self._held is not None:
                    out += [copy, self._held]
                    self._held = None
                    self.counters["swapped"] += 1
                elif self._hit("swap"):
                    self._held = copy
                else:
                    out.append(copy)
        return out

    def _spoil(self, record: bytes, to: Address) -> None:
        """Send ``to`` invalid datagrams, or ``record`` from another port, as faults demand."""
        random = self._random
        spoilt: list[bytes] = []
        if self._now("short") is not None:
            spoilt.append((record * 2)[: int(random.choice([1, 17, 35, 37, 71]))])
        if self._now("garbage") is not None:
            spoilt.append(random.bytes(int(random.choice([8, 36, 72, 500]))))
        self._out(self._socket, spoilt, to)
        self.counters["spoilt"] += len(spoilt)
        if self._now("foreign") is not None:
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
                other.bind((self._socket.getsockname()[0], 0))
                self._out(other, [record], to)
            self.counters["foreign"] += 1


@dataclass
class Pace:
    """How a Net F/T box sends: record rate [Hz], records per datagram if buffered, if RDT is on."""

    rate: float
    buffer: int = 10
    on: bool = True

    def every(self, internal: int) -> int:
        """Number of samples per record, rounded down, at ``internal`` samples a second."""
        return max(1, int(internal / self.rate))


@dataclass
class RecordStream:
    """Records that answer one client's request to a Net F/T box.

    Attributes:
        to: host and port of the client.
        tick, every: sample number of the next record to send, and samples from record to record.
        buffered: whether a datagram carries several records.
        left: records still to send, None for endless.
        sequence: number (rdt_sequence) of the next record to make.
    """

    to: Address
    tick: int
    every: int
    buffered: bool
    left: int | None
    sequence: int = 1


class Rdt:
    """RDT server (ATI's UDP protocol): streams sensor records to the client that last sent a
    request to the UDP socket ``sock``. Web pages change ``pace`` meanwhile; ``seed``: of random
    faults."""

    def __init__(
        self, thread: LoopThread, sock: socket.socket, sensing: Sensing, pace: Pace, faults: Faults,
        seed: int,
    ) -> None:  # fmt: skip
        self._loop = thread.loop
        self._socket, self._sensing, self._pace, self._faults = sock, sensing, pace, faults
        self._sender = FaultySender(sock, faults, seed)
        self.counters = self._sender.counters
        self._stream: RecordStream | None = None
        self._ready = memoryview(b"")
        self._timer: TimerHandle | None = None
        sock.setblocking(False)

    def start(self) -> None:
        """Begin to answer requests for sensor records (RDT); call it in the loop's thread."""
        self._loop.add_reader(self._socket, self._listen)
        self._turn(time.monotonic())

    def stop(self) -> None:
        """End streaming; call it in the loop's thread. The caller closes the socket."""
        self._loop.remove_reader(self._socket)
        if self._timer is not None:
            self._timer.cancel()

    def forget(self) -> None:
        """Drop the request being answered, as a box does when it is switched off and on."""
        self._stream = None

    def answer(self, request: Request, sender: Address, now: float) -> None:
        """Execute client ``sender``'s request at ``now`` [s]: start, stop, or zero the sensor."""
        if request.command == BIAS:
            self._sensing.zero()
            self._unmake()
        elif request.command == STOP:
            self._stream = None
        elif request.command != RESET_LATCH and self._pace.on:
            self._ready = memoryview(b"")
            self._stream = RecordStream(
                sender,
                self._sensing.tick(now),
                self._pace.every(self._sensing.rate),
                request.command == BUFFERED,
                request.samples or None,
            )

    def _turn(self, due: float) -> None:
        """Send the sensor records that are due at ``due`` [s] and schedule the next turn."""
        now = time.monotonic()
        self._sensing.observe()
        wait = _IDLE_S
        if self._stream is not None:
            wait = min(max(_BURST_S, self._stream.every / self._sensing.rate), 0.02)
            self._send_due(self._stream, now)
        due = max(due + wait, now - _BURST_S)
        self._timer = self._loop.call_at(due, self._turn, due)

    def _unmake(self) -> None:
        """Discard sensor records made ahead but not yet sent, so that they are made anew."""
        if self._stream is not None:
            made = len(self._ready) // _SIZE
            self._stream.sequence = (self._stream.sequence - made) & 0xFFFFFFFF
        self._ready = memoryview(b"")

    def _listen(self) -> None:
        now = time.monotonic()
        for _ in range(_REQUESTS):
            try:
                data, sender = self._socket.recvfrom(2048)
            except OSError:
                return
            request = parse(data)
            if request is None:
                self.counters["refused"] += 1
            elif self._faults.now("rdt", "stall") is None:
                self.answer(request, sender, now)
                if self._timer is not None:
                    self._timer.cancel()
                self._turn(now)

    def _send_due(self, stream: RecordStream, now: float) -> None:
        n = (self._sensing.tick(now) - stream.tick) // stream.every + 1
        if n > _LATE_S * self._sensing.rate / stream.every + 1:
            self._unmake()
            stream.tick += (n - 1) * stream.every
            n = 1
        if stream.left is not None:
            n = min(n, stream.left)
        if not self._sensing.stale(now):
            first = stream.tick + len(self._ready) // _SIZE * stream.every
            n = min(n, len(self._ready) // _SIZE + self._sensing.ahead(first, stream.every))
        group = self._pace.buffer if stream.buffered else 1
        if self._faults.now("rdt", "buffered"):
            group = LARGEST_BUFFER
        if stream.left != n:
            n -= n % group
        if n <= 0:
            return
        data = self._take(stream, n)
        self._sender.send(data, group, stream.to)
        stream.tick += n * stream.every
        if stream.left is not None:
            stream.left -= n
            if stream.left <= 0:
                self._stream = None

    def _take(self, stream: RecordStream, n: int) -> memoryview:
        """Return the bytes of the stream's next n records; make further ones ahead if possible."""
        made = len(self._ready) // _SIZE
        if made < n:
            first, every = stream.tick + made * stream.every, stream.every
            known = min(self._sensing.ahead(first, every), int(0.1 * self._sensing.rate / every))
            more = max(n - made, known, int(_CHUNK_S * self._sensing.rate / every))
            ticks = first + np.arange(more, dtype=np.int64) * every
            counts, status = self._sensing.sample(first, every, more)
            packed = pack(stream.sequence, self._sensing.stamps(ticks), status, counts)
            stream.sequence = (stream.sequence + more) & 0xFFFFFFFF
            self._ready = memoryview(bytes(self._ready) + packed)
        out, self._ready = self._ready[: n * _SIZE], self._ready[n * _SIZE :]
        return out
