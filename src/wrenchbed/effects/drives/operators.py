"""Operators with memory on rows (N,) of the motion or torque of a joint, for friction and drives.

`effects.sensor_…`, `drives.signals` and `diagnosis.efforts` use some too (`stop`, `REST` …).
"""

from functools import lru_cache

import numpy as np
import scipy  # which loads its slow submodules when they are first used

from wrenchbed.physics.noise import carried

REST = 0.03
"""Share of a joint's largest speed below which it counts as at rest: friction has no known sign
there, and encoders' noise has one of its own."""
_MEMORY_S = 0.04
"""Time around rest that does not count either [s], a few rows: bristles and filters settle."""
_LARGEST_KEPT, _MOST_KEPT = 1 << 19, 64
"""Largest input of `play` that is kept [B], and how many: with their paths 64 MiB."""


def direction(speed: np.ndarray, rest: float = REST) -> np.ndarray:
    """Sign (N,) of a speed (N,); where it is below ``rest`` × top speed, the sign before that."""
    moves = np.abs(speed) > rest * np.abs(speed).max()
    last = np.maximum.accumulate(np.where(moves, np.arange(len(speed)), 0))
    return np.asarray(np.sign(speed[last]))


def moving(speed: np.ndarray, rate: float) -> np.ndarray:
    """Whether (N,), boolean, a joint of speeds ``speed`` (N,) at ``rate`` [Hz] moves in all rows
    within `_MEMORY_S` of each row."""
    still = np.abs(speed) <= REST * np.abs(speed).max()
    width = 2 * max(1, round(_MEMORY_S * rate)) + 1
    return np.asarray(np.convolve(still, np.ones(width), mode="same") < 0.5)


def since_reversal(q: np.ndarray, sign: np.ndarray) -> np.ndarray:
    """Distance (N,) [rad] since ``sign`` (N,) last changed, along q (N,); inf before the first."""
    path = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(q)))])
    turned = np.flatnonzero(np.diff(sign) != 0.0) + 1
    last = np.zeros(len(q), dtype=int)
    last[turned] = turned
    start = path[np.maximum.accumulate(last)]
    fresh = np.maximum.accumulate(last) == 0  # how long it moved before the recording is unknown
    return np.asarray(np.where(fresh, np.inf, path - start))


def stop(x: np.ndarray, width: float) -> np.ndarray:
    """Stop operator with a half width on rows x (M, …), scaled to −1 … 1: elastic, then sliding.

    It is what a play operator of that width lags behind. Brokate & Sprekels 1996, "Hysteresis and
    Phase Transitions", Section 2.1; a sum over widths is a Prandtl–Ishlinskii model.
    """
    flat = x.reshape(len(x), -1)
    return np.asarray((flat - play(flat, width)).reshape(x.shape) / width)


def play(x: np.ndarray, width: float) -> np.ndarray:
    """Output (M, K) of the play (backlash) operator of half width ``width`` along rows (M, K); of
    small inputs cached, since a fit asks for the same path again."""
    if x.nbytes > _LARGEST_KEPT:
        return _path(x, width)
    return _kept_path(x.tobytes(), x.shape[1], width)


@lru_cache(maxsize=_MOST_KEPT)
def _kept_path(x: bytes, columns: int, width: float) -> np.ndarray:
    """Cached, read-only result of `play`, x being the bytes of the input (M, columns)."""
    path = _path(np.frombuffer(x).reshape(-1, columns), width)
    path.flags.writeable = False
    return path


def _path(x: np.ndarray, width: float) -> np.ndarray:
    """Compute `play` (M, K) in blocks of rows, without a loop over rows.

    Each row clips the state into x ± width, and clips composed are a clip: blocks of about √M rows
    are composed side by side, and one pass over blocks finds the states, bit for bit as a loop.
    """
    rows, channels = x.shape
    length = max(1, int(np.sqrt(rows)))
    blocks = -(-rows // length)
    padded = np.concatenate([x, np.broadcast_to(x[-1:], (blocks * length - rows, channels))])
    below = np.ascontiguousarray(padded.reshape(blocks, length, channels).transpose(1, 0, 2))
    above = below + width
    below -= width
    for k in range(1, length):
        low, high = below[k], above[k]
        below[k] = np.minimum(np.maximum(below[k - 1], low), high)
        above[k] = np.minimum(np.maximum(above[k - 1], low), high)
    states = np.empty((blocks, channels))
    state = x[0]
    for k in range(blocks):
        states[k] = state
        state = np.minimum(np.maximum(state, below[-1, k]), above[-1, k])
    path = np.minimum(np.maximum(states, below), above)
    return np.asarray(path.transpose(1, 0, 2).reshape(-1, channels)[:rows])


def late(torque: np.ndarray, t: np.ndarray, delay: float) -> np.ndarray:
    """Change (N,) of a torque (N,) sampled at times t (N,) [s] when it is late by ``delay`` [s]."""
    # friction's steps do not ring
    course = scipy.interpolate.Akima1DInterpolator(t, torque, method="makima")
    return np.asarray(course(np.maximum(t - delay, t[0])) - torque)


def lagging(x: np.ndarray, t: np.ndarray, tau: float) -> np.ndarray:
    """First-order lag z, τ ż = x − z, along rows (M, K) at times (M,) [s], z = x at the first row.

    With x linear between rows, z₁ = a z₀ + (1 − g) x₁ + (g − a) x₀, a = e^(−Δt/τ), g = (1 − a)
    τ/Δt.
    """
    step = np.maximum(np.diff(t), 1e-9)
    a, g = np.exp(-step / tau), -np.expm1(-step / tau) * tau / step
    push = np.concatenate([x[:1], (1.0 - g)[:, None] * x[1:] + (g - a)[:, None] * x[:-1]])
    return carried(np.append(1.0, a), np.ascontiguousarray(push.T)).T


def slow(torque: np.ndarray, rate: float, time: float) -> np.ndarray:
    """Change (N,) of a torque (N,) at ``rate`` [Hz] by a low-pass of time constant ``time`` [s]."""
    clock = np.arange(len(torque)) / rate
    return np.asarray(lagging(torque[:, None], clock, time)[:, 0] - torque)
