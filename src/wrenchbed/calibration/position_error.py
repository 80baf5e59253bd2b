"""Position error of the tool, from the covariance of parameters; docs/studies (`scripts/studies`)
use it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrenchbed.physics.taylor_jets import STEP
from wrenchbed.robots.base import Robot, complex_steps

_DRAWS = 4000
"""Random draws behind a quantile: the 99 % quantile then rests on 40 of them."""
_ROWS_AT_ONCE = 20_000


def tip_jacobian(
    robot: Robot, q: np.ndarray, theta: np.ndarray, columns: Sequence[int]
) -> np.ndarray:
    """Derivative (N, 3, K) of the tool tip's position [m] by the parameters with indices
    ``columns``, exact; 0 for the sensor's parameters. A `NotFoundError` if the robot has no tool
    tip."""
    theta, result = robot.robot_theta(theta), np.zeros((len(q), 3, len(columns)))
    of_robot = [k for k, c in enumerate(columns) if c < len(theta)]
    at_once = max(1, _ROWS_AT_ONCE // max(len(q), 1))
    for first in range(0, len(of_robot), at_once):
        some = of_robot[first : first + at_once]
        tip = robot.tool_pose(q, complex_steps(theta, [columns[k] for k in some]))[1].imag / STEP
        result[:, :, some] = np.moveaxis(np.broadcast_to(tip, (len(some), len(q), 3)), 0, -1)
    return result


@dataclass(frozen=True, eq=False)
class Goal:
    """Derivatives (T, 3, K) of the tool's position [m] by parameters, at T poses that matter."""

    sensitivity: np.ndarray

    @property
    def weight(self) -> np.ndarray:
        """Mean GᵀG (K, K) over poses, G (3, K) a pose's derivatives: trace(weight · parameter
        covariance) is the mean square position error [m²]."""
        flat = self.sensitivity.reshape(-1, self.sensitivity.shape[-1])
        return flat.T @ flat / len(self.sensitivity)

    def rms(self, covariance: np.ndarray) -> float:
        """Root mean square position error [m] of parameters with a covariance (K, K)."""
        return float(np.sqrt(np.trace(self.weight @ covariance)))

    def errors(self, deviation: np.ndarray) -> np.ndarray:
        """Position errors (…, T) [m] of small deviations (…, K) of the parameters."""
        return np.linalg.norm(np.einsum("tik,...k->...ti", self.sensitivity, deviation), axis=-1)

    def quantile(self, covariance: np.ndarray, share: float) -> float:
        """Position error [m], rms over the poses, that a robot stays below with probability
        ``share`` if its parameters' errors have the covariance (K, K)."""
        ridge = 1e-15 * np.trace(self.weight) * np.eye(len(covariance))
        half = np.linalg.cholesky(self.weight + ridge)
        squares = np.clip(np.linalg.eigvalsh(half.T @ covariance @ half), 0.0, None)
        draws = np.random.default_rng(0).chisquare(1.0, (_DRAWS, len(squares)))
        return float(np.sqrt(np.quantile(draws @ squares, share)))


def statistics(errors: np.ndarray) -> np.ndarray:
    """Mean, maximum, standard deviation and rms of errors (…, T) → (…, 4)."""
    return np.stack(
        [
            errors.mean(axis=-1), errors.max(axis=-1), errors.std(axis=-1),
            np.sqrt((errors**2).mean(axis=-1)),
        ],
        axis=-1,
    )  # fmt: skip
