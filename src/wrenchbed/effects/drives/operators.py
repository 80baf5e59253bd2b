"""Operators with memory on the motion or the torque of a joint: what friction and drives remember.

Each maps rows of one joint (N,) to rows (N,).
"""

import numpy as np
import scipy  # which loads its slow submodules when they are first used

REST = 0.03
"""Share of a joint's largest speed below which it counts as at rest: friction has no known sign
there, and encoders' noise has one of its own. Estimate, as in `drives.signals`."""
_MEMORY_S = 0.04
"""Time around rest that does not count either [s]; estimate: bristles and filters settle."""


def direction(speed: np.ndarray) -> np.ndarray:
    """Sign of a speed (N,), that of before while a joint is at rest."""
    moves = np.abs(speed) > REST * np.abs(speed).max()
    last = np.maximum.accumulate(np.where(moves, np.arange(len(speed)), 0))
    return np.asarray(np.sign(speed[last]))


def moving(speed: np.ndarray, rate: float) -> np.ndarray:
    """Which rows (N,) have a speed clear of rest, boolean."""
    still = np.abs(speed) <= REST * np.abs(speed).max()
    width = 2 * max(1, round(_MEMORY_S * rate)) + 1
    return np.asarray(np.convolve(still, np.ones(width), mode="same") < 0.5)


def since_reversal(q: np.ndarray, sign: np.ndarray) -> np.ndarray:
    """Angle travelled since the last change of direction (N,) [rad]."""
    path = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(q)))])
    turned = np.flatnonzero(np.diff(sign) != 0.0) + 1
    last = np.zeros(len(q), dtype=int)
    last[turned] = turned
    start = path[np.maximum.accumulate(last)]
    fresh = np.maximum.accumulate(last) == 0  # how long it moved before the recording is unknown
    return np.asarray(np.where(fresh, np.inf, path - start))


def stop(q: np.ndarray, width: float) -> np.ndarray:
    """Stop operator of a half width [rad], −1 … 1 (N,): elastic up to it, then sliding.

    Brokate & Sprekels 1996, "Hysteresis and Phase Transitions", Section 2.1; a sum over widths is
    a Prandtl–Ishlinskii model.
    """
    steps, found, z = np.diff(q).tolist(), [0.0], 0.0
    for step in steps:
        z = min(width, max(-width, z + step))
        found.append(z)
    return np.array(found) / width


def late(torque: np.ndarray, t: np.ndarray, delay: float) -> np.ndarray:
    """Change of a torque (N,) when it is delayed by ``delay`` [s]."""
    return np.asarray(np.interp(t - delay, t, torque) - torque)


def slow(torque: np.ndarray, rate: float, time: float) -> np.ndarray:
    """Change of a torque (N,) by a first-order low-pass of a time constant [s]."""
    steps = rate * time  # exact where the torque is straight between rows
    keep = float(np.exp(-1.0 / steps))
    b = [1.0 - steps * (1.0 - keep), steps * (1.0 - keep) - keep]
    begin = scipy.signal.lfilter_zi(b, [1.0, -keep]) * torque[0]
    return np.asarray(scipy.signal.lfilter(b, [1.0, -keep], torque, zi=begin)[0] - torque)
