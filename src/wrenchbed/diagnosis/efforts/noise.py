"""Noise of joint efforts: its size, its memory, and the filter that makes it white.

It is the residual of a fit of all columns, so that causes do not count as noise. Memory is that of
an autoregressive process (Yule–Walker equations; Brockwell & Davis 1991, Section 8.1).
"""

from dataclasses import dataclass

import numpy as np
import scipy  # which loads its slow submodules when they are first used
from scipy.linalg import solve_toeplitz

_ORDER = 4
"""Order of the autoregressive noise model: two resonances."""
_FLOOR = 1e-3
"""White noise added to the noise's variance (ratio): filters leave frequencies without any."""
RIDGE = 1e-6
"""Ridge of a fit, over each column's mean square: some columns are nearly collinear."""


@dataclass(frozen=True, eq=False)
class RowNoise:
    """Size and autocorrelation of one channel's noise.

    Attributes:
        std: standard deviation of one row's noise [N·m, of slides and forces N].
        filter: whitening filter (K,), which begins with 1.
        innovation: standard deviation of the filtered noise, unit of ``std``.
    """

    std: float
    filter: np.ndarray
    innovation: float

    def white(self, columns: np.ndarray) -> np.ndarray:
        """Signals (M, …) at M rows, filtered to white noise and divided by ``innovation``."""
        filtered = scipy.signal.lfilter(self.filter, [1.0], columns, axis=0)
        return np.asarray(filtered / self.innovation)


def row_noise(y: np.ndarray, left: np.ndarray, use: np.ndarray, columns: int) -> RowNoise:
    """Estimate the noise of one channel.

    Args:
        y: measured less predicted (M,) [N·m, of slides and forces N].
        left: residual of y after a fit of all columns (M,), zero where not used.
        use: rows to use (M,), boolean.
        columns: number of fitted columns.
    """
    rows = int(use.sum())
    std = float(np.std(left[use])) * float(np.sqrt(rows / max(rows - columns, 1)))
    std = max(std, 1e-9 * max(float(np.std(y)), 1e-3))
    kernel = _whitening(left)
    innovation = float(np.std(scipy.signal.lfilter(kernel, [1.0], left)[use]))
    return RowNoise(std, kernel, max(innovation, 1e-9 * std))


def remains(y: np.ndarray, columns: np.ndarray, use: np.ndarray) -> np.ndarray:
    """Residual of y (M,) after a least-squares fit of columns (M, K), with a small ridge, to the
    rows of ``use`` (M,), boolean; zero elsewhere."""
    scale = np.sqrt(np.maximum((columns**2).mean(axis=0), 1e-300))
    scaled = columns / scale
    some = scaled[use]
    gram = some.T @ some + RIDGE * len(y) * np.eye(columns.shape[1])
    return np.where(use, y - scaled @ np.linalg.solve(gram, some.T @ y[use]), 0.0)


def _whitening(residual: np.ndarray) -> np.ndarray:
    """Whitening filter (1 + K,) of a residual (M,) [N·m]: 1, −a₁, …, −a_K, where aₖ are the
    coefficients of the autoregressive process fitted to it."""
    n = len(residual)
    moments = np.array([residual[: n - k] @ residual[k:] / n for k in range(_ORDER + 1)])
    moments[0] *= 1.0 + _FLOOR
    if moments[0] <= 0.0:
        return np.array([1.0])
    return np.concatenate([[1.0], -solve_toeplitz(moments[:-1], moments[1:])])
