"""The controller's TCP ports: what waits for a client is bounded, and ports can misbehave."""

import time
from asyncio import BaseTransport
from collections.abc import Callable
from typing import Protocol

from robot_emulators.base.event_loop import Connection, Listener, LoopThread, taken

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


class Peer(Connection):
    """One client's connection."""

    def __init__(self, port: "Port") -> None:
        super().__init__(_KERNEL_HOLDS)
        self._port, self._deaf_until = port, port.deaf_until
        self._held = bytearray()
        self._conversation: Conversation | None = None
        self._stuck: tuple[int, float] = (0, 0.0)
        """Bytes that waited at the last cycle, and since when none was taken [s]."""

    def connection_made(self, transport: BaseTransport) -> None:
        super().connection_made(transport)
        if self._port.joined(self):
            self._conversation = self._port.answer(self)
            self.tick(time.monotonic())
        else:
            self.close()

    def connection_lost(self, error: Exception | None) -> None:
        self._port.peers.discard(self)
        if self._conversation is not None:
            self._conversation.end()

    def data_received(self, data: bytes) -> None:
        if self._conversation is None or not self._conversation.receive(data, time.monotonic()):
            self.close()

    def send(self, data: bytes, most: int = 0) -> None:
        """Send what the kernel takes and keep the rest.

        Args:
            data: bytes.
            most: that may wait, where this is more than usual; a client beyond it is closed.
        """
        if self.closed:
            return
        self._held += data
        self._flush(time.monotonic())
        if len(self._held) + self.waiting > max(_HOLDS, most):
            self.close()

    def send_or_skip(self, data: bytes) -> None:
        """Send unless something older still waits."""
        if not self._held and not self.waiting:
            self.send(data)

    def tick(self, now: float) -> None:
        """Listen, or do not; send what waits; close where nothing was taken for too long."""
        if self.closed:
            return
        if self._quiet(now):
            self.transport.pause_reading()
            return
        self.transport.resume_reading()
        self._flush(now)
        before, since = self._stuck
        waiting = self.waiting
        stuck = 0 < before <= waiting
        self._stuck = (waiting, since if stuck else now)
        if now - self._stuck[1] > self._port.patience:
            self.close()

    def _quiet(self, now: float) -> bool:
        """Whether nothing is heard from or said to this client at present."""
        return now < self._deaf_until or now < self._port.stalled_until

    def _flush(self, now: float) -> None:
        if self._held and not self._quiet(now):
            self.transport.write(bytes(self._held))
            self._held.clear()


class Port:
    """One listening port and its clients.

    Args:
        thread: of the loop that serves them.
        host, number: where to listen.
        answer: makes the conversation with a new client.
        patience: seconds after which a client that takes nothing is closed.
    """

    def __init__(
        self,
        thread: LoopThread,
        host: str,
        number: int,
        answer: Callable[[Peer], Conversation],
        patience: float = 10.0,
    ) -> None:
        self.host, self.number = host, number
        self.peers: set[Peer] = set()
        self.stalled_until = self.deaf_until = 0.0
        self.answer, self.patience = answer, patience
        self._listener = Listener(thread, lambda: Peer(self))

    @property
    def address(self) -> str:
        """``host:port``."""
        return f"{self.host}:{self.number}"

    def open(self) -> None:
        """Listen.

        Raises:
            EmulatorError: the port is taken or not allowed.
        """
        try:
            self._listener.bind(self.host, self.number)
        except OSError as error:
            raise taken("the UR5", self.host, self.number, error) from error

    def joined(self, peer: Peer) -> bool:
        """Take a new client; False where there are too many."""
        if len(self.peers) >= _MOST_PEERS:
            return False
        self.peers.add(peer)
        return True

    def stall(self, until: float) -> None:
        """Hear nothing from any client and say nothing until a time of `time.monotonic` [s]."""
        self.stalled_until = until
        self.tick(time.monotonic())

    def unlisten(self, until: float) -> None:
        """Accept nobody until a time of `time.monotonic` [s]; clients stay."""
        self._listener.close_until(until)

    def hang_up(self, reset: bool = False) -> None:
        """Close all clients."""
        for peer in self.peers:
            peer.close(reset)

    def close(self) -> None:
        """Stop serving."""
        self._listener.close()
        self.hang_up()

    def tick(self, now: float) -> None:
        """Count a control cycle at a time of `time.monotonic` [s]."""
        for peer in list(self.peers):
            peer.tick(now)
