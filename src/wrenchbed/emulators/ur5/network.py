"""TCP ports served from one thread: they never block, and what they hold is bounded."""

import select
import socket
import struct
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import Protocol

from wrenchbed.errors import DriverError

_CHUNK = 65536
_BACKLOG = 16
_MOST_PEERS = 64
_KERNEL_HOLDS = 1 << 18
"""Bytes that the kernel is asked to hold for a client."""
_HOLDS = 1 << 18
"""Bytes that wait for a client beyond what the kernel holds."""


class Conversation(Protocol):
    """What is said on one connection."""

    def receive(self, data: bytes, now: float) -> bool:
        """Take bytes; False ends the connection."""
        ...

    def end(self) -> None:
        """The connection is gone."""
        ...


class Peer:
    """One client's connection."""

    def __init__(self, sock: socket.socket, port: "Port") -> None:
        self.sock = sock
        self._port, self._deaf_until = port, port.deaf_until
        self.closed = False
        self.held = bytearray()
        self.stuck_since: float | None = None
        self.conversation: Conversation | None = None

    def send(self, data: bytes, most: int = 0) -> None:
        """Send what the kernel takes and keep the rest.

        Args:
            data: bytes.
            most: that may wait, where this is more than usual; a client beyond it is closed.
        """
        if self.closed:
            return
        self.held += data
        self.flush()
        if len(self.held) > max(_HOLDS, most):
            self.close()

    def send_or_skip(self, data: bytes) -> None:
        """Send unless something older still waits."""
        if not self.held:
            self.send(data)

    def quiet(self, now: float) -> bool:
        """Whether nothing is heard from or said to this client at present."""
        return now < self._deaf_until or now < self._port.stalled_until

    def flush(self) -> None:
        """Hand what waits to the kernel."""
        if self.quiet(time.monotonic()):
            return
        try:
            while self.held and not self.closed:
                sent = self.sock.send(self.held)
                del self.held[:sent]
                self.stuck_since = None
        except (BlockingIOError, InterruptedError):
            if self.stuck_since is None:
                self.stuck_since = time.monotonic()
        except OSError:
            self.close()

    def close(self, reset: bool = False) -> None:
        """End the connection, with a TCP reset on request."""
        if self.closed:
            return
        self.closed = True
        if reset:
            self.sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self.sock.close()
        if self.conversation is not None:
            self.conversation.end()


class Port:
    """One listening port and its clients.

    Args:
        host, number: where to listen.
        answer: makes the conversation with a new client.
        patience: seconds after which a client that takes nothing is closed.
    """

    def __init__(
        self,
        host: str,
        number: int,
        answer: Callable[[Peer], Conversation],
        patience: float = 10.0,
    ) -> None:
        self.host, self.number = host, number
        self.peers: list[Peer] = []
        self.stalled_until = 0.0
        self.deaf_until = 0.0
        self._answer, self._patience = answer, patience
        self._listener: socket.socket | None = None
        self._open_at: float | None = None

    @property
    def address(self) -> str:
        """``host:port``."""
        return f"{self.host}:{self.number}"

    def open(self) -> None:
        """Listen.

        Raises:
            DriverError: the port is taken or not allowed.
        """
        if self._listener is not None:
            return
        listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        try:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listener.bind((self.host, self.number))
            listener.listen(_BACKLOG)
        except OSError as error:
            listener.close()
            raise DriverError(
                f"cannot serve at {self.address} ({error.strerror}): stop what listens there, "
                "or give another --host 127.x.x.x"
            ) from error
        listener.setblocking(False)
        self._listener, self._open_at = listener, None

    def unlisten(self, until: float) -> None:
        """Accept nobody until a time of `time.monotonic` [s]; clients stay."""
        if self._listener is not None:
            self._listener.close()
        self._listener, self._open_at = None, until

    def hang_up(self, reset: bool = False) -> None:
        """Close all clients."""
        for peer in self.peers:
            peer.close(reset)

    def close(self) -> None:
        """Stop serving."""
        self.unlisten(float("inf"))
        self.hang_up()
        self.peers.clear()

    def tick(self, now: float) -> None:
        """Reopen what is due, send what waits, close clients that take nothing."""
        if self._open_at is not None and now >= self._open_at:
            try:
                self.open()
            except DriverError:
                self._open_at = now + 0.1
        self.peers = [peer for peer in self.peers if not peer.closed]
        for peer in self.peers:
            if peer.held:
                peer.flush()
                if peer.stuck_since is not None and now - peer.stuck_since > self._patience:
                    peer.close()

    def waiting(self, now: float) -> "dict[socket.socket, Peer | Port]":
        """Sockets to look at for something to read."""
        found: dict[socket.socket, Peer | Port] = {}
        if self._listener is not None:
            found[self._listener] = self
        return found | {p.sock: p for p in self.peers if not p.closed and not p.quiet(now)}

    def accept(self, now: float) -> None:
        """Take one new client."""
        if self._listener is None:
            return
        try:
            sock, _ = self._listener.accept()
        except OSError:
            return
        if len(self.peers) >= _MOST_PEERS:
            sock.close()
            return
        sock.setblocking(False)
        with suppress(OSError):  # where the client is gone already
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _KERNEL_HOLDS)
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        peer = Peer(sock, self)
        self.peers.append(peer)
        peer.conversation = self._answer(peer)


def poll(ports: Iterable[Port], timeout: float) -> None:
    """Wait at most a time [s] for clients and hear those that have something to say."""
    now = time.monotonic()
    waiting: dict[socket.socket, Peer | Port] = {}
    for port in ports:
        waiting |= port.waiting(now)
    readable, _, _ = select.select(list(waiting), [], [], timeout)
    now = time.monotonic()
    for sock in readable:
        which = waiting[sock]
        if isinstance(which, Port):
            which.accept(now)
        elif not which.closed:
            _hear(which, now)


def _hear(peer: Peer, now: float) -> None:
    try:
        data = peer.sock.recv(_CHUNK)
    except (BlockingIOError, InterruptedError):
        return
    except OSError:
        data = b""
    if not data or peer.conversation is None or not peer.conversation.receive(data, now):
        peer.close()
