"""How well one rigid load under gravity explains readings, as they are and after corrections.

Each correction that mixes channels is a matrix (6, 6) on the readings. So all fits come from the
same sums of products, made once: a fit costs the solution of ten equations.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from wrenchbed.physics.rigid_load_regressor import INERTIAL, Motion, motion_of, regressor
from wrenchbed.physics.taylor_jets import Jet, Value, value
from wrenchbed.robots.base import Robot

LEAST_LEVER = 0.02
"""Least swing of torques over that of forces [m] by which torques are judged: less comes of a cable
of 0.1 kg at 0.2 m, a wander of the zero and an imperfect geometry."""
SURE_OF_SIGNAL = 4.0
"""Standard deviations by which the scatter of forces must exceed that of their noise."""
LOUD = 5.0
"""Least swing of a channel over its noise at which it is judged by itself."""
_RIDGE = 1e-9


@dataclass(frozen=True, eq=False)
class Observed:
    """M observed wrenches of a robot that carries one load: poses at rest or samples of a motion.

    Attributes:
        robot, theta: robot model and its own parameters (P,).
        gravity: gravity in world axes (3,) [m/s²].
        q: joint values (M, J), orientations (M, 4), or a `Jet` of either in motion.
        y: readings (M, 6) [N, N·m].
        noise: standard deviation of an observation (6,), 0 where nothing is known.
        t, row: time [s] and index of the first row of each observation (M,).
        mass: configured mass of the tool [kg].
        stated: whether the metadata state the mass.
        cog: CoG that the metadata state (3,) [m], None if they do not.
        turns: whether the fit that follows finds the rotation of the sensor's mount by itself.
    """

    robot: Robot
    theta: np.ndarray
    gravity: np.ndarray
    q: Value
    y: np.ndarray
    noise: np.ndarray
    t: np.ndarray
    row: np.ndarray
    mass: float
    stated: bool
    cog: np.ndarray | None
    turns: bool

    def __len__(self) -> int:
        return len(self.y)

    def motion(self, q: Value) -> Motion:
        """Velocity and acceleration (less gravity) of the sensor at joint values or jets."""
        if isinstance(q, Jet):
            return motion_of(*self.robot.sensor_pose(q, self.theta), self.gravity)
        seen = -self.robot.gravity_seen(q, self.theta, self.gravity).T
        return Motion(seen, np.zeros_like(seen), np.zeros_like(seen))

    @cached_property
    def seen(self) -> Motion:
        """Velocity and acceleration of the sensor at the recorded joint values."""
        return self.motion(self.q)

    @cached_property
    def design(self) -> np.ndarray:
        """Regressor (M, 6, 10): the derivative of the readings by the ten inertial parameters."""
        return regressor(self.seen)

    @cached_property
    def rotation(self) -> np.ndarray:
        """Rotation R_world_sensor (M, 3, 3) of the sensor at each observation."""
        return np.asarray(value(self.robot.sensor_pose(value(self.q), self.theta)[0]))

    @cached_property
    def moments(self) -> "Moments":
        """Sums of products of regressor and readings, from which `Moments.fit` fits a load."""
        return Moments(self.design, self.y, self.noise)


@dataclass(frozen=True, eq=False)
class Load:
    """One rigid load under gravity, fitted to readings, with its residual.

    Attributes:
        phi: ten inertial parameters (10,): mass, first moments [kg m], moments of inertia [kg m²].
        share: residual beyond noise over the readings' variance, the larger of forces and torques,
            0 … 1; 1 for a load without mass and where the readings are only noise.
        left: rms residual of each channel (6,) [N, N·m].
        channel: ``share`` of each channel by itself (6,), 0 where it is only noise.
    """

    phi: np.ndarray
    share: float
    left: np.ndarray
    channel: np.ndarray


class Moments:
    """Sums over ``count`` rows of products of regressor D and readings y, both about their means.

    Attributes:
        design: D_cᵀ D_c of each channel c (6, 10, 10).
        mixed: D_cᵀ y_d of channels c, d (6, 6, 10).
        readings: y_cᵀ y_d (6, 6).
        noise: variance of an observation (6,), which no load explains.
    """

    def __init__(self, design: np.ndarray, y: np.ndarray, noise: np.ndarray) -> None:
        """Compute the sums for regressors (M, 6, 10), readings (M, 6) and their noise (6,)."""
        d, r = design - design.mean(axis=0), y - y.mean(axis=0)
        rows = np.moveaxis(d, 0, 2)  # (6, 10, M)
        self.design, self.mixed = rows @ np.swapaxes(rows, 1, 2), np.swapaxes(rows @ r, 1, 2)
        self.readings, self.count, self.noise = r.T @ r, len(y), np.square(noise)

    def fit(self, mend: np.ndarray | None = None, without: Sequence[int] = ()) -> Load:
        """Fit a load to readings mended by a matrix ``mend`` (6, 6); ``without``: unused channels.

        Forces weigh by their variance, torques by theirs or by that of a short lever.
        """
        use = np.array([c not in without for c in range(6)])
        return self._fits((np.eye(6) if mend is None else mend)[None], use[None])[0]

    def mended(self, mends: np.ndarray) -> list[Load]:
        """Fit a load after each of B corrections, matrices (B, 6, 6) on the readings."""
        return self._fits(mends, np.ones(mends.shape[:2], dtype=bool))

    def without_each(self) -> list[Load]:
        """Fit six loads, each without one of the six channels in turn."""
        return self._fits(np.broadcast_to(np.eye(6), (6, 6, 6)), ~np.eye(6, dtype=bool))

    def swing(self, phi: np.ndarray) -> np.ndarray:
        """Standard deviation (6,) [N, N·m] of the readings that a load phi (10,) would cause."""
        return np.asarray(np.sqrt(np.maximum(self._squares(phi[None])[0], 0.0) / self.count))

    def _squares(self, phi: np.ndarray) -> np.ndarray:
        """Sums of squares (B, 6), about the means, of readings that loads phi (B, 10) cause."""
        return np.asarray(((self.design @ phi.T) * phi.T).sum(axis=1).T)

    def _fits(self, p: np.ndarray, use: np.ndarray) -> list[Load]:
        """Fit B loads to readings mended by matrices p (B, 6, 6), each by the channels that its row
        of ``use`` (B, 6), boolean, marks."""
        mixed = np.swapaxes(np.swapaxes(p, 0, 1) @ self.mixed, 0, 1)  # (B, 6, 10)
        squares = ((p @ self.readings) * p).sum(axis=2)
        force, torque = _parts(squares * use)
        torque = np.maximum(torque, np.maximum(LEAST_LEVER**2 * force, 1e-300))
        scale = np.repeat(np.stack([np.maximum(force, 1e-300), torque], axis=1), 3, axis=1)
        weight = use / scale
        normal = (weight @ self.design.reshape(6, -1)).reshape(-1, INERTIAL, INERTIAL)
        diagonal = np.diagonal(normal, axis1=1, axis2=2)
        size = np.sqrt(np.maximum(diagonal, 1e-12 * diagonal.max(axis=1, keepdims=True)))
        scaled = normal / (size[:, :, None] * size[:, None]) + _RIDGE * np.eye(INERTIAL)
        right = (weight[:, None] @ mixed)[:, 0] / size
        phi = np.linalg.solve(scaled, right[..., None])[..., 0] / size
        rest = squares - 2.0 * (mixed @ phi[..., None])[..., 0] + self._squares(phi)
        rest = np.clip(rest, 0.0, None)
        noise = self.count * (np.square(p) @ self.noise)
        share = np.clip(np.maximum(*_parts((rest - noise) / scale * use)), 0.0, 1.0)
        chance = SURE_OF_SIGNAL * np.sqrt(2.0 / (3.0 * self.count))
        silent = _parts(squares - noise)[0] < chance * _parts(noise)[0]
        share[(phi[:, 0] <= 0.0) | silent] = 1.0  # a load has a mass
        heard = use & (squares > LOUD**2 * noise) & (squares > 0.0)
        channel = np.where(heard, (rest - noise) / np.maximum(squares, 1e-300), 0.0)
        residual, channel = np.sqrt(rest / self.count), np.clip(channel, 0.0, None)
        return [Load(*each) for each in zip(phi, share.tolist(), residual, channel, strict=True)]


def _parts(channels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sums of values (B, 6) over the three forces (B,) and over the three torques (B,)."""
    return channels[:, :3].sum(axis=1), channels[:, 3:].sum(axis=1)


def left_of_swing(residual: np.ndarray, y: np.ndarray) -> float:
    """Sum of squared residuals (M, 6) over that of the readings y (M, 6) about their means: of
    forces or of torques, whichever is larger."""
    remaining, swing = (residual**2).sum(axis=0), ((y - y.mean(axis=0)) ** 2).sum(axis=0)
    force, torque = float(swing[:3].sum()), float(swing[3:].sum())
    torque = max(torque, LEAST_LEVER**2 * force, 1e-300)
    return max(float(remaining[:3].sum()) / max(force, 1e-300), float(remaining[3:].sum()) / torque)
