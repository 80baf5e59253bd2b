"""The primary and secondary interfaces: robot state at 10 Hz, messages, programs and commands."""

import zlib
from collections.abc import Callable
from typing import Protocol

from robot_emulators.ur import messages
from robot_emulators.ur import primary_state as state
from robot_emulators.ur.controller import Controller
from robot_emulators.ur.messages import Event
from robot_emulators.ur.modes import Runtime
from robot_emulators.ur.network import Peer
from robot_emulators.ur.script import Collector

PERIOD_S = 0.1
"""Between two robot states [s]."""
DATES = {"cb3": "13-10-2021, 12:00:00", "e": "08-03-2022, 12:00:00", "x": "15-06-2025, 12:00:00"}
"""Of each series' software: a date as the controller writes it; estimates."""


class Clock(Protocol):
    """The controller's time."""

    def now(self) -> float:
        """Seconds since it was switched on."""
        ...


class Primary:
    """Tells clients of ports 30001 and 30002 how the robot is.

    Args:
        controller: what it is about.
        clock: of its time stamps.
    """

    def __init__(self, controller: Controller, clock: Clock) -> None:
        self._controller, self._clock = controller, clock
        self._readers: set[Peer] = set()
        self._listeners: set[Peer] = set()
        self._before: list[bytes] = []
        self._after: list[bytes] = []
        self._due = 0.0
        self._table = _table(controller)
        self._sums = [
            zlib.crc32(repr(column).encode()) for column in zip(*self._table, strict=True)
        ]
        controller.announce = self.tell

    @property
    def wanted(self) -> frozenset[str]:
        """Outputs that the next message shows."""
        return state.FIELDS if self._readers and self._due <= self._controller.now else frozenset()

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

    def _send(self, waiting: list[bytes]) -> None:
        for peer in self._alive(self._listeners) if waiting else ():
            peer.send(b"".join(waiting))
        waiting.clear()

    def cycle(self, now: float) -> None:
        """Send the robot state where it is due."""
        if now < self._due:
            return
        self._due = max(self._due + PERIOD_S, now)
        readers = self._alive(self._readers)
        packed = self.state() if readers else b""
        self._send(self._before)
        for peer in readers:
            peer.send_or_skip(packed)
        self._send(self._after)

    def state(self) -> bytes:
        """The robot state message."""
        controller = self._controller
        modes, values, terminals = controller.modes, controller.values, controller.terminals
        settings, arm = controller.settings, controller.arm
        running = modes.runtime is Runtime.PLAYING
        flags = (
            True, True, modes.powered, modes.emergency, modes.protective, running,
            modes.runtime is Runtime.PAUSED,
        )  # fmt: skip
        limits = list(zip(arm.kinematics.lower, arm.kinematics.upper, strict=True))
        pose = arm.kinematics.pose(arm.plant.q, arm.tcp)
        robot_type = state.ROBOT_TYPES[settings.model]
        return state.message([
            state.robot_mode(self._clock.now(), flags, int(modes.robot), terminals.slider),
            state.joints(values),
            state.cartesian(pose.tolist(), arm.tcp.tolist()),
            state.kinematics(self._table, self._sums),
            state.calibration(),
            state.masterboard(
                terminals.bits, terminals.analog, terminals.analog_types, int(modes.safety), 0
            ),
            state.tool(values["joint_mode"][5]),
            state.configuration(
                limits, arm.kinematics.speed.tolist(), self._table, settings.series, robot_type
            ),
            state.force_mode(controller.estimate.wrench.tolist()),
            state.additional(controller.freedrive),
            state.safety(),
            *([] if settings.series == "cb3" else [state.tool_communication()]),
            state.tool_mode(),
        ])  # fmt: skip

    @staticmethod
    def _alive(peers: set[Peer]) -> list[Peer]:
        peers.difference_update([peer for peer in peers if peer.closed])
        return list(peers)


def _table(controller: Controller) -> list[list[float]]:
    """theta, a, d and alpha of each joint (4, 6), as the controller takes its arm."""
    rows: list[list[float]] = controller.arm.plant.arm.links.T.tolist()
    return [[0.0] * 6, *rows]


class ScriptClient:
    """One client that sends programs, or one of the commands that the pendant sends so."""

    def __init__(self, controller: Controller) -> None:
        self._controller, self._collector = controller, Collector()
        self._commands: dict[str, Callable[[], object]] = {
            "power on": controller.power_on,
            "power off": controller.power_off,
            "set robotmode run": controller.release_brakes,
            "set unlock protective stop": controller.unlock_at_once,
            "stop program": controller.stop_program,
            "pause program": controller.pause,
            "resume program": controller.play,
        }

    def receive(self, data: bytes, now: float) -> bool:
        """Take bytes of programs; False where one grows beyond all measure."""
        scripts = self._collector.feed(data)
        if scripts is None:
            return False
        for text in scripts:
            self._take(text)
        return True

    def end(self) -> None:
        """The client is gone; an unfinished program with it."""
        self._collector = Collector()

    def _take(self, text: str) -> None:
        command = self._commands.get(text.strip())
        if command is not None:
            command()
        else:
            self._controller.upload([text])
