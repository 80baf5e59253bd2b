"""Information of poses on a robot's accuracy, linear about the nominal robot."""

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from wrenchbed.calibration.accuracy import Goal, tip_jacobian
from wrenchbed.simulation.closed_form import Model

_TARGETS, _SEED = 200, 20_160_798
"""Poses at which accuracy is judged, and the seed that chooses them."""


def knowledge(model: Model, pool: np.ndarray, std: np.ndarray) -> "Knowledge":
    """What is known before any pose of a pool (N, J) is read with ``std`` (6,) [N, N·m]."""
    robot, nominal = model.robot, model.parameters.nominal
    columns = model.parameters.select(robot.free)
    scale = model.parameters.tolerance[list(columns)]
    rows = model.jacobian(pool, nominal, columns) * scale / std[:, None]
    target, rng = robot.target(), np.random.default_rng(_SEED)
    if target is not None:
        chosen = target[rng.permutation(len(target))[:_TARGETS]]
        unit, sensitivity = "m", tip_jacobian(robot, chosen, nominal, columns)
    else:
        q = robot.sample(_TARGETS, rng)
        unit, sensitivity = "N", model.jacobian(q, nominal, columns)[:, :3]
    weight = Goal(sensitivity * scale).weight
    return Knowledge(columns, unit, rows, weight, np.eye(len(columns)))


@dataclass(frozen=True, eq=False)
class Knowledge:
    """What some poses tell of the accuracy.

    Attributes:
        columns: parameters that differ from robot to robot.
        unit: of errors.
        rows: readings of each pose of the pool by the parameters, in noise and tolerances
            (N, 6, K).
        weight: trace(weight · covariance) is the mean square error (K, K).
        covariance: of the parameters in tolerances (K, K).
    """

    columns: tuple[int, ...]
    unit: str
    rows: np.ndarray
    weight: np.ndarray
    covariance: np.ndarray

    @cached_property
    def error(self) -> float:
        """Expected rms error [unit]."""
        return math.sqrt(np.vdot(self.weight, self.covariance))  # trace of the product

    @cached_property
    def value(self) -> float:
        """Information [nats]; grows with every informative pose."""
        return -math.log(self.error)

    @property
    def open(self) -> tuple[float, float]:
        """Least and mean remaining share of the initial uncertainty, 0 … 1."""
        std = np.sqrt(np.clip(self.covariance.diagonal(), 0.0, 1.0))
        return float(std.min()), float(std.sum()) / len(std)

    def with_pose(self, pose: int) -> "Knowledge":
        """After one more pose of the pool."""
        rows = self.rows[pose]
        half = rows @ self.covariance
        reading = half @ rows.T + np.eye(len(rows))  # with its noise
        smaller = self.covariance - half.T @ np.linalg.solve(reading, half)
        return replace(self, covariance=0.5 * (smaller + smaller.T))

    def gains(self) -> np.ndarray:
        """Rise of ``value`` by each pose of the pool (N,)."""
        half = self.rows @ self.covariance
        reading = np.eye(self.rows.shape[1]) + half @ np.swapaxes(self.rows, 1, 2)
        less = half @ self.weight @ np.swapaxes(half, 1, 2)
        off = np.trace(np.linalg.solve(reading, less), axis1=1, axis2=2)
        squared_error = np.maximum(self.error**2 - off, 1e-300)
        return np.asarray(-0.5 * np.log(squared_error) - self.value)
