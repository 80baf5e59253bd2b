"""Evidence of hypotheses: exact marginal likelihoods of a linear Gaussian model.

y = E c + e with c ~ N(0, V), e ~ N(0, v₀ I). The background, small imperfections of all effects at
once, sits in V; a hypothesis widens V for its own columns. Only evidence beyond what imperfections
and the statement's tolerances explain counts (M-open view: Bernardo & Smith 1994, ch. 6).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve

LARGE = 1e4
"""Variance, in typical sizes, of a number that nobody states."""


@dataclass(frozen=True, eq=False)
class Level:
    """One level of background: K₀ = v₀ I + E V Eᵀ with diagonal V (n,).

    ``v0`` (R·6,) may differ from row to row.
    """

    E: np.ndarray
    v0: np.ndarray
    V: np.ndarray

    @cached_property
    def _factor(self) -> tuple[np.ndarray, bool]:
        scaled = (self.E * np.sqrt(self.V)) / np.sqrt(self.v0)[:, None]
        if len(self.v0) <= len(self.V):
            return cho_factor(np.eye(len(self.v0)) + scaled @ scaled.T, lower=True)
        return cho_factor(np.eye(len(self.V)) + scaled.T @ scaled, lower=True)

    @cached_property
    def log_det(self) -> float:
        """log |K₀|."""
        diagonal = np.diagonal(self._factor[0])
        return float(2 * np.log(diagonal).sum() + np.log(self.v0).sum())

    def solve(self, x: np.ndarray) -> np.ndarray:
        """K₀⁻¹ x for x (6 R, k)."""
        root = np.sqrt(self.v0)[:, None]
        z = x / root
        if len(self.v0) <= len(self.V):
            return np.asarray(cho_solve(self._factor, z) / root)
        scaled = (self.E * np.sqrt(self.V)) / root
        return np.asarray((z - scaled @ cho_solve(self._factor, scaled.T @ z)) / root)

    @cached_property
    def information(self) -> np.ndarray:
        """P = Eᵀ K₀⁻¹ E (n, n)."""
        p = self.E.T @ self._solved
        return (p + p.T) / 2

    @cached_property
    def _solved(self) -> np.ndarray:
        return self.solve(self.E)

    def score(self, y: np.ndarray) -> np.ndarray:
        """w = Eᵀ K₀⁻¹ y (n, C) of cases y (6 R, C)."""
        return np.asarray(self._solved.T @ y)

    def null(self, y: np.ndarray) -> np.ndarray:
        """log N(y; 0, K₀) of cases (6 R, C), without the constant in 2π."""
        return np.asarray(-0.5 * ((y * self.solve(y)).sum(axis=0) + self.log_det))


def gains(
    information: np.ndarray, score: np.ndarray, size: np.ndarray, scales: np.ndarray
) -> np.ndarray:
    """Log evidence gained by widening columns: batches of b hypotheses of k columns each.

    Args:
        information: P of the columns (b, k, k).
        score: w of the columns (b, k, C) for C cases.
        size: relative prior standard deviations (b, k).
        scales: multiples of it (s,) or (b, s).

    Returns:
        (b, s, C): −½ log|I + D½ P D½| + ½ uᵀ(I + D½ P D½)⁻¹u.
    """
    p = information * size[:, :, None] * size[:, None, :]
    values, vectors = np.linalg.eigh(p)
    u = np.swapaxes(vectors, -1, -2) @ (score * size[:, :, None])  # (b, k, C)
    square = np.broadcast_to(np.square(scales), (len(p), np.shape(scales)[-1]))
    ratio = 1.0 + square[:, :, None] * np.maximum(values, 0.0)[:, None, :]  # (b, s, k)
    fit = np.einsum("bsk,bkc->bsc", square[:, :, None] / ratio, u**2)
    return np.asarray(0.5 * (fit - np.log(ratio).sum(axis=-1)[:, :, None]))
