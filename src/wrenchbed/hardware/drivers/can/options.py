"""What the driver must be told, checked before anything is sent.

Who uses which id: a sensor whose ids are also a drive's would take targets for commands.

How much of the wire one cycle needs, before anything is sent.

A classic frame has 47 bits and 8 a data byte, intermission included, and at most one stuff bit
for every four of the 34 + 8 n bits that can be stuffed, the first excepted.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import isfinite, tau
from numbers import Integral

from wrenchbed import registry
from wrenchbed.errors import ParameterError
from wrenchbed.robots.motion_limits import Limits

SERVICES = {
    0x080: "EMCY", 0x180: "TPDO1", 0x200: "RPDO1", 0x280: "TPDO2", 0x300: "RPDO2",
    0x380: "TPDO3", 0x400: "RPDO3", 0x480: "TPDO4", 0x500: "RPDO4", 0x580: "SDO answer",
    0x600: "SDO request", 0x700: "heartbeat",
}  # fmt: skip
"""CANopen's predefined connection set: first id of each service of nodes → its name."""
_SHARED = {0x000: "NMT", 0x080: "SYNC", 0x100: "TIME", 0x7E4: "LSS", 0x7E5: "LSS"}
SAFE = 0x68
"""A base whose ids no CANopen service uses: 0x680 … 0x68F."""


def master(base: int, nodes: Sequence[int]) -> int:
    """A node id for this program's own heartbeat: the highest that nobody here uses."""
    return next(n for n in range(127, 0, -1) if n not in nodes and (0x700 + n) >> 4 != base)


def users(nodes: Sequence[int]) -> dict[int, str]:
    """Every id of these CANopen nodes → who uses it."""
    own = {
        first + node: f"{name} of node {node}" for first, name in SERVICES.items() for node in nodes
    }
    return _SHARED | own


def check(base: int, nodes: Sequence[int]) -> None:
    """Refuse nodes that are no nodes, and a sensor whose ids collide with theirs.

    Raises:
        ParameterError: names an id, both of its users, and the remedy.
    """
    if len(set(nodes)) != len(nodes) or not all(1 <= node <= 127 for node in nodes):
        raise ParameterError(f"nodes {tuple(nodes)}: give different numbers from 1 to 127")
    if not 0 <= base <= 0x7F:
        raise ParameterError(f"base 0x{base:X} must be 0 … 0x7F")
    used = users(nodes)
    for can_id in range(base << 4, (base << 4) + 16):
        if can_id in used:
            raise ParameterError(
                f"sensor base 0x{base:02X}: its id 0x{can_id:03X} is {used[can_id]}; its board "
                f"could be reset or moved by a drive's targets: set the board to base "
                f"0x{SAFE:02X}, or the drives to other node ids"
            )


MOST = 0.9
"""Largest share of the wire that the cyclic exchange may need in the worst case."""
_SYNC, _POLL, _EVEN, _ODD, _RPDO, _HEARTBEAT = 0, 0, 8, 6, 6, 1


@dataclass(frozen=True)
class BusLoad:
    """Bits of one cycle and the share of the wire that they use.

    Attributes:
        least: without any stuff bit.
        worst: with as many as there can be.
        share: of the wire, in the worst case.
    """

    least: int
    worst: int
    share: float


def least_bits(length: int) -> int:
    """Bits of a frame of some data bytes (11-bit id), without stuff bits."""
    return 47 + 8 * length


def worst_bits(length: int) -> int:
    """Most bits of a frame of some data bytes (11-bit id)."""
    return least_bits(length) + (33 + 8 * length) // 4


def frame_bits(can_id: int, data: bytes) -> int:
    """Bits of this very frame (11-bit id), stuff bits counted one by one."""
    text = f"0{can_id:011b}000{len(data):04b}" + "".join(f"{byte:08b}" for byte in data)
    register = 0
    for bit in text:
        feedback = (register >> 14) ^ int(bit)
        register = (register << 1) & 0x7FFF
        if feedback:
            register ^= 0x4599
    text += f"{register:015b}"
    stuffed, run, last = 0, 0, ""
    for bit in text:
        run = run + 1 if bit == last else 1
        last = bit
        if run == 5:
            stuffed, run, last = stuffed + 1, 1, "10"[int(bit)]
    return len(text) + stuffed + 13


def cycle_bits(frames: Iterable[tuple[int, bytes]]) -> int:
    """Bits of a list of frames (id, data)."""
    return sum(frame_bits(can_id, data) for can_id, data in frames)


def modelled(
    nodes: int, rate: float, bitrate: int, torque: bool, heartbeat: float, masters: int = 0
) -> BusLoad:
    """Load of the cyclic exchange.

    Args:
        nodes: drives; each gets an RPDO of 6 bytes and answers a TPDO of 6, or 8 with torque.
        rate: of the cycles [Hz].
        bitrate: [bit/s].
        torque: whether drives tell it.
        heartbeat: period of each drive's and master's [s].
        masters: how many send a heartbeat beside the drives.
    """
    lengths = [_SYNC, _POLL, _EVEN, _ODD] + nodes * [_RPDO, 8 if torque else 6]
    least, worst = (sum(bits(n) for n in lengths) for bits in (least_bits, worst_bits))
    beats = (nodes + masters) / heartbeat * worst_bits(_HEARTBEAT)
    return BusLoad(least, worst, (worst * rate + beats) / bitrate)


