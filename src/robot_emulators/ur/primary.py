"""The primary and secondary interfaces: robot state at 10 Hz, messages, programs and commands.

Layout of the state: Universal Robots, "Remote control via TCP/IP", Client_Interface.xlsx, compared
with a message captured from a controller 5.x (1386 bytes). Big endian: int32 size, uint8 16, then
parts of uint32 size, uint8 kind and their fields. Unknown fields of the maker's own use are zero.
"""

import zlib
from collections.abc import Callable, Iterable, Mapping
from struct import pack

from robot_emulators.ur import messages
from robot_emulators.ur.controller import Controller
from robot_emulators.ur.messages import Event
from robot_emulators.ur.modes import Runtime
from robot_emulators.ur.network import Conversation, Peer
from robot_emulators.ur.outputs import Timestamp
from robot_emulators.ur.rtde_packets import Values
from robot_emulators.ur.urscript.tokens import Collector

STATE = 16
FIELDS = frozenset(
    """actual_q target_q actual_qd actual_current joint_mode actual_joint_voltage
    joint_temperatures robot_mode safety_mode actual_TCP_pose tcp_offset""".split()
)
"""Names of the output fields that a robot state message contains."""
_JOINT = ("actual_q", "target_q", "actual_qd", "actual_current", "actual_joint_voltage",
          "joint_temperatures", "joint_mode")  # fmt: skip
_ROBOT_TYPES = {
    "ur3": 3, "ur5": 1, "ur10": 2, "ur3e": 3, "ur5e": 1, "ur7e": 1, "ur10e": 2, "ur12e": 2,
    "ur16e": 4, "ur8long": 6, "ur15": 9, "ur18": 5, "ur20": 7, "ur30": 8,
}  # fmt: skip
"""Model of an arm → number of its robot type."""
_LIMIT_ACCELERATION = 40.0
"""Largest joint acceleration that the state reports [rad/s²]; not published, no client uses it."""
_DEFAULTS = (1.05, 1.4, 0.25, 1.2, 0.0)
"""Default speed, acceleration of joints [rad] and of the tool [m], and blend radius, in a state."""
PERIOD_S = 0.1
"""Time between two robot states [s]."""
_DATE = "08-03-2022, 12:00:00"
"""Build date of the software, of a release 5.11; no client reads it."""


def robot_state(controller: Controller, timestamp: float) -> bytes:
    """Return the bytes of the robot state message, with the controller's time stamp [s]."""
    modes, values, terminals = controller.modes, controller.values, controller.terminals
    settings, arm = controller.settings, controller.arm
    slider, analog, types = terminals.slider, terminals.analog_values, terminals.analog_types
    links = [[0.0] * 6, *arm.plant.arm.links.T.tolist()]  # theta, a, d, alpha of each joint
    sums = [zlib.crc32(repr(column).encode()) for column in zip(*links, strict=True)]
    limits = [x for pair in zip(arm.kinematics.lower, arm.kinematics.upper, strict=True)
              for x in pair]  # fmt: skip
    top = [x for speed in arm.kinematics.speed for x in (speed, _LIMIT_ACCELERATION)]
    flags = (
        True, True, modes.powered, modes.emergency, modes.protective,
        modes.runtime is Runtime.PLAYING, modes.runtime is Runtime.PAUSED,
    )  # fmt: skip
    cb3, model = settings.series == "cb3", _ROBOT_TYPES[settings.model]
    # in the order of the captured message: mode, joints, poses, kinematics, the maker's own, inputs
    # and outputs, tool, configuration, force, buttons, the maker's own, tool communication and mode
    parts = {
        0: pack(">Q7?BBdddB", max(0, round(timestamp * 1e6)), *flags, modes.robot, 0, slider,
                   slider, 1.0, 0),
        1: b"".join(_joint(values, k) for k in range(6)),
        4: pack(">12d", *arm.kinematics.pose(arm.plant.q, arm.tcp), *arm.tcp),
        5: pack(">6I24dI", *sums, *_flat(links), 0),
        9: bytes(48),
        3: pack(">IIBBddBBddffffBBBIBBB", 0, terminals.bits, 0, 0, 0.0, 0.0, types & 1,
                   types >> 1 & 1, *analog, 29.0, 48.0, 0.6, 0.07, modes.safety, 0, 0, 0, 0, 1, 1),
        2: pack(">BBddfBffB", 1, 1, 0.0, 0.0, 0.0, 0, 0.0, 30.0, values["joint_mode"][5]),
        6: pack(">53d4i", *limits, *top, *_DEFAULTS, *_flat(links[1:]), *links[0], 5,
                   2 if cb3 else 3, model, 0),
        7: pack(">7d", *controller.estimate.wrench, 0.0),
        8: bytes((controller.freedrive, 1, 0, 1)),
        10: bytes(38),
        11: pack(">Biiiff", 0, 115200, 0, 1, 1.5, 3.5),  # the tool's serial line
        12: bytes((0, 1, 1)),
    }  # fmt: skip
    if cb3:
        del parts[11]
    body = b"".join(pack(">IB", 5 + len(part), kind) + part for kind, part in parts.items())
    return pack(">iB", 5 + len(body), STATE) + body


def _joint(values: Mapping[str, Values], k: int) -> bytes:
    """Bytes of joint k (from 0) in a state message, from output ``values`` by name."""
    *numbers, mode = (values[name][k] for name in _JOINT)
    return pack(">3d4fB", *numbers, 0.0, mode)


def _flat(rows: Iterable[Iterable[float]]) -> list[float]:
    return [number for row in rows for number in row]


class Primary:
    """Servers of a UR controller's primary and secondary interfaces, ports 30001 and 30002."""

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
        """Names of the output fields that the next robot state message contains."""
        return FIELDS if self._readers and self._due <= self._controller.now else frozenset()

    def primary(self, peer: Peer) -> "ScriptClient":
        """Make the conversation with a client of port 30001, who gets states and messages."""
        self._listeners.add(peer)
        return self.secondary(peer)

    def secondary(self, peer: Peer) -> "ScriptClient":
        """Make the conversation with a client of port 30002, who gets states but no messages."""
        version = messages.version(self._controller.settings.version, _DATE)
        peer.send(version.packed(self._clock.now()))
        self._readers.add(peer)
        return ScriptClient(self._controller)

    def tell(self, event: Event) -> None:
        """Send a message to every client of the primary interface: a safety mode just before the
        next robot state, an error code just after it; clients then find the stop in the state."""
        packed = event.packed(self._clock.now())
        if event.kind == messages.SAFETY:
            self._before.append(packed)
        elif event.kind == messages.ERROR:
            self._after.append(packed)
        else:
            self._send([packed])

    def cycle(self, now: float) -> None:
        """Send the robot state message to all clients if it is due at time ``now`` [s]."""
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


class ScriptClient(Conversation):
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
        scripts = self._collector.feed(data)
        for text in scripts or ():
            command = self._commands.get(text.strip())
            if command is not None:
                command()
            else:
                self._controller.upload([text])
        return scripts is not None
