"""A second vote: how well an explanation foretells each block of rows from all the others.

Evidence weighs a whole prior; a block's predictive density only asks what the other blocks taught
(Vehtari, Gelman & Gabry 2017, 10.1007/s11222-016-9696-4). Of the linearised Gaussian model both
are exact: with the precision P of all rows and w = P y, log p(y_b | rest) = ½ log|P_bb| −
½ w_bᵀ P_bb⁻¹ w_b.
"""

import numpy as np

from wrenchbed.diagnosis.evidence import Level
from wrenchbed.diagnosis.finalist import Finalist
from wrenchbed.diagnosis.refit import Refitter

MARGIN = 3.0
"""An explanation must foretell so much better (natural logarithm) to be called the better one."""


def score(refitter: Refitter, f: Finalist) -> float:
    """Sum over blocks of the log predictive density of each, without the constant in 2π."""
    level = refitter.level_of(f)
    k = f.design.shape[1]
    solved = level.solve(np.column_stack([f.design, f.y]))
    normal = f.design.T @ solved[:, :k] + np.diag(1.0 / f.spread**2)
    half = np.linalg.solve(np.linalg.cholesky(normal), solved[:, :k].T)  # (k, 6 R)
    w = solved[:, k] - half.T @ (half @ f.y)
    block = np.repeat(refitter.d.prepared.block_rows, 6)
    total = 0.0
    for b in np.unique(block):
        rows = np.flatnonzero(block == b)
        total += _of_block(level, rows, half[:, rows], w[rows])
    return total


def _of_block(level: Level, rows: np.ndarray, half: np.ndarray, w: np.ndarray) -> float:
    """½ log|P_bb| − ½ w_bᵀ P_bb⁻¹ w_b; of many rows, P_bb is the unit matrix less a few ways."""
    if level.tall:
        root, ways = level.less(rows)
        ways = np.column_stack([ways, (half * root).T])
        if ways.shape[1] < len(rows):
            z = root * w
            inner = np.linalg.cholesky(np.eye(ways.shape[1]) - ways.T @ ways)
            along = np.linalg.solve(inner, ways.T @ z)
            size = np.log(np.diagonal(inner)).sum() - np.log(root).sum()
            return float(size - 0.5 * (z @ z + along @ along))
    own = np.linalg.cholesky(level.precision(rows) - half.T @ half)
    away = np.linalg.solve(own, w)
    return float(np.log(np.diagonal(own)).sum() - 0.5 * away @ away)
