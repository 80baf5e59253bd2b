"""The inertial parameters of an arm's links, from its MuJoCo model.

All that hangs on a link without a joint of the arm between them (flange, sensor, tool) is part of
it.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from wrenchbed.errors import NotFoundError
from wrenchbed.physics.newton_euler import INERTIAL
from wrenchbed.robots.base import SimulatedRobot
from wrenchbed.robots.chain import SerialChain


@dataclass(frozen=True, eq=False)
class LinkInertias:
    """What an arm weighs.

    Attributes:
        phi: the ten parameters of `newton_euler` of each link (J, 10), in the axes and about the
            origin of `SerialChain.frames`.
        rotor: inertia of each motor at the joint's side (J,) [kg·m² or kg], MuJoCo's ``armature``.
    """

    phi: np.ndarray
    rotor: np.ndarray


def link_inertias(robot: SimulatedRobot, theta: np.ndarray) -> LinkInertias:
    """Of a serial arm with parameters theta (P,).

    Raises:
        NotFoundError: the robot is no serial chain.
    """
    if not isinstance(robot, SerialChain):
        raise NotFoundError(f"robot {robot.name!r} is no serial arm: its joints have no torques")
    model = robot.spec(theta).compile()
    data = mujoco.MjData(model)
    q = np.asarray(robot.home, dtype=float)[None]
    data.qpos[:] = robot.qpos(q, theta)[0]
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    frames = [_at_home(*frame) for frame in robot.frames(q, theta)]
    joint_of = _joint_of(model)
    phi = np.zeros((len(robot.joints), INERTIAL))
    for body in range(1, model.nbody):
        k = joint_of[body]
        if k >= 0:
            phi[k] += _seen(model, data, body, *frames[k])
    return LinkInertias(phi, model.dof_armature.copy())


def _at_home(*vectors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Axes (3, 3) and origin (3,) of a link in the world, of vectors (1, 3) or (3,)."""
    x, y, z, origin = (np.broadcast_to(v, (1, 3))[0] for v in vectors)
    return np.stack([x, y, z], axis=-1), origin


def _joint_of(model: mujoco.MjModel) -> list[int]:
    """The last joint between the world and each body; −1 of a body that stands."""
    found = [-1] * model.nbody
    for body in range(1, model.nbody):
        own = model.body_jntnum[body]
        first = model.body_jntadr[body]
        found[body] = int(first + own - 1) if own else found[model.body_parentid[body]]
    return found


def _seen(
    model: mujoco.MjModel, data: mujoco.MjData, body: int, turn: np.ndarray, origin: np.ndarray
) -> np.ndarray:
    """The ten parameters (10,) of a body in axes (3, 3) about an origin (3,) of the world."""
    mass = float(model.body_mass[body])
    axes = turn.T @ data.ximat[body].reshape(3, 3)
    cog = turn.T @ (data.xipos[body] - origin)
    about = axes @ np.diag(model.body_inertia[body]) @ axes.T
    about = about + mass * (cog @ cog * np.eye(3) - np.outer(cog, cog))
    second = [about[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    return np.array([mass, *(mass * cog), *second])
