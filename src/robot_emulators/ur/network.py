"""The controller's TCP ports: what waits for a client is bounded, and ports can misbehave."""

import time
from asyncio import BaseTransport
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from robot_emulators.base.event_loop import Connection, Listener, LoopThread, taken
from robot_emulators.base.faults import Faults, TimedFault

_MOST_PEERS = 64
_KERNEL_HOLDS = 1 << 18
"""Bytes that the kernel is asked to hold for a client."""
_HOLDS = 1 << 18
"""Bytes that wait for a client beyond what the kernel holds."""


class Conversation(Protocol):
    """Server's side of one connection."""

    def receive(self, data: bytes, now: float) -> bool:
        """Take bytes; False ends the connection."""
        ...

    def end(self) -> None:
        """The connection is gone."""
        ...


@dataclass(frozen=True)
class Network:
    """Settings that all ports of a controller share.

    Attributes:
        thread: of the loop that serves them.
        host: address where they listen.
        faults: of the emulator.
        patience: seconds after which a client that takes nothing is closed.
    """

    thread: LoopThread
    host: str
    faults: Faults
    patience: float


class Peer(Connection):
    """Connection of one client to a port of the controller."""

    def __init__(self, port: "Port") -> None:
        super().__init__(_KERNEL_HOLDS)
        self._port, self._deaf = port, port.suffers("deaf")
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
        """Send what the kernel takes and keep the rest, up to ``most`` bytes or the usual limit; a
        client for whom more would wait is closed."""
        if self.closed:
            return
        self._held += data
        self._flush()
        if len(self._held) + self.waiting > max(_HOLDS, most):
            self.close()

    def send_or_skip(self, data: bytes) -> None:
        """Send unless something older still waits."""
        if not self._held and not self.waiting:
            self.send(data)

    def tick(self, now: float) -> None:
        """Pause or resume reading, send what waits, and close a client that took nothing for too
        long."""
        if self.closed:
            return
        if self._quiet():
            self.transport.pause_reading()
            return
        self.transport.resume_reading()
        self._flush()
        before, since = self._stuck
        waiting = self.waiting
        stuck = 0 < before <= waiting
        self._stuck = (waiting, since if stuck else now)
        if now - self._stuck[1] > self._port.patience:
            self.close()

    def _quiet(self) -> bool:
        """Whether nothing is heard from or said to this client at present."""
        return self._port.suffers("stall") or (self._deaf and self._port.suffers("deaf"))

    def _flush(self) -> None:
        if self._held and not self._quiet():
            self.transport.write(bytes(self._held))
            self._held.clear()


class Port:
    """One listening port and its clients.

    Args:
        network: what it is served with.
        name: of the link, under which its faults are registered.
        number: where to listen.
        answer: makes the conversation with a new client.
    """

    def __init__(
        self, network: Network, name: str, number: int, answer: Callable[[Peer], Conversation]
    ) -> None:
        self.host, self.number, self.answer = network.host, number, answer
        self.patience = network.patience
        self.peers: set[Peer] = set()
        self._listener = Listener(network.thread, lambda: Peer(self))
        self._name, self._faults = name, network.faults
        for kind in ("stall", "deaf"):
            network.faults.on(name, kind)

    def suffers(self, kind: str) -> bool:
        """Whether a lasting fault of this port is under way."""
        return self._faults.now(self._name, kind) is not None

    def handlers(self) -> dict[str, Callable[[TimedFault], None]]:
        """Faults that happen at once, in the loop's thread."""
        return {
            "fin": lambda fault: self.hang_up(),
            "rst": lambda fault: self.hang_up(reset=True),
            "unlisten": lambda fault: self.unlisten(fault.end),
        }

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
        """Take a new client; return False if there are too many."""
        if len(self.peers) >= _MOST_PEERS:
            return False
        self.peers.add(peer)
        return True

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
