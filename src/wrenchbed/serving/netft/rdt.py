"""The RDT server: one thread that answers requests and sends records on time."""

import select
import socket
import threading
import time
from dataclasses import dataclass

import numpy as np

from wrenchbed.serving.netft import records
from wrenchbed.serving.netft.mangling import Mangler
from wrenchbed.serving.netft.records import RECORD, Request
from wrenchbed.serving.netft.sensing import Sensing
from wrenchbed.serving.netft.settings import LARGEST_BUFFER
from wrenchbed.serving.netft.troubles import Troubles

Address = tuple[str, int]

_SIZE = RECORD.itemsize
_BURST_S = 1e-3
_IDLE_S = 0.05
_LISTEN_S = 4e-3
_CHUNK_S = 2e-3
"""Least time that records are made for at once [s]."""
_LATE_S = 0.25
"""A thread that wakes later than this has slept with the machine: what it missed is not made up."""
_REQUESTS = 16
"""Requests taken at a time."""


@dataclass
class Pace:
    """What RDT is set to: records a second, records of a buffered datagram, whether it is on."""

    rate: float
    buffer: int
    on: bool = True

    def every(self, internal: int) -> int:
        """Samples from one record to the next: the rate is rounded up to what they allow."""
        return max(1, int(internal / self.rate))


@dataclass
class Stream:
    """One request being answered.

    Attributes:
        to: whom.
        tick: sample of the next record to send.
        every: samples from one record to the next.
        buffered: several records a datagram.
        left: records still to send, None for endless.
        sequence: rdt_sequence of the next record to make.
    """

    to: Address
    tick: int
    every: int
    buffered: bool
    left: int | None
    sequence: int = 1


class Rdt:
    """Streams what ``sensing`` measures to whoever asked last."""

    def __init__(
        self, sock: socket.socket, sensing: Sensing, pace: Pace, troubles: Troubles, seed: int
    ) -> None:
        self._socket, self._sensing, self._pace, self._troubles = sock, sensing, pace, troubles
        self._mangler = Mangler(sock, troubles, seed)
        self.counters = self._mangler.counters
        self._stream: Stream | None = None
        self._ready = memoryview(b"")
        self._heard = 0.0
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="netft rdt", daemon=True)
        sock.setblocking(False)

    def start(self) -> None:
        """Answer from now on."""
        self._thread.start()

    def stop(self) -> None:
        """End the thread; the socket is the caller's."""
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join(2.0)
        self._mangler.close()

    def forget(self) -> None:
        """Drop the request under way, as a box does that was switched off and on."""
        self._stream = None

    def answer(self, request: Request, sender: Address, now: float) -> None:
        """Do what a request asks."""
        if request.command == records.BIAS:
            self._sensing.zero()
            self._unmake()
        elif request.command == records.STOP:
            self._stream = None
        elif request.command != records.RESET_LATCH and self._pace.on:
            self._ready = memoryview(b"")
            self._stream = Stream(
                sender,
                self._sensing.tick(now),
                self._pace.every(self._sensing.rate),
                request.command == records.BUFFERED,
                request.samples or None,
            )

    def _run(self) -> None:
        due = time.monotonic()
        while not self._ended.is_set():
            if self._stream is None:
                select.select([self._socket], [], [], _IDLE_S)
                due = time.monotonic()
            else:
                period = self._stream.every / self._sensing.rate
                due = max(due + min(max(_BURST_S, period), 0.02), time.monotonic() - _BURST_S)
                time.sleep(max(0.0, due - time.monotonic()))
            now = time.monotonic()
            self._sensing.observe()
            if self._stream is None or now >= self._heard + _LISTEN_S:
                self._heard = now
                self._listen(now)
            stream = self._stream
            if stream is not None:
                self._send_due(stream, now)

    def _unmake(self) -> None:
        """Throw away records that are made but not sent; they are made anew."""
        if self._stream is not None:
            made = len(self._ready) // _SIZE
            self._stream.sequence = (self._stream.sequence - made) & 0xFFFFFFFF
        self._ready = memoryview(b"")

    def _listen(self, now: float) -> None:
        for _ in range(_REQUESTS):
            try:
                data, sender = self._socket.recvfrom(2048)
            except OSError:
                return
            request = records.parse(data)
            if request is None:
                self.counters["refused"] += 1
            elif self._troubles.now("stall") is None:
                self.answer(request, sender, now)

    def _send_due(self, stream: Stream, now: float) -> None:
        n = (self._sensing.tick(now) - stream.tick) // stream.every + 1
        if n > _LATE_S * self._sensing.rate / stream.every + 1:
            self._unmake()
            stream.tick += (n - 1) * stream.every
            n = 1
        if stream.left is not None:
            n = min(n, stream.left)
        if not self._sensing.stands(now):
            first = stream.tick + len(self._ready) // _SIZE * stream.every
            n = min(n, len(self._ready) // _SIZE + self._sensing.ahead(first, stream.every))
        group = self._pace.buffer if stream.buffered else 1
        if self._troubles.now("buffered"):
            group = LARGEST_BUFFER
        if stream.left != n:
            n -= n % group
        if n <= 0:
            return
        data = self._take(stream, n)
        self._mangler.send(data, _SIZE, group * _SIZE, stream.to)
        stream.tick += n * stream.every
        if stream.left is not None:
            stream.left -= n
            if stream.left <= 0:
                self._stream = None

    def _take(self, stream: Stream, n: int) -> memoryview:
        """The next n records; as many as the body can tell already are made at a time."""
        made = len(self._ready) // _SIZE
        if made < n:
            first, every = stream.tick + made * stream.every, stream.every
            known = min(self._sensing.ahead(first, every), int(0.1 * self._sensing.rate / every))
            more = max(n - made, known, int(_CHUNK_S * self._sensing.rate / every))
            ticks = first + np.arange(more, dtype=np.int64) * every
            counts, status = self._sensing.sample(first, every, more)
            packed = records.pack(stream.sequence, self._sensing.stamps(ticks), status, counts)
            stream.sequence = (stream.sequence + more) & 0xFFFFFFFF
            self._ready = memoryview(bytes(self._ready) + packed)
        out, self._ready = self._ready[: n * _SIZE], self._ready[n * _SIZE :]
        return out
