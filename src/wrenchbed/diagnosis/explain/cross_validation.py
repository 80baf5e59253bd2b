"""A second vote: how well an explanation predicts each block of rows from all the others.

Evidence weighs a prior as a whole; a block's predictive density depends only on what the other
blocks show (Vehtari, Gelman & Gabry 2017, 10.1007/s11222-016-9696-4). Of the linearised Gaussian
model both are exact: with the precision P of all rows and w = P y, log p(y_b | others) =
½ log|P_bb| − ½ w_bᵀ P_bb⁻¹ w_b.
"""

import numpy as np

from wrenchbed.diagnosis.evidence.likelihood import BackgroundLevel
from wrenchbed.diagnosis.explain.finalist import Finalist

MARGIN = 3.0
"""Difference of two scores (natural logarithm) from which one explanation predicts better."""


def predictive_score(level: BackgroundLevel, f: Finalist, block_rows: np.ndarray) -> float:
    """Sum over blocks of the log predictive density of each, without the constant in 2π.

    Args:
        level: the background that the finalist is judged against.
        f: the explanation.
        block_rows: block of each row of the fit (R,).
    """
    k = f.design.shape[1]
    solved = level.solve(np.column_stack([f.design, f.y]))
    normal = f.design.T @ solved[:, :k] + np.diag(1.0 / f.spread**2)
    half = np.linalg.solve(np.linalg.cholesky(normal), solved[:, :k].T)  # (k, 6 R)
    w = solved[:, k] - half.T @ (half @ f.y)
    block = np.repeat(block_rows, 6)
    total = 0.0
    for b in np.unique(block):
        rows = np.flatnonzero(block == b)
        total += _of_block(level, rows, half[:, rows], w[rows])
    return total


def _of_block(level: BackgroundLevel, rows: np.ndarray, half: np.ndarray, w: np.ndarray) -> float:
    """½ log|P_bb| − ½ w_bᵀ P_bb⁻¹ w_b; of many rows, P_bb is the unit matrix less a low rank."""
    if level.tall:
        root, ways = level.less(rows)
        ways = np.column_stack([ways, (half * root).T])
        if ways.shape[1] < len(rows):
            z = root * w
            inner = np.linalg.cholesky(np.eye(ways.shape[1]) - ways.T @ ways)
            along = np.linalg.solve(inner, ways.T @ z)
            size = np.log(np.diagonal(inner)).sum() - np.log(root).sum()
            return float(size - 0.5 * (z @ z + along @ along))
    lower = np.linalg.cholesky(level.precision(rows) - half.T @ half)
    away = np.linalg.solve(lower, w)
    return float(np.log(np.diagonal(lower)).sum() - 0.5 * away @ away)
