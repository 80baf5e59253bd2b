"""Adds a payload's weight back to a wrench from which a controller had subtracted it.

Metadata ``wrench`` state what was subtracted: ``compensated``, and ``payload`` with ``mass`` [kg]
and ``cog`` (3,) in flange axes [m]. Fitted without it, the tool would weigh nearly nothing.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from wrenchbed.data.recording import Recording
from wrenchbed.errors import CalibrationError
from wrenchbed.physics.rotations import matrix
from wrenchbed.physics.wrench import CHANNELS, Tool, weight
from wrenchbed.simulation.closed_form import Model, robot_of

_WRENCH, _RESTORED = "wrench", "restored"
_REMEDY = "record with payload 0, or with a Net F/T box (--sensor netft://HOST)"


def restored(recording: Recording) -> Recording:
    """Add the payload's weight that a controller subtracted back to a recording's wrench, by the
    nominal robot; return a recording without compensation unchanged. A `CalibrationError` if the
    subtracted payload is unknown, or the robot moved."""
    notes = recording.metadata.extra.get(_WRENCH)
    if not isinstance(notes, Mapping) or not notes.get("compensated") or notes.get(_RESTORED):
        return recording
    name, payload = recording.name, notes.get("payload")
    if not isinstance(payload, Mapping):
        raise CalibrationError(
            f"{name}: the controller subtracted the weight of its payload from the wrench, and "
            f"the recording does not say which payload: {_REMEDY}"
        )
    mass, cog = _stated(name, payload)
    if mass == 0.0:
        return recording
    if recording.metadata.mode == "dynamic":
        raise CalibrationError(
            f"{name}: the controller subtracted a payload of {mass:g} kg from the wrench; whether "
            f"it also subtracts the payload's inertia is not published: {_REMEDY}"
        )
    robot, pose = robot_of(recording), recording.metadata.sensor.pose_flange
    if pose is not None:
        cog = matrix(np.array(pose[3:])).T @ (cog - np.array(pose[:3]))
    gravity = np.asarray(Model.of(robot, recording.metadata).gravity)
    seen = robot.gravity_seen(recording.q, robot.parameters.nominal, gravity)
    load = weight(seen, Tool(np.array(mass), cog, np.zeros((3, 3)), np.array(0.0)))
    wrench = dict(zip(CHANNELS, (recording.wrench + load).T, strict=True))
    extra = {**recording.metadata.extra, _WRENCH: {**notes, _RESTORED: True}}
    metadata = replace(recording.metadata, extra=extra)
    return Recording(metadata, {**recording.columns, **wrench}, name)


def _stated(name: str, payload: Mapping[str, Any]) -> tuple[float, np.ndarray]:
    """Mass [kg] and CoG (3,) [m], flange axes, of a payload; errors begin with the ``name``."""
    try:
        mass, cog = float(payload["mass"]), np.array(payload["cog"], dtype=float)
    except (KeyError, TypeError, ValueError):
        mass, cog = np.nan, np.zeros(0)
    if not 0.0 <= mass < np.inf or cog.shape != (3,) or not np.isfinite(cog).all():
        raise CalibrationError(
            f"{name}: metadata wrench.payload must have mass [kg] and cog of three numbers [m]"
        )
    return mass, cog
