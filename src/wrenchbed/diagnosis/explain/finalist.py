"""How large the parts of a structure are: its evidence over the scales of each.

A structure after its refit: which hypotheses, their values, and what they leave.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from wrenchbed.diagnosis.evidence.dictionary import Hypothesis
from wrenchbed.diagnosis.evidence.likelihood import BackgroundLevel, gains


@dataclass(frozen=True, eq=False)
class Finalist:
    """A structure after its refit.

    Attributes:
        parts: its hypotheses.
        rung: background rung that fits best.
        x: fitted variables (k,) in typical sizes: amplitudes and shapes, no stated numbers.
        covariance: of ``design``'s columns (m, m), background and stated numbers included.
        residual: what is left (6 R,), whitened, the stated numbers' part still in it.
        y: the data as linearised at x (6 R,).
        design: derivatives of the response by x, then the columns of blamed stated numbers.
        spread: prior standard deviation of each (m,).
        log_posterior: summed over rungs and sizes.
        scale: size of each part's prior that fits best (parts,).
    """

    parts: tuple[Hypothesis, ...]
    rung: int
    x: np.ndarray
    covariance: np.ndarray
    residual: np.ndarray
    y: np.ndarray
    design: np.ndarray
    spread: np.ndarray
    log_posterior: float
    scale: np.ndarray

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(h.name for h in self.parts)


class ScaledEvidence(NamedTuple):
    """Log evidence, the scale of each part (p,), and the columns' information (k, k)."""

    total: float
    scale: np.ndarray
    information: np.ndarray

    def raised(self, by: float) -> "ScaledEvidence":
        """The same with a log prior added."""
        return self._replace(total=self.total + by)


def over_scales(
    level: BackgroundLevel,
    y: np.ndarray,
    columns: np.ndarray,
    owner: np.ndarray,
    fixed: np.ndarray,
    ladder: np.ndarray,
) -> ScaledEvidence:
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
    return ScaledEvidence(start + total, best, information)
