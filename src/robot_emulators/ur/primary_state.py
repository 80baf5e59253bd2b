"""The robot state message of the primary and secondary interfaces, with all its parts.

Layout: Universal Robots, "Remote control via TCP/IP", Client_Interface.xlsx, compared with a
message captured from a controller 5.x (1386 bytes). Big endian: int32 size, uint8 16, then parts of
uint32 size, uint8 kind and their fields. Unknown fields of the maker's own use are zero.
"""

import zlib
from collections.abc import Iterable, Mapping
from struct import pack

from robot_emulators.ur.controller import Controller
from robot_emulators.ur.modes import Runtime
from robot_emulators.ur.packets import Values

STATE = 16
FIELDS = frozenset(
    """actual_q target_q actual_qd actual_current joint_mode actual_joint_voltage
    joint_temperatures robot_mode safety_mode actual_TCP_pose tcp_offset""".split()
)
"""Outputs that a message shows."""
_JOINT = ("actual_q", "target_q", "actual_qd", "actual_current", "actual_joint_voltage",
          "joint_temperatures", "joint_mode")  # fmt: skip
_ROBOT_TYPES = {
    "ur3": 3, "ur5": 1, "ur10": 2, "ur3e": 3, "ur5e": 1, "ur7e": 1, "ur10e": 2, "ur12e": 2,
    "ur16e": 4, "ur8long": 6, "ur15": 9, "ur18": 5, "ur20": 7, "ur30": 8,
}  # fmt: skip
"""Number of each arm's type."""
_LIMIT_ACCELERATION = 40.0
"""Largest acceleration of a joint that the state reports [rad/s²]; estimate."""
_DEFAULTS = (1.05, 1.4, 0.25, 1.2, 0.0)
"""Speed and acceleration of joints and of the tool where a move states none, and a radius."""


def robot_state(controller: Controller, timestamp: float) -> bytes:
    """The message, at the controller's time [s]."""
    modes, values, terminals = controller.modes, controller.values, controller.terminals
    settings, arm = controller.settings, controller.arm
    slider, analog, types = terminals.slider, terminals.analog, terminals.analog_types
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
    """Position, target, speed, current, voltage, temperatures and mode of a joint."""
    *numbers, mode = (values[name][k] for name in _JOINT)
    return pack(">3d4fB", *numbers, 0.0, mode)


def _flat(rows: Iterable[Iterable[float]]) -> list[float]:
    return [number for row in rows for number in row]
