"""Options of the driver, checked before anything is sent: ids that do not collide, and bus load.

A sensor board that shares an id with a drive would take targets for commands. Source of ids: CiA
301. A classic CAN frame (ISO 11898-1, 11-bit id) with n data bytes has 47 + 8 n bits, intermission
included, and at most one stuff bit per four of the 34 + 8 n bits that can be stuffed, minus one.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite, tau
from numbers import Integral

import numpy as np

from wrenchbed import registry
from wrenchbed.errors import ParameterError
from wrenchbed.robots.checked_moves import Limits

EMCY, TPDO1, RPDO1, HEARTBEAT = 0x080, 0x180, 0x200, 0x700
"""First CAN id of each service of nodes; the node id is added; source: CiA 301."""
SERVICES = {
    EMCY: "EMCY", TPDO1: "TPDO1", RPDO1: "RPDO1", 0x280: "TPDO2", 0x300: "RPDO2",
    0x380: "TPDO3", 0x400: "RPDO3", 0x480: "TPDO4", 0x500: "RPDO4", 0x580: "SDO answer",
    0x600: "SDO request", HEARTBEAT: "heartbeat",
}  # fmt: skip
"""First CAN id of each service of nodes → its name; source: CiA 301, predefined connection set."""
_SHARED = {0x000: "NMT", 0x080: "SYNC", 0x100: "TIME", 0x7E4: "LSS", 0x7E5: "LSS"}
"""CAN ids that belong to no node → their service; sources: CiA 301, CiA 305."""
MOST_NODE = 127
"""Highest CANopen node id; source: CiA 301."""
SAFE = 0x68
"""Base of a sensor board whose ids, 0x680 … 0x68F, no CANopen service uses; source: CiA 301."""
HEARTBEAT_S = 0.1
"""Period of every heartbeat [s]: those of seven nodes need less than 0.5 % of a bus of 1 Mbit/s."""
MOST = 0.9
"""Largest fraction of the bus for the cyclic exchange; error frames and SDO need the rest."""
ROBOT = "medrue"
_DRIVES = 6
_SLOTS = 16
"""Number of calibrations that a sensor's board can store; source: ATI 9610-05-1030."""
_PER_TURN = (1 << 20) / tau
"""Default counts per radian, of a 20-bit encoder: those of MedRUE are not published."""
_WORD = 1 << 31
"""Limit of a target [count], a signed 32-bit integer by definition of 0x607A (CiA 402)."""


def _need(fits: bool, refusal: str) -> None:
    if not fits:
        raise ParameterError(refusal)


def master(base: int, nodes: Sequence[int]) -> int:
    """Return the node id for this program's heartbeat: the highest that neither drives (``nodes``)
    nor the sensor board (``base``: upper seven bits of its ids) use."""
    return next(
        n for n in range(MOST_NODE, 0, -1) if n not in nodes and (HEARTBEAT + n) >> 4 != base
    )


def check(base: int, nodes: Sequence[int]) -> None:
    """Check that node ids are possible, and not used by the sensor board: its CAN ids are ``base``
    × 16 + 0 … 15. A `ParameterError` names an id, both of its users, and the remedy."""
    different = len(set(nodes)) == len(nodes) and all(1 <= node <= MOST_NODE for node in nodes)
    _need(different, f"nodes {tuple(nodes)}: give different numbers from 1 to {MOST_NODE}")
    _need(0 <= base <= 0x7F, f"base 0x{base:X} must be 0 … 0x7F")
    users = _SHARED | {
        first + node: f"{name} of node {node}" for first, name in SERVICES.items() for node in nodes
    }
    for can_id in range(base << 4, (base << 4) + 16):
        if can_id in users:
            raise ParameterError(
                f"sensor base 0x{base:02X}: its id 0x{can_id:03X} is {users[can_id]}; its board "
                f"could be reset or moved by a drive's targets: set the board to base "
                f"0x{SAFE:02X}, or the drives to other node ids"
            )


