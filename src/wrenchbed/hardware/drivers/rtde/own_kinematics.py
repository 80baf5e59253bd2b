"""The arm's own geometry, calibrated by its maker, as the controller states it on port 30002.

Source: Universal Robots, "Remote Control Via TCP/IP", client interface: messages begin with their
length and type, a robot state (16) holds parts, and part 5 is the kinematics.
"""

import socket
import struct
import time
from dataclasses import dataclass

import numpy as np

from wrenchbed.errors import DriverError
from wrenchbed.robots.ur_arm import URArm

PORT = 30002
"""TCP port of the secondary client interface."""
_STATE, _KINEMATICS = 16, 5
_HEAD = struct.Struct(">IB")
_TABLE = struct.Struct(">6I24d")
_LONGEST = 1 << 16
"""Bytes of a message; a robot state has some 1,500."""
MOST_M = 0.02
"""Distance of a calibrated flange from the nominal one [m]; estimate: calibrations move it by some
mm, the nearest other arm by 24 mm and more."""
_POSES, _SEED = 64, 0
"""Joint configurations at which two flanges are compared, drawn uniformly."""


@dataclass(frozen=True)
class OwnKinematics:
    """Denavit–Hartenberg parameters of one arm.

    Attributes:
        theta: offsets of the joints (6,) [rad].
        a, d: lengths (6,) [m].
        alpha: twists (6,) [rad].
        checksums: by which the maker's drivers tell one arm from another (6,).
    """

    theta: tuple[float, ...]
    a: tuple[float, ...]
    d: tuple[float, ...]
    alpha: tuple[float, ...]
    checksums: tuple[int, ...]


def read(host: str, seconds: float) -> OwnKinematics | None:
    """What the controller states; None where nobody answers or the port says something else."""
    end = time.monotonic() + seconds
    try:
        with socket.create_connection((host, PORT), seconds) as link:
            held = b""
            while (left := end - time.monotonic()) > 0.0:
                link.settimeout(left)
                data = link.recv(4096)
                if not data:
                    return None
                held += data
                while len(held) >= _HEAD.size:
                    size, kind = _HEAD.unpack_from(held)
                    if not _HEAD.size <= size <= _LONGEST:
                        return None
                    if len(held) < size:
                        break
                    message, held = held[_HEAD.size : size], held[size:]
                    found = kinematics_in(message) if kind == _STATE else None
                    if found is not None:
                        return found
    except OSError:
        pass
    return None


def kinematics_in(state: bytes) -> OwnKinematics | None:
    """The kinematics of a robot state without its head; None where it has none."""
    while len(state) >= _HEAD.size:
        size, kind = _HEAD.unpack_from(state)
        if not _HEAD.size <= size <= len(state):
            return None
        if kind == _KINEMATICS and size >= _HEAD.size + _TABLE.size:
            numbers = _TABLE.unpack_from(state, _HEAD.size)
            theta, a, d, alpha = (numbers[k : k + 6] for k in range(6, 30, 6))
            return OwnKinematics(theta, a, d, alpha, numbers[:6])
        state = state[size:]
    return None


def furthest(robot: URArm, own: OwnKinematics) -> float:
    """Largest distance between the flange of an arm and that of a nominal robot [m].

    Lengths alone do not tell: where axes are parallel, a calibration may shift one link by
    decimetres and the next one back.
    """
    nominal = robot.parameters.nominal
    values = {
        f"{name}{k}": value
        for name, column in (("a", own.a), ("d", own.d), ("alpha", own.alpha))
        for k, value in enumerate(column, 1)
    }
    q = np.random.default_rng(_SEED).uniform(-np.pi, np.pi, (_POSES, 6))
    _, there = robot.sensor_pose(q + np.array(own.theta), robot.parameters.vector(values))
    _, here = robot.sensor_pose(q, nominal)
    return float(np.linalg.norm(there - here, axis=1).max())


def check(robot: URArm, own: OwnKinematics) -> float:
    """`furthest`, of an arm that may be the robot.

    Raises:
        DriverError: it is another arm, or no arm; says what to change.
    """
    if not np.isfinite([own.theta, own.a, own.d, own.alpha]).all():
        raise DriverError(f"the controller's own kinematics holds what is no number: {own}")
    far = furthest(robot, own)
    if far > MOST_M:
        raise DriverError(
            f"by the controller's own kinematics the flange is up to {far:.3f} m from that of "
            f"{robot.name!r}: it moves another arm; check --host, or plan for that arm: "
            "wrenchbed robot FILE --frame NAME --out my.toml"
        )
    return far
