"""Edits of an MjSpec that every robot needs."""

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import mujoco
import numpy as np

from wrenchbed.errors import ParameterError
from wrenchbed.physics.rotations import quaternion
from wrenchbed.physics.wrench import Tool, physical_inertia

POINT = 1e-9
"""Moments of inertia of a point mass [kg·m²], since MuJoCo takes no 0; a hundred thousandth of a
small tool's."""


_FILES = 8
"""Parsed files that are kept: a process works on few robots."""
_TOUCHING = ("collision", "touched")
"""Classes of the shapes that touch, in the files of robots."""
STIFFNESS, DAMPING = 20000.0, 400.0
"""Stiffness and damping of a servo [N·m/rad, N·m·s/rad; N/m, N·s/m]: chosen, it holds still."""


def bare(path: Path) -> mujoco.MjSpec:
    """A file without what `frictionless` leaves out: a copy, so that it is parsed once."""
    return _bare(path, path.stat().st_mtime_ns).copy()


@lru_cache(_FILES)
def _bare(path: Path, _changed: int) -> mujoco.MjSpec:
    return frictionless(mujoco.MjSpec.from_file(str(path)))


def frictionless(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """Leave out what a file has for whoever opens it and what no record may depend on.

    That is contact and its shapes, dry and viscous friction of joints, and limits of the servos'
    forces. The same spec is returned.
    """
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    for geom in list(spec.geoms):
        if geom.classname.name in _TOUCHING:
            spec.delete(geom)
    for joint in (spec.default.joint, *spec.joints):  # joints may still be added
        joint.frictionloss = 0.0
        joint.damping = np.zeros_like(joint.damping)
    for servo in spec.actuators:
        servo.forcelimited = mujoco.mjtLimited.mjLIMITED_FALSE
    return spec


def servo_gains(home: float) -> dict[str, str]:
    """Attributes of a ``general`` actuator that holds a joint at ``home`` while its ctrl is 0.

    A model as opened, with all controls 0, so stays where it is.
    """
    bias = f"{STIFFNESS * home!r} {-STIFFNESS:g} {-DAMPING:g}"
    return {"biastype": "affine", "gainprm": f"{STIFFNESS:g}", "biasprm": bias}


def place(
    spec: mujoco.MjSpec, name: str, pos: Sequence[float], rotation: np.ndarray | None = None
) -> None:
    """Set a body's position (3,) [m] and rotation matrix (3, 3) in its parent."""
    body = spec.body(name)
    body.pos = [float(x) for x in pos]
    if rotation is not None:
        rotate_body(body, rotation)


def rotate_body(element: "mujoco.MjsBody | mujoco.MjsSite", rotation: np.ndarray) -> None:
    """Set the rotation matrix (3, 3) of a body or site in its parent."""
    element.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    element.quat = quaternion(rotation)


def six_of(inertia: np.ndarray) -> np.ndarray:
    """xx yy zz xy xz yz (6,) of a symmetric matrix (3, 3)."""
    return inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]


def write_load(spec: mujoco.MjSpec, tool: Tool) -> None:
    """Write the load into the bodies ``tool`` (frame = the sensor's) and ``sensor_side``.

    ``sensor_side`` is the part of the sensor that loads its own gauges, a point at its origin.

    Raises:
        ParameterError: the inertia is not that of any body.
    """
    six = six_of(np.asarray(tool.inertia, dtype=float))
    if not physical_inertia(six):
        raise ParameterError(f"tool.inertia xx yy zz xy xz yz = {six} kg·m² is that of no body")
    if not six.any():  # static data say nothing of it
        six[:3] = POINT
    body = spec.body("tool")
    body.mass = float(tool.mass)
    body.ipos = np.asarray(tool.cog, dtype=float)
    body.ialt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    body.iquat = [1.0, 0.0, 0.0, 0.0]
    body.inertia = [0.0, 0.0, 0.0]
    body.fullinertia = six
    spec.body("sensor_side").mass = float(tool.sensor_mass)
