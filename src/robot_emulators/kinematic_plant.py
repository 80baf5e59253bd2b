"""The plant that is built in: joints that follow their targets exactly, and a point load.

It models no inertia but the load's, no friction, no noise and no contact: readings are exact.
Lengths and top speeds of Universal Robots' arms are those of the maker's ROS description
(``config/ur*/`` of Universal_Robots_ROS2_Description, and of ``ur_description`` for CB3).
"""

import time
from math import pi

import numpy as np

from robot_emulators.errors import SettingError
from robot_emulators.plant import Arm, Efforts, Payload, PlantRequest
from robot_emulators.ur.kinematics import NO_TOOL, Kinematics

GRAVITY = np.array([0.0, 0.0, -9.80665])
_ALPHA = (pi / 2, 0.0, 0.0, pi / 2, -pi / 2, 0.0)
_LENGTHS = {
    "ur3": (0.1519, -0.24365, -0.21325, 0.11235, 0.08535, 0.0819),
    "ur5": (0.089159, -0.425, -0.39225, 0.10915, 0.09465, 0.0823),
    "ur10": (0.1273, -0.612, -0.5723, 0.163941, 0.1157, 0.0922),
    "ur3e": (0.15185, -0.24355, -0.2132, 0.13105, 0.08535, 0.0921),
    "ur5e": (0.1625, -0.425, -0.3922, 0.1333, 0.0997, 0.0996),
    "ur10e": (0.1807, -0.6127, -0.57155, 0.17415, 0.11985, 0.11655),
    "ur16e": (0.1807, -0.4784, -0.36, 0.17415, 0.11985, 0.11655),
}
"""Arm → Denavit–Hartenberg lengths d1, a2, a3, d4, d5, d6 [m]."""
_TOP_SPEEDS = {"ur3": (180.0,) * 3 + (360.0,) * 3, "ur5": (180.0,) * 6,
               "ur10": (120.0,) * 2 + (180.0,) * 4}  # fmt: skip
"""Top speeds of the joints [°/s]; an e-Series has those of the CB3 arm of its size."""
_HOME = np.array([0.0, -pi / 2, pi / 2, -pi / 2, -pi / 2, 0.0])
_LOAD = Payload(1.0, np.array([0.0, 0.0, 0.05]))
"""Load on the sensor: a point mass of 1 kg, 50 mm in front of the flange."""
_RANGE = np.array([130.0, 130.0, 400.0, 10.0, 10.0, 10.0])
"""Range of the sensor (6,) [N, N·m]: ATI Gamma SI-130-10."""


class KinematicPlant:
    """Built-in `Plant`: joints are at their targets one control cycle later, without dynamics.

    Args:
        arm: nominal data of the robot; without ``arm.links`` the flange never turns.
        cycle: control cycle [s].
    """

    gauges: np.ndarray | None = None

    def __init__(self, arm: Arm, cycle: float) -> None:
        self.arm, self.cycle = arm, cycle
        self.sensor_range = _RANGE
        self._kinematics = Kinematics(arm) if len(arm.links) else None
        self.q, self.qd = np.array(arm.home), np.zeros(len(arm.home))
        self.time = 0.0
        self.newest = (time.monotonic(), 0.0)

    @property
    def efforts(self) -> Efforts:
        """Torques (J,) [N·m] that hold the point load, currents [A], and 25 °C for each drive."""
        torque = self.model_torques(self.q, self.qd, self.qd, GRAVITY)
        return Efforts(torque, torque / self.arm.constants, np.full(len(torque), 25.0))

    def step(self, target: np.ndarray, due: float = 0.0) -> None:
        """Advance by a cycle, due at a `time.monotonic` time [s] (0: now), at whose end the joints
        are at ``target`` (J,) [rad or m]."""
        self.qd = (target - self.q) / self.cycle
        self.q = np.array(target, dtype=float)
        self.time += self.cycle
        self.newest = (due or time.monotonic(), self.time)

    def wrench(self) -> np.ndarray:
        """Return the load's weight as a wrench (6,) [N, N·m] in sensor axes."""
        rotation = np.eye(3) if self._kinematics is None else self._kinematics.flange(self.q)[0]
        weight = rotation.T @ (_LOAD.mass * GRAVITY)
        return np.concatenate([weight, np.cross(_LOAD.cog, weight)])

    def readings(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the load's present weight as wrenches (n, 6) [N, N·m] in sensor axes, one for each
        time t (n,) [s] and all equal, and the bits of saturated channels (n,), always 0."""
        return np.tile(self.wrench(), (len(t), 1)), np.zeros(len(t), dtype=np.uint32)

    def model_torques(
        self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray, gravity: np.ndarray
    ) -> np.ndarray:
        """Joint torques (J,) [N·m] that hold and accelerate the point load at joint values, speeds
        and accelerations q, qd, qdd (J,) [rad], under gravity (3,) [m/s²] in base axes."""
        if self._kinematics is None:
            return np.zeros(len(q))
        tool = np.concatenate([_LOAD.cog, NO_TOOL[3:]])
        jacobian = self._kinematics.jacobian(q, tool)[:3]
        turning = self._kinematics.jacobian_rate(q, qd, tool)[:3] @ qd
        return np.asarray(jacobian.T @ (_LOAD.mass * (jacobian @ qdd + turning - gravity)))


def known_arm(name: str) -> Arm:
    """Return the nominal data of a built-in robot such as ``ur5e``; `SettingError` if unknown."""
    if name == "medrue":  # a slide and five hinges, of whose poses nothing is asked
        linear = (True,) + (False,) * 5
        reach, speed = np.array([0.5] + [pi] * 5), np.array([0.1] + [0.5] * 5)
        return Arm(name, np.zeros(6), -reach, reach, speed, linear)
    if name not in _LENGTHS:
        known = ", ".join([*_LENGTHS, "medrue"])
        raise SettingError(f"{name}: the built-in plant knows {known}: give a plant of your own")
    d1, a2, a3, d4, d5, d6 = _LENGTHS[name]
    links = np.array([(0.0, a2, a3, 0.0, 0.0, 0.0), (d1, 0.0, 0.0, d4, d5, d6), _ALPHA]).T
    size = name.removesuffix("e").replace("16", "10")
    limit, speed = np.full(6, 2 * pi), np.deg2rad(_TOP_SPEEDS[size])
    return Arm(name, _HOME, -limit, limit, speed, links=links, payload=_LOAD)


def kinematic_plant(request: PlantRequest) -> KinematicPlant:
    """Make the built-in plant of the requested robot; `SettingError` if the robot is unknown."""
    return KinematicPlant(known_arm(request.robot), request.cycle)
