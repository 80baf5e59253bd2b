"""The primary and secondary interfaces: robot state at 10 Hz, messages, programs and commands."""

from collections.abc import Callable

from robot_emulators.ur import messages
from robot_emulators.ur.controller import Controller
from robot_emulators.ur.messages import Event
from robot_emulators.ur.network import Peer
from robot_emulators.ur.outputs import Timestamp
from robot_emulators.ur.primary_state import FIELDS, robot_state
from robot_emulators.ur.script import Collector

PERIOD_S = 0.1
"""Time between two robot states [s]."""
DATES = {"cb3": "13-10-2021, 12:00:00", "e": "08-03-2022, 12:00:00", "x": "15-06-2025, 12:00:00"}
"""Build date of each series' software, as the controller writes it; estimates."""


class Primary:
    """Server of the primary and secondary interfaces, ports 30001 and 30002: sends the robot's
    state."""

    def __init__(self, controller: Controller, clock: Timestamp) -> None:
        self._controller, self._clock = controller, clock
        self._readers: set[Peer] = set()
        self._listeners: set[Peer] = set()
        self._before: list[bytes] = []
        self._after: list[bytes] = []
        self._due = 0.0
        controller.announce = self.tell

    @property
    def wanted(self) -> frozenset[str]:
        """Outputs that the next message shows."""
        return FIELDS if self._readers and self._due <= self._controller.now else frozenset()

    def primary(self, peer: Peer) -> "ScriptClient":
        """A client of port 30001: states and messages."""
        self._listeners.add(peer)
        return self.secondary(peer)

    def secondary(self, peer: Peer) -> "ScriptClient":
        """A client of port 30002: states."""
        series = self._controller.settings.series
        version = messages.version(self._controller.settings.version, DATES[series])
        peer.send(version.packed(self._clock.now()))
        self._readers.add(peer)
        return ScriptClient(self._controller)

    def tell(self, event: Event) -> None:
        """Send a message to every client of the primary interface.

        A safety mode comes with the next robot state, and an error code after it, so that whoever
        hears of a stop finds it in the state, too.
        """
        packed = event.packed(self._clock.now())
        if event.kind == messages.SAFETY:
            self._before.append(packed)
        elif event.kind == messages.ERROR:
            self._after.append(packed)
        else:
            self._send([packed])

    def cycle(self, now: float) -> None:
        """Send the robot state where it is due."""
        if now < self._due:
            return
        self._due = max(self._due + PERIOD_S, now)
        readers = self._alive(self._readers)
        packed = robot_state(self._controller, self._clock.now()) if readers else b""
        self._send(self._before)
        for peer in readers:
            peer.send_or_skip(packed)
        self._send(self._after)

    def _send(self, waiting: list[bytes]) -> None:
        for peer in self._alive(self._listeners) if waiting else ():
            peer.send(b"".join(waiting))
        waiting.clear()

    @staticmethod
    def _alive(peers: set[Peer]) -> list[Peer]:
        peers.difference_update([peer for peer in peers if peer.closed])
        return list(peers)


class ScriptClient:
    """One client of a port that takes URScript: it uploads a program to the controller, or runs a
    command of the pendant, such as ``power on``, that is sent as if it were a program."""

    def __init__(self, controller: Controller) -> None:
        self._controller, self._collector = controller, Collector()
        self._commands: dict[str, Callable[[], object]] = {
            "power on": lambda: controller.modes.power_on(),
            "power off": controller.power_off,
            "set robotmode run": lambda: controller.modes.release_brakes(),
            "set unlock protective stop": lambda: controller.modes.unlock_at_once(),
            "stop program": controller.stop_program,
            "pause program": controller.pause,
            "resume program": controller.play,
        }

    def receive(self, data: bytes, now: float) -> bool:
        """Take bytes of programs; False once a program is longer than the collector allows."""
        scripts = self._collector.feed(data)
        for text in scripts or ():
            command = self._commands.get(text.strip())
            if command is not None:
                command()
            else:
                self._controller.upload([text])
        return scripts is not None

    def end(self) -> None:
        """Forget the client, which is gone, and its unfinished program."""
        self._collector = Collector()