@dataclass(frozen=True)
class CanOptions:
    """Options of bus, drives and sensor. Ids, slot, rate and counts per unit are assumptions: set
    those of your robot.

    Attributes:
        robot: registry name; only MedRUE has these drives.
        channel: name of the bus.
        interface: python-can's interface; if empty SocketCAN, or socketcand where a host is given.
        host: address of a socketcand server.
        port: TCP port of a socketcand server.
        bitrate: bit rate of the bus [bit/s].
        nodes: CANopen ids of the drives, in the order of the joints.
        base: upper seven bits of the sensor board's ids. The maker's 0x20 collides with CANopen.
        slot: number of the sensor's calibration on its board, 0 … 15.
        rate: rate of the cyclic exchange [Hz].
        counts_per_unit: counts of each drive per m or rad, negative if it counts the other way;
            1 µm and 2²⁰ per turn unless given.
        effort: ``torque``: drives report torque (0x6077, 0x6076), which recordings keep as tau1…
            [N·m or N]; ``current``: they report current (0x6078, 0x6075), kept as i1… [A];
            ``off``: neither.
        watchdog: time without targets after which a drive stops [s].
        limits: limits of the robot's motion; None: a quarter of top speed, anywhere.
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
    effort: str = "off"
    watchdog: float = 0.05
    limits: Limits | None = None

    def __post_init__(self) -> None:
        """Check the options; a `ParameterError` names one that no bus or drive can have."""
        rate, counts = self.rate, self.counts_per_unit
        driver = "rtde" if self.robot.startswith("ur") else "sim"
        _need(
            self.robot == ROBOT,
            f"driver 'can' moves robot {ROBOT!r} only, not {self.robot!r}: take driver {driver!r}",
        )
        modes = ("torque", "current", "off")
        _need(self.effort in modes, f"effort {self.effort!r}: give {', '.join(modes)}")
        six = len(self.nodes) == len(counts) == _DRIVES
        _need(six, "nodes and counts_per_unit: give six each, one a joint")
        finite = all(isfinite(count) and count != 0.0 for count in counts)
        _need(finite, "counts_per_unit: give finite numbers, none may be 0; negative turns an axis")
        for joint, count in zip(registry.load("robots", ROBOT).joints, counts, strict=True):
            _need(
                max(abs(joint.lower), abs(joint.upper)) * abs(count) < _WORD,
                f"counts_per_unit: with {count:g} a {joint.unit} the limits of {joint.name} do not "
                "fit into a target's 32 bits",
            )
        integers = (*self.nodes, self.port, self.bitrate, self.base, self.slot)
        whole = all(isinstance(number, Integral) for number in integers)
        _need(whole, "nodes, port, bitrate, base and slot: give whole numbers")
        _need(0 < self.port < 1 << 16, f"port {self.port} must be 1 … 65535")
        _need(0 <= self.slot < _SLOTS, f"slot {self.slot} must be 0 … {_SLOTS - 1}")
        _need(self.bitrate >= 1000, f"bitrate {self.bitrate} bit/s must be at least 1000")
        check(self.base, self.nodes)
        _need(
            rate > 0.0 and self.interpolation is not None,
            f"rate {rate:g} Hz: its period must be whole tenths of a millisecond up to 255 ms, as "
            "100, 125, 200, 250, 400 or 500 Hz",
        )
        _need(
            3.0 / rate <= self.watchdog <= 10.0,
            f"watchdog {self.watchdog:g} s must be 3 cycles ({3.0 / rate:g} s) … 10 s",
        )
        _need(
            self.bus_load <= MOST,
            f"rate {rate:g} Hz needs up to {100 * self.bus_load:.0f} % of a bus of {self.bitrate} "
            f"bit/s, more than {100 * MOST:.0f} %: at most {rate * MOST / self.bus_load:.0f} Hz, "
            "or a faster bus",
        )

    @property
    def torque(self) -> bool:
        """Whether the drives report torque or current (``effort`` is not off)."""
        return self.effort != "off"

    @property
    def interpolation(self) -> tuple[int, int] | None:
        """Period of targets for object 0x60C2 (CiA 402): integer up to 255, power of ten [s]."""
        for power in (-3, -4):
            ticks = 10.0**-power / self.rate
            if abs(ticks - round(ticks)) < 1e-6 and 1 <= round(ticks) <= 255:
                return round(ticks), power
        return None

    @property
    def bus_load(self) -> float:
        """Fraction of the CAN bus's capacity that the cyclic exchange takes in the worst case.

        A cycle has SYNC, the sensor's poll and its two answers of 8 and 6 bytes, and for each drive
        targets of 6 bytes and an answer of 6, or 8 with torque; drives and master send heartbeats.
        """
        lengths = np.array([0, 0, 8, 6] + _DRIVES * [6, 8 if self.torque else 6] + [1])
        bits = 47 + 8 * lengths + (33 + 8 * lengths) // 4
        beats = (_DRIVES + 1) / HEARTBEAT_S
        return float(self.rate * bits[:-1].sum() + beats * bits[-1]) / self.bitrate
