"""The inertial parameters of an arm's links, from its MuJoCo model.

All that hangs on a link without a joint of the arm between them (flange, sensor, tool) is part of
it.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from wrenchbed.physics.newton_euler import INERTIAL
from wrenchbed.robots.base import SimulatedRobot


@dataclass(frozen=True, eq=False)
class LinkInertias:
    """Inertial parameters of an arm's links and motors.

    Attributes:
        phi: the ten parameters of `newton_euler` of each link (L, 10), in the axes and about the
            origin of `SimulatedRobot.link_frames`.
        rotor: inertia of each motor at the joint's side (J,) [kg·m² or kg], MuJoCo's ``armature``.
        passive: that of all joints (L,), zero at those with motors.
        names: of the links (L,), those of their bodies.
    """

    phi: np.ndarray
    rotor: np.ndarray
    passive: np.ndarray
    names: tuple[str, ...]


def link_inertias(robot: SimulatedRobot, theta: np.ndarray) -> LinkInertias:
    """Inertias of the links and motors of an arm with parameters theta (P,).

    Raises:
        NotFoundError: the model of the robot has no frames of links.
    """
    q = np.asarray(robot.home, dtype=float)[None]
    frames = [at_home(*frame) for frame in robot.link_frames(q, theta)]
    model = robot.spec(theta).compile()
    data = mujoco.MjData(model)
    data.qpos[:] = robot.qpos(q, theta)[0]
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    joint_of = _joint_of(model)
    phi = np.zeros((model.njnt, INERTIAL))
    for body in range(1, model.nbody):
        k = joint_of[body]
        if k >= 0:
            phi[k] += _seen(model, data, body, *frames[k])
    motors = [int(model.joint(joint.name).dofadr[0]) for joint in robot.joints]
    passive = model.dof_armature.copy()
    passive[motors] = 0.0
    names = tuple(model.body(int(b)).name for b in model.jnt_bodyid)
    return LinkInertias(phi, model.dof_armature[motors], passive, names)


def at_home(turn: np.ndarray, origin: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Axes (3, 3) and origin (3,) of a link in the world, of arrays with one row or none."""
    return np.broadcast_to(turn, (1, 3, 3))[0], np.broadcast_to(origin, (1, 3))[0]


def _joint_of(model: mujoco.MjModel) -> list[int]:
    """The last joint between the world and each body; −1 of a body that stands."""
    numbers = [-1] * model.nbody
    for body in range(1, model.nbody):
        own = model.body_jntnum[body]
        first = model.body_jntadr[body]
        numbers[body] = int(first + own - 1) if own else numbers[model.body_parentid[body]]
    return numbers


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
