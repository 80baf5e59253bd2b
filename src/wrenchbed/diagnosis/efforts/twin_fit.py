"""The better simulator: stated values within their ordinary spread, and the claimed causes alone.

Nothing else is free, so that what it leaves is what nobody named.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrenchbed.diagnosis.efforts.dictionary import Dictionary

ORDINARY = 2.0
"""Spreads beyond which a stated value is wrong: 95 % of ordinary robots lie within."""
MEMORY = 10.0
"""Rows of noise that are worth one: spreads count so much more beside rows; estimate."""
_ROUNDS = 6
"""Largest number of passes that fix amplitudes which leave their range."""
_RIDGE = 1e-8
"""Share of a column's square that is added to it: columns may be alike."""


@dataclass(frozen=True, eq=False)
class TwinFit:
    """Amplitudes of a simulator with some causes.

    Attributes:
        x: of all columns (P,), zero where they take no part.
        used: indices of the columns that are free (K,).
        errors: of all amplitudes (S, P) where one stated value is off by its ordinary spread.
    """

    x: np.ndarray
    used: np.ndarray
    errors: np.ndarray


def fitted(d: Dictionary, blocks: Sequence[int], without: int | None = None) -> TwinFit:
    """Fit ordinary values and some causes.

    Args:
        d: columns.
        blocks: causes that are free without bounds.
        without: block of time that is held out, if any.
    """
    gram, right = d.plain_sums
    if without is not None:
        gram, right = gram - d.plain[0][without], right - d.plain[1][without]
    own = np.unique(np.concatenate([np.zeros(0, int), *(d.at[b] for b in blocks)]))
    unbounded = np.union1d(np.flatnonzero(d.free), own)
    bounded = np.setdiff1d(np.flatnonzero(d.stated), unbounded)
    x = np.zeros(len(d.names))
    used = np.union1d(unbounded, bounded)
    for _ in range(_ROUNDS):
        fixed = x.copy()
        fixed[used] = 0.0
        held = np.isin(used, bounded)
        prior = np.where(held, MEMORY / np.maximum(d.std[used], 1e-300) ** 2, 0.0)
        covariance = _inverse(gram[np.ix_(used, used)] + np.diag(prior))
        x[used] = covariance @ (right[used] - gram[used] @ fixed)
        errors = _errors(d, used, bounded, gram, covariance)
        most = ORDINARY * d.std
        off = [k for k in used if k in set(bounded.tolist()) and abs(x[k]) > most[k]]
        if not off:
            break
        x[off] = np.sign(x[off]) * most[off]
        used = np.setdiff1d(used, off)
    return TwinFit(x, used, errors)


def _errors(
    d: Dictionary, used: np.ndarray, bounded: np.ndarray, gram: np.ndarray, covariance: np.ndarray
) -> np.ndarray:
    """`TwinFit.errors`: what a fit takes for another value, less what was off."""
    errors = np.zeros((len(bounded), len(d.names)))
    errors[:, used] = gram[np.ix_(bounded, used)] @ covariance
    errors[np.arange(len(bounded)), bounded] -= 1.0
    return d.std[bounded, None] * errors


def _inverse(gram: np.ndarray) -> np.ndarray:
    scale = np.sqrt(np.maximum(np.diagonal(gram), 1e-300))
    scaled = gram / np.outer(scale, scale) + _RIDGE * np.eye(len(gram))
    return np.asarray(np.linalg.inv(scaled) / np.outer(scale, scale))


def added(d: Dictionary, fit: TwinFit, block: int) -> float:
    """Gap that a cause adds at the joint where it is largest, after the columns that every fit
    leaves free are fitted to it there.

    Columns shared by all joints are known from the other joints, so they take up no part of a
    cause in one drive.
    """
    joint = d.blocks[block].joint
    if joint is not None and bool((d.joint[d.at[block]] >= 0).all()):
        return _added(d, fit, block, joint - 1, d.free & (d.joint >= 0))
    return max(_added(d, fit, block, j, d.free) for j in range(d.y.shape[1]))


def _added(d: Dictionary, fit: TwinFit, block: int, j: int, free: np.ndarray) -> float:
    at, gram = d.by_joint(j)
    here = np.isin(at, d.at[block])
    beside = free[at] & ~here
    amplitudes = fit.x[at[here]]
    square = float(amplitudes @ gram[np.ix_(here, here)] @ amplitudes)
    across = gram[np.ix_(beside, here)] @ amplitudes
    inside = float(across @ _inverse(gram[np.ix_(beside, beside)]) @ across)
    return max(square - inside, 0.0)
