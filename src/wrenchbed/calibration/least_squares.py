"""Least squares in the identifiable subspace: Gauss–Newton with step halving.

Each step has minimum norm in units of the parameters' tolerances, so unidentifiable directions keep
their initial value. Björck, Numerical Methods for Least Squares Problems (1996), Section 9.2.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from wrenchbed.calibration.observability import RANK_TOLERANCE

MAX_STEPS = 50
STEP_DONE = COST_DONE = 1e-11
"""Iteration ends after a step below this, in tolerances, or a cost that falls by a smaller
fraction: a hundred thousand times rounding, which numbers that people read never show."""
SAME = 1e-7
"""A step below this, in tolerances, changes no derivative that counts."""
BLIND = 1e-5
"""A parameter with more than this share in the null space is not identified by itself."""
_BLOCK = 1000
"""Rows of a block that are factorised together: what a processor's cache holds."""
HALVINGS = 30
"""Largest number of halvings of a step: it is then 1e-9 of itself and changes nothing."""


@dataclass(frozen=True, eq=False)
class Solution:
    """Result of a least-squares fit by `solve`.

    Attributes:
        x: parameters (K,).
        residual: whitened residual at x (M,).
        jacobian: whitened derivatives of the predicted readings, per tolerance (M, K).
        covariance: of x (K, K) for unit variance of the whitened residual, minimum norm.
        blind: fraction of each parameter that lies in the null space (K,), 0 … 1.
    """

    x: np.ndarray
    residual: np.ndarray
    jacobian: np.ndarray
    covariance: np.ndarray
    blind: np.ndarray
    rank: int
    steps: int
    converged: bool


def solve(
    residual: Callable[[np.ndarray], np.ndarray],
    jacobian: Callable[[np.ndarray], np.ndarray],
    start: np.ndarray,
    scale: np.ndarray,
) -> Solution:
    """Minimise ½|r(x)|² from ``start`` (K,). ``residual`` gives r, measured − predicted (M,), and
    ``jacobian`` ∂predicted/∂x (M, K), both whitened; ``scale`` (K,): size of each parameter."""
    x, r = start.copy(), residual(start)
    steps, converged, fresh = 0, False, False
    while steps < MAX_STEPS and not converged:
        steps += 1
        j = jacobian(x)
        triangle = triangular(np.column_stack([j, r]))[: len(x)]
        u, s, vt = np.linalg.svd(triangle[:, :-1] * scale, full_matrices=False)
        keep = s > RANK_TOLERANCE * s[0]
        step = vt[keep].T @ ((u[:, keep].T @ triangle[:, -1]) / s[keep])
        x, r, moved, gained = _halve(residual, x, r, step * scale)
        size = np.abs(step).max(initial=0.0)
        converged = bool(not moved or size < STEP_DONE or gained < COST_DONE)
        fresh = not moved or size < SAME
    if not fresh:
        j = jacobian(x)
        _, s, vt = np.linalg.svd(triangular(j) * scale, full_matrices=False)
        keep = s > RANK_TOLERANCE * s[0]
    seen = vt[keep].T
    covariance = (seen / s[keep] ** 2) @ seen.T * np.outer(scale, scale)
    blind = np.sqrt(np.clip(1.0 - (seen**2).sum(axis=1), 0.0, 1.0))
    return Solution(x, r, j * scale, covariance, blind, int(keep.sum()), steps, converged)


def triangular(rows: np.ndarray) -> np.ndarray:
    """Factor R of the QR decomposition of rows (M, K), block by block where they are many."""
    whole = len(rows) // _BLOCK * _BLOCK
    parts = rows[:whole].reshape(-1, _BLOCK, rows.shape[1])
    tops = np.asarray(np.linalg.qr(parts, mode="r")).reshape(-1, rows.shape[1])
    return np.asarray(np.linalg.qr(np.concatenate([tops, rows[whole:]]), mode="r"))


def _halve(
    residual: Callable[[np.ndarray], np.ndarray], x: np.ndarray, r: np.ndarray, step: np.ndarray
) -> tuple[np.ndarray, np.ndarray, bool, float]:
    """Try step, step/2, … from x (K,) until the cost does not rise: new x, its residual, whether
    one was found, and the fraction by which the cost fell."""
    cost = r @ r
    with np.errstate(all="ignore"):
        for _ in range(HALVINGS):
            trial = residual(x + step)
            new = trial @ trial
            if np.isfinite(new) and new <= cost:
                return x + step, trial, True, float((cost - new) / max(cost, 1e-300))
            step = step / 2
    return x, r, False, 0.0
