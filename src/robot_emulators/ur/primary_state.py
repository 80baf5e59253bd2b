"""The robot state message of the primary and secondary interfaces, with all its parts.

Layout: Universal Robots, "Remote control via TCP/IP", Client_Interface.xlsx, compared with a
message captured from a controller 5.x (1386 bytes). Big endian: int32 size, uint8 16, then parts of
uint32 size, uint8 kind and their fields. Unknown fields of the maker's own use are zero.
"""

import struct
from collections.abc import Mapping, Sequence

from robot_emulators.ur.packets import Values

STATE = 16
FIELDS = frozenset(
    """actual_q target_q actual_qd actual_current joint_mode actual_joint_voltage
    joint_temperatures robot_mode safety_mode actual_TCP_pose tcp_offset""".split()
)
"""Outputs that a message shows."""
ROBOT_TYPES = {
    "ur3": 3, "ur5": 1, "ur10": 2, "ur3e": 3, "ur5e": 1, "ur7e": 1, "ur10e": 2, "ur12e": 2,
    "ur16e": 4, "ur8long": 6, "ur15": 9, "ur18": 5, "ur20": 7, "ur30": 8,
}  # fmt: skip
"""Number of each arm's type."""
_LIMIT_ACCELERATION = 40.0
"""Of a joint [rad/s²]; estimate."""
_DEFAULTS = (1.05, 1.4, 0.25, 1.2, 0.0)
"""Speed and acceleration of joints and of the tool where a move states none, and a radius."""
_BOX = {"cb3": 2, "e": 3, "x": 3}
"""Number of the control box's type."""
_DISTINCT = 0.0
_KINEMATICS_OK = 0


def message(parts: Sequence[bytes]) -> bytes:
    """A robot state message of parts."""
    body = b"".join(parts)
    return struct.pack(">iB", 5 + len(body), STATE) + body


def part(kind: int, payload: bytes) -> bytes:
    """One part."""
    return struct.pack(">IB", 5 + len(payload), kind) + payload


def robot_mode(timestamp: float, flags: Sequence[bool], mode: int, speed_fraction: float) -> bytes:
    """Part 0.

    Args:
        timestamp: of the controller [s].
        flags: real robot connected, enabled, power on, emergency stop, protective stop, program
            running, program paused.
        mode: of the robot.
        speed_fraction: of the slider.
    """
    micros, speeds = max(0, round(timestamp * 1e6)), (speed_fraction, speed_fraction, 1.0)
    return part(0, struct.pack(">Q7?BBdddB", micros, *flags, mode, 0, *speeds, 0))


def joints(values: Mapping[str, Values]) -> bytes:
    """Part 1: each joint's position, target, speed, current, voltage, temperatures and mode."""
    rows = zip(
        *(values[name] for name in ("actual_q", "target_q", "actual_qd", "actual_current",
                                    "actual_joint_voltage", "joint_temperatures", "joint_mode")),
        strict=True,
    )  # fmt: skip
    return part(
        1,
        b"".join(
            struct.pack(">3d4fB", q, target, qd, current, volts, warm, 0.0, mode & 0xFF)
            for q, target, qd, current, volts, warm, mode in rows
        ),
    )


def tool(mode: int) -> bytes:
    """Part 2."""
    return part(2, struct.pack(">BBddfBffB", 1, 1, 0.0, 0.0, 0.0, 0, 0.0, 30.0, mode & 0xFF))


def masterboard(
    bits: int, analog: Sequence[float], analog_types: int, safety: int, mode_selector: int
) -> bytes:
    """Part 3: inputs, outputs, supply and safety mode."""
    fields = (
        0, bits, 0, 0, 0.0, 0.0, analog_types & 1, analog_types >> 1 & 1, analog[0], analog[1],
        29.0, 48.0, 0.6, 0.07, safety, 0, 0, 0, mode_selector, 1, 1,
    )  # fmt: skip
    return part(3, struct.pack(">IIBBddBBddffffBBBIBBB", *fields))


def cartesian(pose: Sequence[float], tcp: Sequence[float]) -> bytes:
    """Part 4: pose of the TCP, and the TCP in flange axes."""
    return part(4, struct.pack(">12d", *pose, *tcp))


def kinematics(table: Sequence[Sequence[float]], checksums: Sequence[int]) -> bytes:
    """Part 5: the controller's own theta, a, d, alpha of each joint (4, 6)."""
    numbers = [number for row in table for number in row]
    return part(5, struct.pack(">6I24dI", *checksums, *numbers, _KINEMATICS_OK))


def configuration(
    limits: Sequence[tuple[float, float]], speeds: Sequence[float],
    table: Sequence[Sequence[float]], box: str, robot_type: int,
) -> bytes:  # fmt: skip
    """Part 6: limits (6, 2) [rad] and top speeds (6,) of joints, nominal a, d, alpha, theta."""
    numbers = [bound for pair in limits for bound in pair]
    numbers += [n for speed in speeds for n in (speed, _LIMIT_ACCELERATION)]
    numbers += _DEFAULTS
    numbers += [n for k in (1, 2, 3, 0) for n in table[k]]
    return part(6, struct.pack(">53d4i", *numbers, 5, _BOX[box], robot_type, 0))


def force_mode(wrench: Sequence[float]) -> bytes:
    """Part 7: wrench at the TCP and the robot's dexterity."""
    return part(7, struct.pack(">7d", *wrench, _DISTINCT))


def additional(freedrive: bool) -> bytes:
    """Part 8: buttons of the pendant."""
    return part(8, struct.pack(">4B", freedrive, 1, 0, 1))


def calibration() -> bytes:
    """Part 9: of the maker's own use."""
    return part(9, bytes(48))


def safety() -> bytes:
    """Part 10: of the maker's own use."""
    return part(10, bytes(38))


def tool_communication() -> bytes:
    """Part 11: off, 115200 baud, no parity, one stop bit."""
    return part(11, struct.pack(">Biiiff", 0, 115200, 0, 1, 1.5, 3.5))


def tool_mode() -> bytes:
    """Part 12: of the tool's digital outputs."""
    return part(12, bytes((0, 1, 1)))
