"""Noise of joint efforts: its size, its memory, and the filter that makes it white.

It is what the richest model leaves, so that causes do not count as noise. Memory is that of an
autoregressive process (Yule–Walker equations; Brockwell & Davis 1991, Section 8.1).
"""

from dataclasses import dataclass

import numpy as np
from scipy import signal
from scipy.linalg import solve_toeplitz

_ORDER = 4
"""Order of the autoregressive noise model; estimate."""
_FLOOR = 1e-3
"""White share that is added to its variance: filters leave bands without any."""
_RIDGE = 1e-6
"""Share of a column's square that is added to it in the fit of the richest model."""
_SLOW = (0.02, 0.06)
"""Speeds over the largest that bound bins of rows with a noise of their own; estimate: friction
laws differ most near reversals."""


@dataclass(frozen=True, eq=False)
class JointNoise:
    """Noise of one joint.

    Attributes:
        std: of one row [N·m].
        filter: whitening filter (K,), which begins with 1.
        innovation: standard deviation after it [N·m].
        weight: of each row (M,) ≤ 1: less where the richest model leaves more.
    """

    std: float
    filter: np.ndarray
    innovation: float
    weight: np.ndarray

    def white(self, columns: np.ndarray) -> np.ndarray:
        """Columns (M, …) in units of the innovations, weighted."""
        made = signal.lfilter(self.filter, [1.0], columns, axis=0) / self.innovation
        shape = (-1,) + (1,) * (columns.ndim - 1)
        return np.asarray(made * np.sqrt(self.weight).reshape(shape))


def joint_noise(
    y: np.ndarray, columns: np.ndarray, speed: np.ndarray, use: np.ndarray
) -> JointNoise:
    """Noise of one joint, of what all columns (M, K) leave of its torque y (M,).

    Rows that are not of use (M,) have no weight.
    """
    left, rows = remains(y, columns, use), int(use.sum())
    std = float(np.std(left[use])) * float(np.sqrt(rows / max(rows - columns.shape[1], 1)))
    left = np.where(use, left, 0.0)
    std = max(std, 1e-9 * max(float(np.std(y)), 1e-3))
    kernel = _whitening(left)
    white = signal.lfilter(kernel, [1.0], left)
    fast = np.abs(speed) / max(float(np.abs(speed).max()), 1e-12)
    level = float(np.var(white[use & (fast > _SLOW[-1])]))
    weight = use.astype(float)
    for low, high in zip((0.0, *_SLOW[:-1]), _SLOW, strict=True):
        slow = use & (fast >= low) & (fast < high)
        if slow.sum() > _ORDER:
            weight[slow] = min(1.0, level / max(float(np.var(white[slow])), 1e-300))
    innovation = max(float(np.sqrt(level)), 1e-9 * std)
    return JointNoise(std, kernel, innovation, weight)


def remains(y: np.ndarray, columns: np.ndarray, use: np.ndarray) -> np.ndarray:
    """Residual of y (M,) after least squares with a small ridge on some rows (M,)."""
    scale = np.sqrt(np.maximum((columns**2).mean(axis=0), 1e-300))
    scaled = columns / scale
    some = scaled[use]
    gram = some.T @ some + _RIDGE * len(y) * np.eye(columns.shape[1])
    return np.asarray(y - scaled @ np.linalg.solve(gram, some.T @ y[use]))


def _whitening(left: np.ndarray) -> np.ndarray:
    """1, −a₁ … of the autoregressive process of a residual (M,)."""
    n = len(left)
    moments = np.array([left[: n - k] @ left[k:] / n for k in range(_ORDER + 1)])
    moments[0] *= 1.0 + _FLOOR
    if moments[0] <= 0.0:
        return np.array([1.0])
    return np.concatenate([[1.0], -solve_toeplitz(moments[:-1], moments[1:])])
