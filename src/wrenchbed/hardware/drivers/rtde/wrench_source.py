"""Sensors of a UR robot: the transducer of an option, the robot's wrench, the flange's pose."""

import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from wrenchbed import registry
from wrenchbed.errors import ParameterError
from wrenchbed.hardware.drivers.rtde.identity import TcpInFlange
from wrenchbed.hardware.drivers.rtde.shared_state import Snapshot
from wrenchbed.hardware.transducers.base import Transducer, WrenchSample, forms, transducer_at
from wrenchbed.robots.base import Robot

_APART_M, _APART_RAD = 5e-3, 0.02
"""Distance [m] and angle [rad] within which the TCP counts as the flange; estimates."""
_EVERY_S = 0.5
"""Time between two comparisons of TCP and flange [s]; estimate."""


class Flange:
    """Pose of the flange where the TCP is the flange; RTDE does not report the TCP's offset.

    The TCP counts as the flange where it is at the sensor pose of the nominal robot.
    """

    def __init__(self, robot: Robot) -> None:
        self._tcp = TcpInFlange(robot)
        self._due, self._same = 0.0, False
        self.trouble = ""
        """Why the arm is not the robot, as far as its poses say; empty where it may be."""

    def pose(self, state: Snapshot) -> np.ndarray | None:
        """x y z [m] and qw qx qy qz in the base; None where the TCP is elsewhere."""
        self.look(state)
        if not self._same:
            return None
        tcp = Rotation.from_rotvec(state.pose[3:])
        quaternion = tcp.as_quat(canonical=True, scalar_first=True)
        return np.concatenate([state.pose[:3], quaternion])

    def look(self, state: Snapshot) -> bool:
        """Compare TCP and flange, twice a second; whether they are one."""
        if time.monotonic() > self._due:
            self._due = time.monotonic() + _EVERY_S
            turn, place = self._tcp.now(state)
            self._same = bool(np.linalg.norm(place) < _APART_M and turn.magnitude() < _APART_RAD)
            self.trouble = self.trouble or self._tcp.trouble(state)
        return self._same


OWN = ("rtde", "ur-wrench")
"""Option values for the robot's own wrench."""


def transducer(sensor: str, host: str, source: Callable[[], WrenchSample]) -> Transducer:
    """The sensor that an option names.

    Raises:
        ParameterError: it names none; the message lists the forms.
    """
    if sensor in OWN:
        kind = registry.load("transducers", "ur-wrench")
        return kind(kind.options(source=source))
    if sensor in ("", "netft"):
        kind = registry.load("transducers", "netft")
        return kind(kind.options(host=host))
    if "://" not in sensor:
        raise ParameterError(f"sensor {sensor!r}: give netft, rtde, {forms()}")
    return transducer_at(sensor)


def reading(state: Snapshot, robot: Robot) -> WrenchSample:
    """The robot's own wrench of a state; the sensor's pose is that of the nominal robot."""
    wrench = np.array(state.raw)
    if not np.isfinite(wrench).all():
        rotations, origins = robot.sensor_pose(np.array([state.q]), robot.parameters.nominal)
        force, torque = np.array(state.force[:3]), np.array(state.force[3:])
        if state.major <= 3:  # about the TCP
            torque = torque + np.cross(np.array(state.pose[:3]) - origins[0], force)
        wrench = np.concatenate([force @ rotations[0], torque @ rotations[0]])
    return WrenchSample(
        state.t, state.stamp, int(state.received), 0.0, True, wrench, lost=int(state.skipped)
    )


_CB3_END, _E_END = (150.0, 30.0), (50.0, 10.0)
"""Where a robot's own wrench ends, force [N] and torque [N·m]; sources: a CB3's usual force limit,
whose torque is an estimate, and the range of the sensor in UR5e's data sheet."""


def full_scale(major: int) -> np.ndarray:
    """Where the robot's own wrench ends (6,) [N, N·m], by the version of its software."""
    return np.repeat(_CB3_END if major <= 3 else _E_END, 3)


def facts(state: Snapshot, controller: Mapping[str, Any]) -> Mapping[str, Any]:
    """How the controller states its wrench, before the change to the sensor's axes.

    Args:
        state: any.
        controller: its settings; a payload among them is what a compensated wrench lacks.
    """
    if np.isfinite(state.raw).all():
        return {
            "source": "ft_raw_wrench", "frame": "flange", "reference": "flange",
            "compensated": False,
        }  # fmt: skip
    estimated = state.major <= 3
    known = {"payload", "payload_cog"} <= controller.keys()
    payload = {"mass": controller["payload"], "cog": controller["payload_cog"]} if known else None
    return {
        "source": "actual_TCP_force",
        "frame": "base",
        "reference": "tcp" if estimated else "flange",
        "compensated": True,
        "estimated_from_currents": estimated,
        **({"payload": payload} if payload else {}),
    }
