"""Sensors of a UR robot: the transducer of an option, and the robot's own wrench."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from wrenchbed import registry
from wrenchbed.errors import ParameterError
from wrenchbed.hardware.drivers.rtde.shared_state import Snapshot
from wrenchbed.hardware.transducers.base import Transducer, WrenchSample, forms, transducer_at
from wrenchbed.robots.base import Robot

OWN = ("rtde", "ur-wrench")
"""Option values for the robot's own wrench."""
_CB3_END, _E_END = (150.0, 30.0), (50.0, 10.0)
"""Where a robot's own wrench ends, force [N] and torque [N·m]; sources: a CB3's usual force limit,
whose torque is that force 0.2 m from the flange, and the sensor's range in UR5e's data sheet."""


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
