"""The controller's TCP ports: data that wait for a client are bounded, and ports have faults."""

import time
from abc import ABC, abstractmethod
from collections.abc import Callable

from robot_emulators.base.event_loop import Connection, Listener, LoopThread
from robot_emulators.base.faults import Faults, TimedFault

_MOST_PEERS = 64
_KERNEL_HOLDS = 1 << 18
"""Size of the kernel's send buffer for a client [byte]."""
_HOLDS = 1 << 18
"""Most bytes that wait for a client beside those in the kernel's buffer."""


class Conversation(ABC):
    """The server's protocol with one client, fed with the bytes that it sends."""

    @abstractmethod
    def receive(self, data: bytes, now: float) -> bool:
        """Handle bytes from the client at time ``now`` [s]; False closes the connection."""

    def end(self) -> None:  # noqa: B027 - most conversations hold nothing
        """Release what the conversation holds for its client, after the connection has closed."""


class Peer(Connection):
    """TCP/IP connection of one client to a port of the emulated UR controller."""

    def __init__(self, port: "Port") -> None:
        super().__init__(port, _KERNEL_HOLDS)
        self._port, self._deaf = port, port.suffers("deaf")
        self._held = bytearray()
        self._conversation: Conversation | None = None

    def welcome(self) -> None:
        self._conversation = self._port.answer(self)
        self.tick()

    def connection_lost(self, error: Exception | None) -> None:
        super().connection_lost(error)
        if self._conversation is not None:
            self._conversation.end()

    def data_received(self, data: bytes) -> None:
        if self._conversation is None or not self._conversation.receive(data, time.monotonic()):
            self.close()

    def send(self, data: bytes, most: int = 0) -> None:
        """Send bytes to the client and keep what the kernel does not accept yet; close the client
        if more than ``most`` bytes (at least `_HOLDS`) would have to be kept."""
        if self.closed:
            return
        self._held += data
        self._flush()
        if len(self._held) + self.waiting > max(_HOLDS, most):
            self.close()

    def send_or_skip(self, data: bytes) -> None:
        """Send bytes to the client; drop them if earlier ones still wait."""
        if not self._held and not self.waiting:
            self.send(data)

    def tick(self) -> None:
        """Pause reading and sending while a fault blocks this client; else resume both."""
        if self.closed:
            return
        if self._quiet():
            self.transport.pause_reading()
        else:
            self.transport.resume_reading()
            self._flush()

    def _quiet(self) -> bool:
        """Whether a fault blocks this client, so that no data pass either way."""
        return self._port.suffers("stall") or (self._deaf and self._port.suffers("deaf"))

    def _flush(self) -> None:
        if self._held and not self._quiet():
            self.transport.write(bytes(self._held))
            self._held.clear()


class Port(Listener[Peer]):
    """One listening TCP/IP port of the emulated UR controller, with its clients and faults.

    Args:
        thread: thread of the loop that serves it.
        address: host and number of the port.
        faults: registry of the emulator's faults.
        name: name of the link, under which its faults are registered.
        answer: makes the conversation with a new client.
    """

    def __init__(
        self, thread: LoopThread, address: tuple[str, int], faults: Faults, name: str,
        answer: Callable[[Peer], Conversation],
    ) -> None:  # fmt: skip
        super().__init__(thread, address, "the UR5", lambda: Peer(self), _MOST_PEERS)
        self.answer = answer
        self._name, self._faults = name, faults
        for kind in ("stall", "deaf"):
            faults.on(name, kind)

    def suffers(self, kind: str) -> bool:
        """Whether a lasting fault of a kind, ``stall`` or ``deaf``, is active on this port."""
        return self._faults.now(self._name, kind) is not None

    def handlers(self) -> dict[str, Callable[[TimedFault], None]]:
        """Fault kind → handler of the faults that act at once; they run in the loop's thread."""
        return {
            "fin": lambda fault: self.hang_up(),
            "rst": lambda fault: self.hang_up(reset=True),
            "unlisten": lambda fault: self.unlisten(fault.end),
        }

    def tick(self) -> None:
        """After a cycle, let each client pause or resume as faults that block it come and go."""
        for peer in list(self.clients):
            peer.tick()
