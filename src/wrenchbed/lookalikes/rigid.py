"""A rigid load on a moving sensor: poses by finite differences, then Newton's and Euler's laws."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from wrenchbed.robots.base import Robot

FINER = 4
"""Central differences step by the time between samples divided by this."""


@dataclass(frozen=True, eq=False)
class Load:
    """What the sensor carries: mass [kg], cog (3,) or (N, 3) [m], inertia (3, 3) [kg·m²]."""

    mass: float
    cog: np.ndarray
    inertia: np.ndarray
    sensor_mass: float


@dataclass(frozen=True, eq=False)
class Motion:
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

    def tilted(self, vector: np.ndarray) -> "Motion":
        """The whole robot turned in the world by rotation vectors (N, 3) or (3,) [rad]."""
        turn = Rotation.from_rotvec(np.atleast_2d(vector)).as_matrix()
        return Motion(
            turn @ self.rotation,
            rotate(turn, self.position),
            rotate(turn, self.acceleration),
            self.gravity,
            self.spin,
            self.turn,
        )

    def mounted(self, vector: np.ndarray) -> "Motion":
        """The sensor turned on its flange by a rotation vector (3,) or (N, 3) [rad]."""
        mount = Rotation.from_rotvec(np.atleast_2d(vector)).as_matrix()
        spin = None if self.spin is None else rotate_back(mount, self.spin)
        turn = None if self.turn is None else rotate_back(mount, self.turn)
        rotation = self.rotation @ mount
        return Motion(rotation, self.position, self.acceleration, self.gravity, spin, turn)


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


def stand(robot: Robot, theta: np.ndarray, q: np.ndarray, gravity: np.ndarray) -> Motion:
    """The sensor at rest at joint values (N, J)."""
    rotation, position = robot.sensor_pose(q, theta)
    position = np.broadcast_to(position, (len(q), 3))
    return Motion(rotation, position, np.zeros((len(q), 3)), gravity)


def follow(
    robot: Robot, theta: np.ndarray, t: np.ndarray, q: np.ndarray, gravity: np.ndarray
) -> Motion:
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
    return Motion(now, p1, acceleration, gravity, spin, turn)


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


def load_wrench(motion: Motion, load: Load) -> np.ndarray:
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