HEARTBEAT_S = 0.1
ROBOT = "medrue"
_DRIVES = 6
_PER_TURN = (1 << 20) / tau


@dataclass(frozen=True)
class CanOptions:
    """Where the robot is and how it counts. MedRUE's own figures are not public: set yours.

    Attributes:
        robot: registry name; only MedRUE has these drives.
        channel: name of the bus.
        interface: of python-can; SocketCAN, or socketcand where a host is given, if empty.
        host: of a socketcand server.
        port: of a socketcand server.
        bitrate: of the bus [bit/s].
        nodes: CANopen ids of the drives, in the order of the joints.
        base: upper seven bits of the sensor board's ids. The maker's 0x20 collides with CANopen.
        slot: of the sensor's calibration on its board, 0 … 15.
        rate: of the cyclic exchange [Hz].
        counts_per_unit: of each drive per m or rad, negative where it counts the other way;
            1 µm and 2²⁰ per turn unless given.
        torque: whether drives shall tell their torque (0x6077, 0x6076).
        watchdog: after how long without targets a drive stops by itself [s].
        limits: what the robot may do; a quarter of top speed anywhere if None.
    """

    robot: str = ROBOT
    channel: str = "can0"
    interface: str = ""
    host: str = ""
    port: int = 29536
    bitrate: int = 1_000_000
    nodes: tuple[int, ...] = (1, 2, 3, 4, 5, 6)
    base: int = SAFE
    slot: int = 0
    rate: float = 250.0
    counts_per_unit: tuple[float, ...] = (1e6, *[_PER_TURN] * 5)
    torque: bool = False
    watchdog: float = 0.05
    limits: Limits | None = None

    def __post_init__(self) -> None:
        if self.robot != ROBOT:
            raise ParameterError(
                f"driver 'can' moves robot {ROBOT!r} only, not {self.robot!r}: "
                + ("take driver 'rtde'" if self.robot.startswith("ur") else "take driver 'sim'")
            )
        if len(self.nodes) != _DRIVES or len(self.counts_per_unit) != _DRIVES:
            raise ParameterError("nodes and counts_per_unit: give six each, one a joint")
        self._check_counts()
        whole = (*self.nodes, self.port, self.bitrate, self.base, self.slot)
        if not all(isinstance(number, Integral) for number in whole):
            raise ParameterError("nodes, port, bitrate, base and slot: give whole numbers")
        if not 0 < self.port < 1 << 16 or not self.bitrate >= 1000:
            raise ParameterError(
                f"port {self.port} must be 1 … 65535, bitrate {self.bitrate} bit/s at least 1000"
            )
        check(self.base, self.nodes)
        if not self.rate > 0.0 or self.interpolation is None:
            raise ParameterError(
                f"rate {self.rate:g} Hz: its period must be whole tenths of a millisecond up to "
                "255 ms, as 100, 125, 200, 250, 400 or 500 Hz"
            )
        if not 3.0 / self.rate <= self.watchdog <= 10.0:
            raise ParameterError(
                f"watchdog {self.watchdog:g} s must be 3 cycles ({3.0 / self.rate:g} s) … 10 s"
            )
        if self.bus_load.share > MOST:
            raise ParameterError(
                f"rate {self.rate:g} Hz needs up to {100 * self.bus_load.share:.0f} % of a bus of "
                f"{self.bitrate} bit/s, more than {100 * MOST:.0f} %: at most "
                f"{self.rate * MOST / self.bus_load.share:.0f} Hz, or a faster bus"
            )

    def _check_counts(self) -> None:
        if not all(isfinite(count) and count != 0.0 for count in self.counts_per_unit):
            raise ParameterError(
                "counts_per_unit: give finite numbers, none may be 0; negative turns an axis round"
            )
        joints = registry.load("robots", ROBOT).joints
        for joint, count in zip(joints, self.counts_per_unit, strict=True):
            if max(abs(joint.lower), abs(joint.upper)) * abs(count) >= 1 << 31:
                raise ParameterError(
                    f"counts_per_unit: with {count:g} a {joint.unit} the limits of {joint.name} "
                    "do not fit into a target's 32 bits"
                )

    @property
    def interpolation(self) -> tuple[int, int] | None:
        """Period of the targets for 0x60C2: a number up to 255 and a power of ten [s]."""
        for power in (-3, -4):
            ticks = 10.0**-power / self.rate
            if abs(ticks - round(ticks)) < 1e-6 and 1 <= round(ticks) <= 255:
                return round(ticks), power
        return None

    @property
    def bus_load(self) -> BusLoad:
        """Modelled load of the cyclic exchange."""
        return modelled(_DRIVES, self.rate, self.bitrate, self.torque, HEARTBEAT_S, 1)
