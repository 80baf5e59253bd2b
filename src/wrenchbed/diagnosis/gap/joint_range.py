"""Whether a residual lies where one joint passes a narrow range: a stop, a worn tooth, a cable.

Means over an angle miss a spike that is narrow, or whose sign changes. Here the residual's energy
is tested: its share in the best window of one joint's values, against the same with permuted
stretches of time (as in `dependence`), over all joints.
"""

from typing import NamedTuple

import numpy as np

from wrenchbed.diagnosis.gap.dependence import orders
from wrenchbed.diagnosis.prepare.prepared import Prepared

WINDOW = 0.08
"""Width of the window as a share of all rows: a spike that a joint passes is narrower."""
LEAST_ROWS = 100
"""Fewest rows that are searched: a window of fewer may hold a single event, not a range."""
LEAST_SHARE = 0.5
"""Least share of the residual's energy within the window: below it the residual is not local."""
FLANK = 0.05
"""Energy of a row over the largest one's, from which it belongs to the range."""


class Locality(NamedTuple):
    """Range of one joint that contains most of a residual.

    Attributes:
        joint: number of the joint, from 1.
        low, high: ends of the range [rad or m].
        share: share of the residual's energy beyond noise within the range, 0 … 1.
        rows: share of the rows within it.
        p_value: family-wise over all joints.
    """

    joint: int
    low: float
    high: float
    share: float
    rows: float
    p_value: float


def locality(
    prepared: Prepared, residual: np.ndarray, noise: np.ndarray, permutations: int, seed: int
) -> Locality | None:
    """Joint and range in which a residual is most concentrated; None if it is in none.

    Stretches of time of the fit's whitened rows (R, C), of noise variance (C,), are permuted.
    """
    rows = len(residual)
    if not prepared.scene.jointed or rows < LEAST_ROWS:
        return None
    energy = np.maximum((residual**2 / noise).mean(axis=1) - 1.0, 0.0)
    q = prepared.averages(prepared.poses)
    width = max(3, round(WINDOW * rows))
    order = orders(prepared.block_rows, permutations, np.random.default_rng([seed, 32]))
    permuted = energy[order] / max(float(energy.sum()), 1e-300)
    by_joint = [np.argsort(x, kind="stable") for x in q.T]
    best = np.stack([_windows(permuted[:, by], width).max(axis=1) for by in by_joint])
    joint = int(best[:, 0].argmax())
    p_value = float((best.max(axis=0) >= best[joint, 0]).mean())
    if best[joint, 0] < LEAST_SHARE:
        return None
    by = by_joint[joint]
    first = int(_windows(permuted[:1, by], width)[0].argmax())
    inside = by[first : first + width]
    of = permuted[0, inside]
    held = np.flatnonzero(of > FLANK * of.max())  # the spike itself, not all of the window
    low, high = q[inside[[held[0], held[-1]]], joint]
    here = (q[:, joint] >= low) & (q[:, joint] <= high)
    share, of_rows = float(permuted[0, here].sum()), float(here.mean())
    return Locality(joint + 1, float(low), float(high), share, of_rows, p_value)


def _windows(x: np.ndarray, width: int) -> np.ndarray:
    """Sums (P, R − width + 1) over windows of ``width`` neighbours in rows (P, R)."""
    total = np.cumsum(np.pad(x, ((0, 0), (1, 0))), axis=1)
    return np.asarray(total[:, width:] - total[:, :-width])
