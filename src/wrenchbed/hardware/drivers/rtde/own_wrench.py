"""Sensors of a UR robot: the transducer of an option, and the robot's own wrench over RTDE.

If the controller has ``ft_raw_wrench`` (e-Series from 5.9), it is used as it is: the flange sensor,
not compensated for the payload. Else ``actual_TCP_force``: in the base's axes, without the
payload's weight; about the TCP on a CB3, which estimates it from motor currents to some ten
newtons, and about the flange on an e-Series. Both count as the load of the world on the tool side;
check the sign once on the robot's software version by a push.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from wrenchbed.errors import LinkError, ParameterError
from wrenchbed.hardware.device_base import Health, by_age
from wrenchbed.hardware.drivers.rtde.states import Snapshot
from wrenchbed.hardware.transducers.base import Transducer, WrenchSample
from wrenchbed.hardware.transducers.netft.transducer import (
    FORM,
    NetftOptions,
    NetftTransducer,
    at_address,
)
from wrenchbed.robots.base import Robot

OWN = ("rtde", "ur-wrench")
"""Values of the option ``sensor`` for the robot's own wrench."""
_MOST = 64
"""Most past states that one reading converts: 1/8 s at 500 Hz, which takes some milliseconds."""
CB3_END, E_END = (150.0, 30.0), (50.0, 10.0)
"""Ranges of a robot's own wrench, force [N] and torque [N·m]; sources: a CB3's usual force limit,
whose torque is that force 0.2 m from the flange, and the sensor's range in UR5e's data sheet."""


class OwnWrench(Transducer):
    """Transducer of a UR robot's own wrench, in the axes of the nominal robot's sensor about its
    origin; ``since`` returns the states after a time [s], oldest first, without blocking."""

    name = "ur-wrench"
    title = "a UR robot's own wrench over RTDE"

    def __init__(self, robot: Robot, since: Callable[[float], Sequence[Snapshot]]) -> None:
        super().__init__()
        self._robot, self._since = robot, since
        self._newest: WrenchSample | None = None

    def _connect(self) -> None:
        self._read()

    def _close(self) -> None:
        self._past.clear()
        self._newest = None

    def _read(self) -> WrenchSample:
        after = -np.inf if self._newest is None else self._newest.t
        for state in self._since(after)[-_MOST:]:
            self._newest = reading(state, self._robot)
            self._past.add(self._newest.t, self._newest.wrench)
        if self._newest is None:
            raise LinkError("the robot has sent no state: call recover()")
        return self._newest

    def _health(self) -> Health:
        sample = self._read()
        counters = {"readings": float(sample.sequence), "lost": float(sample.lost)}
        return by_age(time.monotonic() - sample.t, "the robot's own wrench", counters)


def transducer(sensor: str, host: str, own: OwnWrench) -> Transducer:
    """Make the transducer that option ``sensor`` names: ``own`` for the robot's own wrench, else a
    Net F/T box, by default at ``host``; a `ParameterError` if the option names no sensor."""
    if sensor in OWN:
        return own
    if sensor in ("", "netft"):
        return NetftTransducer(NetftOptions(host))
    if "://" not in sensor:
        raise ParameterError(f"sensor {sensor!r}: give netft, rtde, {FORM}")
    return at_address(sensor)


def reading(state: Snapshot, robot: Robot) -> WrenchSample:
    """Convert the wrench in a state to a sample in the axes of the nominal ``robot``'s sensor."""
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


def facts(state: Snapshot, controller: Mapping[str, Any]) -> Mapping[str, Any]:
    """Recording metadata on how the controller states its wrench: source output, axes, reference
    point and, if it compensates for a payload, which (from ``controller``, its own facts by
    name)."""
    if np.isfinite(state.raw).all():
        raw = {"source": "ft_raw_wrench", "frame": "flange", "reference": "flange"}
        return raw | {"compensated": False}
    estimated = state.major <= 3
    stated: dict[str, Any] = {
        "source": "actual_TCP_force", "frame": "base", "compensated": True,
        "reference": "tcp" if estimated else "flange", "estimated_from_currents": estimated,
    }  # fmt: skip
    if {"payload", "payload_cog"} <= controller.keys():
        stated["payload"] = {"mass": controller["payload"], "cog": controller["payload_cog"]}
    return stated
