"""A rigid load on a moving sensor: poses by finite differences, then Newton's and Euler's laws.

What gravity (and inertia) asks of the joints and of the base, from MuJoCo's own bodies.
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from wrenchbed.robots.base import Robot, SimulatedRobot

FINER = 4
"""Central differences step by the time between samples divided by this."""


@dataclass(frozen=True, eq=False)
class RigidLoad:
    """What the sensor carries: mass [kg], cog (3,) or (N, 3) [m], inertia (3, 3) [kg·m²]."""

    mass: float
    cog: np.ndarray
    inertia: np.ndarray
    sensor_mass: float


@dataclass(frozen=True, eq=False)
class SensorMotion:
    """Pose of the sensor and how it moves.

    Attributes:
        rotation: R_world_sensor (N, 3, 3).
        position: the sensor's origin in the world (N, 3) [m].
        acceleration: of the origin, world axes (N, 3) [m/s²].
        gravity: world axes (3,) [m/s²].
        spin: angular velocity in sensor axes (N, 3) [rad/s], None at rest.
        turn: angular acceleration in sensor axes (N, 3) [rad/s²], None at rest.
    """

    rotation: np.ndarray
    position: np.ndarray
    acceleration: np.ndarray
    gravity: np.ndarray
    spin: np.ndarray | None = None
    turn: np.ndarray | None = None

    @property
    def felt(self) -> np.ndarray:
        """The specific force in sensor axes (N, 3) [m/s²]: Rᵀg at rest."""
        return rotate_back(self.rotation, self.gravity - self.acceleration)

    def tilted(self, vector: np.ndarray) -> "SensorMotion":
        """The whole robot turned in the world by rotation vectors (N, 3) or (3,) [rad]."""
        turn = Rotation.from_rotvec(np.atleast_2d(vector)).as_matrix()
        return SensorMotion(
            turn @ self.rotation,
            rotate(turn, self.position),
            rotate(turn, self.acceleration),
            self.gravity,
            self.spin,
            self.turn,
        )

    def mounted(self, vector: np.ndarray) -> "SensorMotion":
        """The sensor turned on its flange by a rotation vector (3,) or (N, 3) [rad]."""
        mount = Rotation.from_rotvec(np.atleast_2d(vector)).as_matrix()
        spin = None if self.spin is None else rotate_back(mount, self.spin)
        turn = None if self.turn is None else rotate_back(mount, self.turn)
        rotation = self.rotation @ mount
        return SensorMotion(rotation, self.position, self.acceleration, self.gravity, spin, turn)


def rotate(rotation: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """R v for (N, 3, 3) and (N, 3)."""
    return (rotation @ vector[..., None])[..., 0]


def rotate_back(rotation: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Rᵀ v for (N, 3, 3) and (N, 3)."""
    return (vector[..., None, :] @ rotation)[..., 0, :]


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a × b over the last axis."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


def stand(robot: Robot, theta: np.ndarray, q: np.ndarray, gravity: np.ndarray) -> SensorMotion:
    """The sensor at rest at joint values (N, J)."""
    rotation, position = robot.sensor_pose(q, theta)
    position = np.broadcast_to(position, (len(q), 3))
    return SensorMotion(rotation, position, np.zeros((len(q), 3)), gravity)


def follow(
    robot: Robot, theta: np.ndarray, t: np.ndarray, q: np.ndarray, gravity: np.ndarray
) -> SensorMotion:
    """The sensor along a trajectory of samples (N, J) at times (N,) [s]."""
    step = float(np.median(np.diff(t))) / FINER
    way = CubicSpline(t, q)
    instants = np.concatenate([t - step, t, t + step])
    thrice = np.tile(theta, (3, 1)) if theta.ndim == 2 else theta
    rotation, position = robot.sensor_pose(way(instants), thrice)
    before, now, after = np.split(rotation, 3)
    p0, p1, p2 = np.split(position, 3)
    acceleration = (p2 - 2.0 * p1 + p0) / step**2
    first, second = _turned(before, now) / step, _turned(now, after) / step
    spin, turn = (first + second) / 2.0, (second - first) / step
    return SensorMotion(now, p1, acceleration, gravity, spin, turn)


def _turned(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Rotation vectors (N, 3) [rad] of small turns from start to end (N, 3, 3)."""
    r = np.swapaxes(start, -1, -2) @ end
    sine = 0.5 * np.stack(
        [
            r[:, 2, 1] - r[:, 1, 2],
            r[:, 0, 2] - r[:, 2, 0],
            r[:, 1, 0] - r[:, 0, 1],
        ],
        axis=-1,
    )
    square = (sine**2).sum(axis=-1, keepdims=True)
    return sine * (1.0 + square / 6.0 + 3.0 * square**2 / 40.0)


def load_wrench(motion: SensorMotion, load: RigidLoad) -> np.ndarray:
    """Load on the sensor (N, 6) [N, N·m], torque about the sensor's origin."""
    felt, cog = motion.felt, load.cog
    if motion.spin is None or motion.turn is None:
        force = load.mass * felt
        torque = cross(np.broadcast_to(cog, force.shape), force)
    else:
        spin, turn = motion.spin, motion.turn
        lever = np.broadcast_to(cog, felt.shape)
        force = load.mass * (felt - cross(turn, lever) - cross(spin, cross(spin, lever)))
        momentum = spin @ load.inertia.T
        torque = cross(lever, force) - turn @ load.inertia.T - cross(spin, momentum)
    return np.concatenate([force + load.sensor_mass * felt, torque], axis=1)


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
