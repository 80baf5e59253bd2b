"""Noise of joint efforts: its size, its memory, and the filter that makes it white.

It is what the richest model leaves, so that causes do not count as noise. Memory is that of an
autoregressive process (Yule–Walker equations; Brockwell & Davis 1991, Section 8.1).
"""

from dataclasses import dataclass

import numpy as np
import scipy  # which loads its slow submodules when they are first used
from scipy.linalg import solve_toeplitz

_ORDER = 4
"""Order of the autoregressive noise model: two resonances."""
_FLOOR = 1e-3
"""White share that is added to its variance: filters leave bands without any."""
_RIDGE = 1e-6
"""Share of a column's square that is added to it in the fit of the richest model."""
_SLOW = (0.02, 0.06)
"""Speeds over the largest that bound bins of rows with a noise of their own: friction laws differ
most near reversals, within a few hundredths."""


@dataclass(frozen=True, eq=False)
class RowNoise:
    """Noise of one channel.

    Attributes:
        std: standard deviation of one row's noise [N·m].
        filter: whitening filter (K,), which begins with 1.
        innovation: standard deviation of the filtered noise [N·m].
        weight: of each row in a fit (M,), at most 1; smaller where the residual of the richest
            model is larger.
    """

    std: float
    filter: np.ndarray
    innovation: float
    weight: np.ndarray

    def white(self, columns: np.ndarray) -> np.ndarray:
        """Columns (M, …) in units of the innovations, weighted."""
        made = scipy.signal.lfilter(self.filter, [1.0], columns, axis=0) / self.innovation
        shape = (-1,) + (1,) * (columns.ndim - 1)
        return np.asarray(made * np.sqrt(self.weight).reshape(shape))


def row_noise(y: np.ndarray, columns: np.ndarray, speed: np.ndarray, use: np.ndarray) -> RowNoise:
    """Noise of one channel, from the residual of its torque y (M,) [N·m] after a fit of all columns
    (M, K), at joint speeds (M,); rows outside ``use`` (M,), boolean, get no weight.
    """
    residual, rows = remains(y, columns, use), int(use.sum())
    std = float(np.std(residual[use])) * float(np.sqrt(rows / max(rows - columns.shape[1], 1)))
    std = max(std, 1e-9 * max(float(np.std(y)), 1e-3))
    kernel = _whitening(residual)
    white = scipy.signal.lfilter(kernel, [1.0], residual)
    fast = np.abs(speed) / max(float(np.abs(speed).max()), 1e-12)
    level = float(np.var(white[use & (fast > _SLOW[-1])]))
    weight = use.astype(float)
    for low, high in zip((0.0, *_SLOW[:-1]), _SLOW, strict=True):
        slow = use & (fast >= low) & (fast < high)
        if slow.sum() > _ORDER:
            weight[slow] = min(1.0, level / max(float(np.var(white[slow])), 1e-300))
    innovation = max(float(np.sqrt(level)), 1e-9 * std)
    return RowNoise(std, kernel, innovation, weight)


def remains(y: np.ndarray, columns: np.ndarray, use: np.ndarray) -> np.ndarray:
    """Residual of y (M,) after a least-squares fit of columns (M, K), with a small ridge, to the
    rows of ``use`` (M,), boolean; zero elsewhere."""
    scale = np.sqrt(np.maximum((columns**2).mean(axis=0), 1e-300))
    scaled = columns / scale
    some = scaled[use]
    gram = some.T @ some + _RIDGE * len(y) * np.eye(columns.shape[1])
    return np.where(use, y - scaled @ np.linalg.solve(gram, some.T @ y[use]), 0.0)


def _whitening(residual: np.ndarray) -> np.ndarray:
    """Filter (1 + K,) that makes a residual (M,) [N·m] white: 1, −a₁, …, −a_K, where aₖ are the
    coefficients of the autoregressive process fitted to it."""
    n = len(residual)
    moments = np.array([residual[: n - k] @ residual[k:] / n for k in range(_ORDER + 1)])
    moments[0] *= 1.0 + _FLOOR
    if moments[0] <= 0.0:
        return np.array([1.0])
    return np.concatenate([[1.0], -solve_toeplitz(moments[:-1], moments[1:])])
