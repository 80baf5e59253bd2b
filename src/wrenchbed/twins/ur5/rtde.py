"""The RTDE server: sessions, the stream of data packets, and what can be wrong with it."""

import time
from collections.abc import Mapping

from wrenchbed.twins.ur5 import wire
from wrenchbed.twins.ur5.network import Conversation, Peer, Port
from wrenchbed.twins.ur5.session import Offer, Session
from wrenchbed.twins.ur5.wire import Values

PORT = 30004
_MOST_HELD = 1 << 22
"""Bytes that a burst may hold back."""


class _Client:
    """A session with its connection."""

    def __init__(self, offer: Offer, peer: Peer) -> None:
        self.peer = peer
        self.session = Session(offer, peer.send)
        self.burst = bytearray()

    def receive(self, data: bytes, now: float) -> bool:
        return self.session.receive(data, now)

    def end(self) -> None:
        self.session.end()


class Rtde:
    """RTDE on one port.

    Attributes:
        frozen_until, silent_until, held_until: until when the content of packets stays the same,
            packets are skipped, or held back to be sent at once, `time.monotonic` [s].
    """

    def __init__(self, host: str, offer: Offer, patience: float) -> None:
        self.offer = offer
        self.port = Port(host, PORT, self._answer, patience)
        self._frozen: dict[str, Values] = {}
        self._clients: list[_Client] = []
        self.restart()

    def restart(self) -> None:
        """Nothing is denied, frozen or held back, as after switching on."""
        self.frozen_until = self.silent_until = self.held_until = 0.0
        self.offer.denials.clear()

    @property
    def wanted(self) -> set[str]:
        """Fields that some client gets."""
        recipes = [client.session.output for client in self._clients if client.session.started]
        return {name for recipe in recipes if recipe is not None for name in recipe.names}

    def freeze(self, until: float, values: Mapping[str, Values]) -> None:
        """Repeat these values in all packets until a time [s]."""
        self.frozen_until, self._frozen = until, dict(values)

    def stream(self, values: Mapping[str, Values], send: bool) -> None:
        """Send what is due, unless the controller is so late that it leaves packets out."""
        now = time.monotonic()
        self._clients = [client for client in self._clients if not client.peer.closed]
        shown = self._frozen if now < self.frozen_until else values
        for client in self._clients:
            if client.burst and now >= self.held_until:
                client.peer.send(bytes(client.burst), _MOST_HELD)
                client.burst.clear()
            if client.session.due() and send and now >= self.silent_until:
                self._send(client, client.session.data(shown), now)

    def hang_up(self, reset: bool = False, writers_only: bool = False) -> None:
        """Close connections: all, or of those clients that set up inputs."""
        for client in self._clients:
            if client.session.inputs or not writers_only:
                client.peer.close(reset)

    def inject(self, data: bytes) -> None:
        """Put bytes into the stream of every client that gets data."""
        for client in self._clients:
            if client.session.started:
                client.peer.send(data)

    def say(self, message: str, level: int) -> None:
        """Send a text message to every client."""
        for client in self._clients:
            client.peer.send(wire.text(message, "twin", level, client.session.protocol))

    def _send(self, client: _Client, data: bytes, now: float) -> None:
        if now < self.port.stalled_until:
            return
        if now < self.held_until:
            if len(client.burst) + len(data) <= _MOST_HELD:
                client.burst += data
        else:
            client.peer.send_or_skip(data)

    def _answer(self, peer: Peer) -> Conversation:
        client = _Client(self.offer, peer)
        self._clients.append(client)
        return client
