"""How large the parts of a structure are: its evidence over the scales of each."""

from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from wrenchbed.diagnosis.evidence import Level, gains


class Told(NamedTuple):
    """Log evidence, the scale of each part (p,), and the columns' information (k, k)."""

    total: float
    scale: np.ndarray
    information: np.ndarray

    def raised(self, by: float) -> "Told":
        """The same with a log prior added."""
        return self._replace(total=self.total + by)


def over_scales(
    level: Level, y: np.ndarray, columns: np.ndarray, owner: np.ndarray, fixed: np.ndarray,
    ladder: np.ndarray,
) -> Told:  # fmt: skip
    """Log evidence of one rung, summed over the scales of one part after the other.

    Args:
        level: the rung.
        y: linearised readings (6 R,).
        columns: slopes of all variables (6 R, k).
        owner: part of each column (k,).
        fixed: prior standard deviation of columns whose scale is known (k,), else 0.
        ladder: scales of each part that are tried (p, s).
    """
    solved = level.solve(np.column_stack([columns, y]))
    information, score = columns.T @ solved[:, :-1], columns.T @ solved[:, -1]
    start = -0.5 * float(y @ solved[:, -1] + level.log_det)
    best, total = np.median(ladder, axis=1), -np.inf
    for k in [*range(len(ladder)), *range(len(ladder) - 1)]:
        size = np.where(fixed > 0, fixed, best[owner])
        trial = np.repeat(size[None], ladder.shape[1], axis=0)
        trial[:, (owner == k) & (fixed == 0)] = ladder[k][:, None]
        blocks = np.broadcast_to(information, (len(trial), *information.shape))
        w = np.broadcast_to(score[:, None], (len(trial), len(score), 1))
        gain = gains(blocks, w, trial, np.ones(1))[:, 0, 0]
        best[k] = ladder[k][int(gain.argmax())]
        total = float(logsumexp(gain) - np.log(len(gain)))
    return Told(start + total, best, information)
