"""Edits of an MjSpec that every robot needs, and the inertial parameters of an arm's links."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import mujoco
import numpy as np

from wrenchbed.errors import ParameterError
from wrenchbed.physics.rigid_load_regressor import INERTIAL
from wrenchbed.physics.rotations import quaternion
from wrenchbed.physics.wrench import Tool, physical_inertia, six_of
from wrenchbed.robots.base import SimulatedRobot

POINT = 1e-9
"""Moments of inertia of a point mass [kg·m²], since MuJoCo takes no 0: 1e-5 of a small tool's."""
_FILES = 8
"""Parsed files that are kept: a process works on few robots."""
_TOUCHING = ("collision", "touched")
"""Names of the classes of collision shapes in robots' MJCF files."""
STIFFNESS, DAMPING = 20000.0, 400.0
"""Stiffness and damping of a servo [N·m/rad, N·m·s/rad; N/m, N·s/m], chosen to hold it still."""


def bare(path: Path) -> mujoco.MjSpec:
    """Read an MJCF file (once) and return a copy of its spec without contact and friction."""
    return _bare(path, path.stat().st_mtime_ns).copy()


@lru_cache(_FILES)
def _bare(path: Path, _changed: int) -> mujoco.MjSpec:
    return frictionless(mujoco.MjSpec.from_file(str(path)))


def frictionless(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """Remove contact and its shapes, dry and viscous friction of joints, and limits of servo forces
    from a spec, and return it. Files have these for viewers; no recording may depend on them."""
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


def compiled(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Compile a spec with textures of one pixel: painting takes ten times as long as the rest."""
    for texture in spec.textures:
        texture.width = texture.height = 1
    return spec.compile()


def place(
    spec: mujoco.MjSpec, name: str, pos: Sequence[float], rotation: np.ndarray | None = None
) -> None:
    """Set a body's position (3,) [m] and, if given, rotation matrix (3, 3) in its parent."""
    body = spec.body(name)
    body.pos = [float(x) for x in pos]
    if rotation is not None:
        rotate_body(body, rotation)


def rotate_body(element: "mujoco.MjsBody | mujoco.MjsSite", rotation: np.ndarray) -> None:
    """Set the rotation matrix (3, 3) of a body or site in its parent."""
    element.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    element.quat = quaternion(rotation)


def write_load(spec: mujoco.MjSpec, tool: Tool) -> None:
    """Write the load into the bodies ``tool`` (frame = the sensor's) and ``sensor_side`` of a spec:
    the part of the sensor that loads its own gauges, a point at its origin. A `ParameterError` if
    the inertia is not that of any body."""
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


@dataclass(frozen=True, eq=False)
class LinkInertias:
    """Inertial parameters of an arm's links and motors.

    Attributes:
        phi: the ten parameters of `newton_euler` of each link (L, 10), in the axes and about the
            origin of `SimulatedRobot.link_frames`.
        rotor: inertia of each motor at the joint's side (J,) [kg·m² or kg], MuJoCo's ``armature``.
        passive: ``armature`` of all joints (L,), zero at those with motors.
    """

    phi: np.ndarray
    rotor: np.ndarray
    passive: np.ndarray


def link_inertias(robot: SimulatedRobot, theta: np.ndarray) -> LinkInertias:
    """Read the inertias of an arm's links and motors from its MJCF at parameters theta (P,); a
    `NotFoundError` if its model has no frames of links. What hangs on a link without a joint
    between (flange, sensor, tool) is part of the link."""
    q = np.asarray(robot.home, dtype=float)[None]
    frames = [at_home(*frame) for frame in robot.link_frames(q, theta)]
    model = compiled(robot.spec(theta))
    data = mujoco.MjData(model)
    data.qpos[:] = robot.qpos(q, theta)[0]
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    phi, joint_of = np.zeros((model.njnt, INERTIAL)), [-1]  # the joint before each body, −1: none
    for body in range(1, model.nbody):
        last = int(model.body_jntadr[body] + model.body_jntnum[body] - 1)
        k = last if model.body_jntnum[body] else joint_of[model.body_parentid[body]]
        joint_of.append(k)
        if k >= 0:
            (turn, origin), mass = frames[k], float(model.body_mass[body])
            axes = turn.T @ data.ximat[body].reshape(3, 3)
            cog = turn.T @ (data.xipos[body] - origin)
            about = axes @ np.diag(model.body_inertia[body]) @ axes.T
            about += mass * (cog @ cog * np.eye(3) - np.outer(cog, cog))
            phi[k] += [mass, *(mass * cog), *six_of(about)]
    motors = [int(model.joint(joint.name).dofadr[0]) for joint in robot.joints]
    passive = model.dof_armature.copy()
    passive[motors] = 0.0
    return LinkInertias(phi, model.dof_armature[motors], passive)


def at_home(turn: np.ndarray, origin: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (3, 3) and origin (3,) of a frame, whose ``turn`` or ``origin`` may have one more
    axis, the first, of length 1."""
    return np.broadcast_to(turn, (1, 3, 3))[0], np.broadcast_to(origin, (1, 3))[0]
