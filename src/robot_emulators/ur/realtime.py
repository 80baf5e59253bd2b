"""The realtime interface, port 30003: robot state in every control cycle, and uploaded programs.

Layout: Universal Robots, "Remote control via TCP/IP", ClientInterfaces_Realtime. Big endian: int32
size of the whole message, then doubles. Later software appends fields: the size tells the version.
"""

from collections.abc import Iterator, Mapping
from struct import pack

from robot_emulators.ur.controller import Controller
from robot_emulators.ur.network import Peer
from robot_emulators.ur.outputs import Timestamp
from robot_emulators.ur.primary import ScriptClient
from robot_emulators.ur.rtde_packets import Values, Version

_LAYOUT = """target_q:6 target_qd:6 target_qdd:6 target_current:6 target_moment:6 actual_q:6
    actual_qd:6 actual_current:6 joint_control_output:6 actual_TCP_pose:6 actual_TCP_speed:6
    actual_TCP_force:6 target_TCP_pose:6 target_TCP_speed:6 actual_digital_input_bits:1
    joint_temperatures:6 actual_execution_time:1 -:1 robot_mode:1 joint_mode:6 safety_mode:1 -:6
    actual_tool_accelerometer:3 -:6 speed_scaling:1 actual_momentum:1 -:2 actual_main_voltage:1
    actual_robot_voltage:1 actual_robot_current:1 actual_joint_voltage:6
    actual_digital_output_bits:1 runtime_state:1 elbow_position:3 elbow_velocity:3 safety_status:1
    -:3 payload:1 payload_cog:3 payload_inertia:6"""
"""RTDE output and number of doubles of each field after the time; ``-``: the maker's own use."""
_FIELDS = tuple((name, int(n)) for name, _, n in (f.partition(":") for f in _LAYOUT.split()))
_ENDS = {
    (3, 2): 1060, (3, 5): 1108, (3, 10): 1116, (3, 14): 1140, (3, 15): 1220,
    (5, 0): 1108, (5, 4): 1116, (5, 9): 1140, (5, 10): 1220,
}  # fmt: skip
"""First software version of each message size [byte]."""


def size(version: Version) -> int:
    """Size [byte] of a message of a UR's realtime interface (port 30003) in a software version."""
    return next(n for since, n in reversed(_ENDS.items()) if since <= version[:2])


def state(values: Mapping[str, Values], timestamp: float, bytes_: int) -> bytes:
    """Return the message of a UR's realtime interface, ``bytes_`` long, from the outputs ``values``
    by name and the controller's time stamp [s]."""
    numbers = [timestamp, *(float(x) for x in _numbers(values))][: (bytes_ - 4) // 8]
    return pack(f">i{len(numbers)}d", bytes_, *numbers)


def _numbers(values: Mapping[str, Values]) -> Iterator[float]:
    for name, count in _FIELDS:
        yield from values.get(name, (0.0,) * count)


class Realtime:
    """Server of a UR controller's realtime interface, port 30003."""

    def __init__(self, controller: Controller, clock: Timestamp) -> None:
        self._controller, self._clock = controller, clock
        self._size = size(controller.settings.version)
        self._readers: set[Peer] = set()

    @property
    def wanted(self) -> frozenset[str]:
        """Names of the output fields that the realtime interface's next message contains."""
        return frozenset(name for name, _ in _FIELDS) if self._readers else frozenset()

    def answer(self, peer: Peer) -> ScriptClient:
        """Make the conversation with a new client, who may also send programs."""
        self._readers.add(peer)
        return ScriptClient(self._controller)

    def cycle(self) -> None:
        """Send the robot's state to each client that has taken all earlier ones."""
        self._readers = {peer for peer in self._readers if not peer.closed}
        if self._readers:
            packed = state(self._controller.values, self._clock.now(), self._size)
            for peer in self._readers:
                peer.send_or_skip(packed)
