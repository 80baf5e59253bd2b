"""Loads of a moving robot: on the sensor by Newton and Euler, on joints and base by MuJoCo.

Velocities and accelerations of the sensor come from finite differences of its pose.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from wrenchbed.benchmark.mujoco_loads import RigidBodies
from wrenchbed.physics.rotations import cross
from wrenchbed.physics.wrench import Tool
from wrenchbed.robots.base import Robot, SimulatedRobot

FINER = 4
"""Central differences in time step by the time between samples divided by this."""
_STEP = 1e-5
"""Step of central differences of potential energy [rad or m]: truncation and rounding are both
below 1e-9 of it."""


@dataclass(frozen=True, eq=False)
class SensorMotion:
    """Pose and motion of the sensor: R_world_sensor (N, 3, 3), its origin and that origin's
    acceleration in world axes (N, 3) [m, m/s²], gravity (3,), angular velocity and acceleration in
    sensor axes (N, 3) [rad/s, rad/s²], None at rest."""

    rotation: np.ndarray
    position: np.ndarray
    acceleration: np.ndarray
    gravity: np.ndarray
    spin: np.ndarray | None = None
    spin_rate: np.ndarray | None = None

    @property
    def specific_force(self) -> np.ndarray:
        """Gravity minus acceleration in sensor axes (N, 3) [m/s²]: Rᵀg at rest."""
        return rotate_back(self.rotation, self.gravity - self.acceleration)

    def tilted(self, vector: np.ndarray) -> "SensorMotion":
        """Motion with the whole robot rotated in the world by vectors (N, 3) or (3,) [rad]."""
        tilt = Rotation.from_rotvec(np.atleast_2d(vector)).as_matrix()
        return replace(
            self,
            rotation=tilt @ self.rotation,
            position=rotate(tilt, self.position),
            acceleration=rotate(tilt, self.acceleration),
        )

    def mounted(self, vector: np.ndarray) -> "SensorMotion":
        """Motion with the sensor rotated on its flange by a vector (3,) or (N, 3) [rad]."""
        mount = Rotation.from_rotvec(np.atleast_2d(vector)).as_matrix()
        spin, rate = (
            None if v is None else rotate_back(mount, v) for v in (self.spin, self.spin_rate)
        )
        return replace(self, rotation=self.rotation @ mount, spin=spin, spin_rate=rate)


def rotate(rotation: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Product R v for rotations (N, 3, 3) and vectors (N, 3)."""
    return (rotation @ vector[..., None])[..., 0]


def rotate_back(rotation: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Product Rᵀ v for rotations (N, 3, 3) and vectors (N, 3)."""
    return (vector[..., None, :] @ rotation)[..., 0, :]


def at_rest(robot: Robot, theta: np.ndarray, q: np.ndarray, gravity: np.ndarray) -> SensorMotion:
    """Pose of the sensor at joint values (N, J), at rest, with parameters (P,) or (N, P)."""
    rotation, position = robot.sensor_pose(q, theta)
    position = np.broadcast_to(position, (len(q), 3))
    return SensorMotion(rotation, position, np.zeros((len(q), 3)), gravity)


def in_motion(
    robot: Robot, theta: np.ndarray, t: np.ndarray, q: np.ndarray, gravity: np.ndarray
) -> SensorMotion:
    """Pose and motion of the sensor along a trajectory (N, J) at times (N,) [s]."""
    step = float(np.median(np.diff(t))) / FINER
    instants = np.concatenate([t - step, t, t + step])
    thrice = np.tile(theta, (3, 1)) if theta.ndim == 2 else theta
    rotation, position = robot.sensor_pose(CubicSpline(t, q)(instants), thrice)
    position = np.broadcast_to(position, (len(instants), 3))  # one for all where it is unknown
    before, now, after = np.split(rotation, 3)
    p0, p1, p2 = np.split(position, 3)
    acceleration = (p2 - 2.0 * p1 + p0) / step**2
    first, second = _rotation_vector(before, now) / step, _rotation_vector(now, after) / step
    spin, rate = (first + second) / 2.0, (second - first) / step
    return SensorMotion(now, p1, acceleration, gravity, spin, rate)


def _rotation_vector(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Rotation vectors (N, 3) [rad] of small rotations from start to end (N, 3, 3).

    Arcsine of their sine by its Taylor series, by definition x + x³/6 + 3x⁵/40.
    """
    r = np.swapaxes(start, -1, -2) @ end
    pairs = ((2, 1), (0, 2), (1, 0))
    sine = 0.5 * np.stack([r[:, i, j] - r[:, j, i] for i, j in pairs], axis=-1)
    square = (sine**2).sum(axis=-1, keepdims=True)
    return sine * (1.0 + square / 6.0 + 3.0 * square**2 / 40.0)


def load_wrench(motion: SensorMotion, load: Tool) -> np.ndarray:
    """Load on the sensor (N, 6) [N, N·m] of a tool whose CoG (3,) or (N, 3) may move."""
    specific = motion.specific_force
    if motion.spin is None or motion.spin_rate is None:
        force = load.mass * specific
        torque = cross(np.broadcast_to(load.cog, force.shape), force)
    else:
        spin, rate = motion.spin, motion.spin_rate
        lever = np.broadcast_to(load.cog, specific.shape)
        force = load.mass * (specific - cross(rate, lever) - cross(spin, cross(spin, lever)))
        momentum = spin @ load.inertia.T
        torque = cross(lever, force) - rate @ load.inertia.T - cross(spin, momentum)
    return np.concatenate([force + load.sensor_mass * specific, torque], axis=1)


class Weights(NamedTuple):
    """Torques that the joints carry (N, J) [N·m or N] and the moment on the base (N, 3) [N·m]."""

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
    """Loads at rest at q (N, J), or in motion at times (N,) [s] from every ``stride``-th row."""
    if not isinstance(robot, SimulatedRobot):
        return Weights(np.zeros((len(q), 0)), np.zeros((len(q), 3)))
    bodies = RigidBodies(robot, theta, gravity)
    pick = np.unique(np.append(np.arange(0, len(q), stride), len(q) - 1))
    chosen = q[pick]
    moment = np.array([np.cross(m, gravity) for m in bodies.first_moments(chosen)])
    if bodies.is_open:
        speed = acceleration = np.zeros_like(chosen)
        if t is not None:
            path = CubicSpline(t, q)
            speed, acceleration = path(t[pick], 1), path(t[pick], 2)
        torque = bodies.inverse(chosen, speed, acceleration)[0]
    else:
        torque = np.empty_like(chosen)
        for j, step in enumerate(_STEP * np.eye(q.shape[1])):
            high, low = bodies.energy(chosen + step), bodies.energy(chosen - step)
            torque[:, j] = (high - low) / (2.0 * _STEP)
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
    """Axial forces (N, L) [N] of gravity on L links (length parameters), positive in tension."""
    forces = []
    for name in names:
        energy = []
        for step in (-_STEP, _STEP):
            shifted = theta.copy()
            shifted[robot.parameters.index(name)] += step
            energy.append(RigidBodies(robot, shifted, gravity).energy(q))
        forces.append((energy[0] - energy[1]) / (2.0 * _STEP))
    return np.stack(forces, axis=1)
