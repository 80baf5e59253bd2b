"""Slow wander of a sensor over a campaign: found in the poses' residual, heeded by the weights.

The mean of a hold is off by an independent part and by a part that wanders as 1/f noise does:
neighbouring holds are off together, and the bias of a whole campaign is known no better than the
wander lets it. Both levels are found per channel by restricted maximum likelihood (Patterson &
Thompson 1971, doi 10.1093/biomet/58.3.545), which knows that the fit has taken some of them away.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import sici

MOST_POSES = 1500
"""With more, the N × N eigenvectors cost more than they are worth."""
_DECADES_BELOW = 1.0
"""How far the 1/f band reaches below the inverse of the campaign's length."""
_RANGE = (-8.0, 12.0)
"""Natural logarithm of wander over independent variance that is searched."""


@dataclass(frozen=True, eq=False)
class Wander:
    """Variance of a hold's mean: independent part (6,), and 1/f level (6,) [N², (N·m)²].

    ``basis`` (N, N) and ``spread`` (N,) are the eigenvectors and eigenvalues of the 1/f kernel.
    """

    independent: np.ndarray
    level: np.ndarray
    basis: np.ndarray
    spread: np.ndarray

    def whiten(self, rows: np.ndarray) -> np.ndarray:
        """Rows (N, 6) or (N, 6, K) turned so that all have unit variance and none is correlated."""
        turned = np.tensordot(self.basis.T, rows, axes=1)
        root = np.sqrt(self.independent + self.level * self.spread[:, None])
        return turned / root.reshape(root.shape + (1,) * (rows.ndim - 2))

    @property
    def mean_variance(self) -> np.ndarray:
        """Variance (6,) of the best estimate of a constant."""
        ones = self.whiten(np.ones((len(self.spread), 6)))
        return 1.0 / (ones**2).sum(axis=0)


def kernel(t: np.ndarray) -> np.ndarray:
    """Covariance (N, N) at times (N,) [s] of unit 1/f noise, ∫ cos(2πfτ)/f df.

    The band reaches from a tenth of the inverse of the whole time to one cycle a pose; what is
    faster looks independent from pose to pose.
    """
    span = float(t[-1] - t[0])
    low, high = 10.0**-_DECADES_BELOW / span, len(t) / span
    lag = 2 * np.pi * np.abs(t[:, None] - t)
    np.fill_diagonal(lag, 1.0)
    result = sici(high * lag)[1] - sici(low * lag)[1]
    np.fill_diagonal(result, np.log(high / low))
    return np.asarray(result)


def estimate(t: np.ndarray, residual: np.ndarray, design: np.ndarray, least: np.ndarray) -> Wander:
    """Both levels of every channel.

    Args:
        t: mean times of the holds (N,) [s].
        residual: measured − fitted (N, 6).
        design: derivatives of the fit by its parameters (N, 6, K).
        least: variance that the independent part has at least (6,).
    """
    spread, basis = np.linalg.eigh(kernel(t))
    spread = np.maximum(spread, 0.0)
    independent, level = np.empty(6), np.empty(6)
    for c in range(6):
        x = _span(basis.T @ design[:, c, :])
        independent[c], level[c] = _levels(basis.T @ residual[:, c], x, spread, least[c])
    return Wander(independent, level, basis, spread)


def _span(design: np.ndarray) -> np.ndarray:
    """Orthonormal basis of the columns that move a channel."""
    u, s, _ = np.linalg.svd(design, full_matrices=False)
    return u[:, s > 1e-9 * max(s[0], 1e-300)]


def _levels(r: np.ndarray, x: np.ndarray, spread: np.ndarray, least: float) -> tuple[float, float]:
    """Independent variance and 1/f level of one channel, in the kernel's eigenvectors."""

    def variance(ratio: float) -> float:
        return _restricted(r, x, 1.0 / (1.0 + ratio * spread))[1]

    def cost(log_ratio: float) -> float:
        return _restricted(r, x, 1.0 / (1.0 + np.exp(log_ratio) * spread))[0]

    best = minimize_scalar(cost, bounds=_RANGE, method="bounded")
    none, _ = _restricted(r, x, np.ones_like(spread))
    ratio = float(np.exp(best.x)) if best.fun < none else 0.0
    alone = variance(ratio)
    return max(alone, least), ratio * alone


def _restricted(r: np.ndarray, x: np.ndarray, weight: np.ndarray) -> tuple[float, float]:
    """Restricted −log likelihood at weights (N,), and the variance of unit weight."""
    gram = x.T @ (weight[:, None] * x)
    right = x.T @ (weight * r)
    dof = len(r) - x.shape[1]
    square = float(r @ (weight * r) - right @ np.linalg.solve(gram, right)) / dof
    square = max(square, 1e-300)
    cost = dof * np.log(square) - np.log(weight).sum() + np.linalg.slogdet(gram)[1]
    return float(cost) / 2, square


def none_of(variance: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """Whitening of independent rows with a variance a channel (6,)."""
    root = np.sqrt(variance)
    return lambda rows: rows / root.reshape(root.shape + (1,) * (rows.ndim - 2))
