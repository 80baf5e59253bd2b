"""What gravity (and inertia) asks of the joints and of the base, from MuJoCo's own bodies."""

from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.interpolate import CubicSpline

from wrenchbed.robots.base import Robot, SimulatedRobot

_STEP = 1e-5


@dataclass(frozen=True, eq=False)
class Weights:
    """Torques that the joints carry (N, J) [N·m or N] and the moment on the base (N, 3) [N·m].

    Both are empty, (N, 0) and (N, 3) zeros, for a robot without a model.
    """

    torque: np.ndarray
    moment: np.ndarray


def weights(
    robot: Robot,
    theta: np.ndarray,
    q: np.ndarray,
    gravity: np.ndarray,
    t: np.ndarray | None = None,
    stride: int = 1,
) -> Weights:
    """Torque to hold the robot at (N, J); with times (N,) [s] and an open chain, to move it."""
    if not isinstance(robot, SimulatedRobot):
        return Weights(np.zeros((len(q), 0)), np.zeros((len(q), 3)))
    spec = robot.spec(theta)
    spec.option.gravity = gravity
    model = spec.compile()
    model.body_gravcomp[:] = 0.0
    model.dof_armature[:] = 0.0
    model.dof_damping[:] = 0.0
    model.dof_frictionloss[:] = 0.0
    model.actuator_gainprm[:] = model.actuator_biasprm[:] = 0.0  # implicit steps add their damping
    model.opt.disableflags |= (
        mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    )
    data = mujoco.MjData(model)
    pick = np.unique(np.append(np.arange(0, len(q), stride), len(q) - 1))
    chosen = q[pick]
    moment = _moments(robot, theta, model, data, chosen, gravity)
    if model.neq == 0 and model.nv == q.shape[1]:
        speed = acceleration = np.zeros_like(chosen)
        if t is not None:
            way = CubicSpline(t, q)
            speed, acceleration = way(t[pick], 1), way(t[pick], 2)
        torque = _inverse(model, data, chosen, speed, acceleration)
    else:
        torque = _energy_slope(robot, theta, model, data, chosen, gravity)
    if stride > 1 and t is not None:
        torque, moment = CubicSpline(t[pick], torque)(t), CubicSpline(t[pick], moment)(t)
    return Weights(torque, moment)


def link_forces(
    robot: SimulatedRobot,
    theta: np.ndarray,
    q: np.ndarray,
    gravity: np.ndarray,
    names: tuple[str, ...],
) -> np.ndarray:
    """Push (N, L) [N] of gravity that would lengthen each named link, by virtual work."""
    slopes = []
    for name in names:
        energy = []
        for step in (-_STEP, _STEP):
            moved = theta.copy()
            moved[robot.parameters.index(name)] += step
            spec = robot.spec(moved)
            model = spec.compile()
            data = mujoco.MjData(model)
            energy.append(_energy(model, data, robot.qpos(q, moved), gravity))
        slopes.append((energy[0] - energy[1]) / (2.0 * _STEP))
    return np.stack(slopes, axis=1)


def _inverse(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    q: np.ndarray,
    speed: np.ndarray,
    acceleration: np.ndarray,
) -> np.ndarray:
    torque = np.empty_like(q)
    for i in range(len(q)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[i], speed[i], acceleration[i]
        mujoco.mj_inverse(model, data)
        torque[i] = data.qfrc_inverse
    return torque


def _energy(
    model: mujoco.MjModel, data: mujoco.MjData, qpos: np.ndarray, gravity: np.ndarray
) -> np.ndarray:
    """Potential energy (N,) [J] of all bodies."""
    lift = np.outer(model.body_mass, -gravity)
    energy = np.empty(len(qpos))
    for i, row in enumerate(qpos):
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        energy[i] = np.einsum("ij,ij->", lift, data.xipos)
    return energy


def _energy_slope(
    robot: SimulatedRobot,
    theta: np.ndarray,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    q: np.ndarray,
    gravity: np.ndarray,
) -> np.ndarray:
    """∂V/∂q (N, J) along the closed chains, by central differences."""
    torque = np.empty_like(q)
    for j in range(q.shape[1]):
        step = _STEP * np.eye(q.shape[1])[j]
        high = _energy(model, data, robot.qpos(q + step, theta), gravity)
        low = _energy(model, data, robot.qpos(q - step, theta), gravity)
        torque[:, j] = (high - low) / (2.0 * _STEP)
    return torque


def _moments(
    robot: SimulatedRobot,
    theta: np.ndarray,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    q: np.ndarray,
    gravity: np.ndarray,
) -> np.ndarray:
    """Moment of all weights about the world's origin (N, 3) [N·m]."""
    qpos = robot.qpos(q, theta)
    moment = np.empty((len(q), 3))
    for i, row in enumerate(qpos):
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        first = model.body_mass @ data.xipos
        moment[i] = np.cross(first, gravity)
    return moment
