"""Laws with a memory over the instants of a ride: lags, loops, dry friction, coloured noise."""

import numpy as np
from scipy.signal import lfilter


def after(t: np.ndarray, y: np.ndarray, time: float) -> np.ndarray:
    """First-order lag of y (T, k) with a time constant [s], exact between instants (T,)."""
    keep = np.exp(-np.diff(t) / time)
    out = np.empty_like(y, dtype=float)
    out[0] = state = y[0].astype(float)
    middle = 0.5 * (y[1:] + y[:-1])
    for i, (k, target) in enumerate(zip(keep, middle, strict=True), start=1):
        state = target + k * (state - target)
        out[i] = state
    return out


def bouc_wen(x: np.ndarray, shape: float) -> np.ndarray:
    """Loop (T, k) in −1 … 1 of x (T, k): dz = dx (1 − (β sgn(dx z) + 1 − β) |z|), exact in pieces.

    Bouc 1967; Wen 1976, doi 10.1061/JMCEA3.0002106, with A = n = 1 and β = ``shape``, not ½.
    """
    z = np.zeros_like(x)
    moves = np.diff(x, axis=0)
    side, far = np.sign(moves), np.abs(moves)
    a = 1.0 - 2.0 * shape
    now = np.zeros(x.shape[1])
    for i in range(len(moves)):
        d = far[i]
        if d.any():
            w = side[i] * now
            behind = np.minimum(w, 0.0)  # unloads first, at another rate, until it is 0
            first = np.minimum(d, -np.log1p(a * behind) / a)
            w = np.where(w < 0.0, (w + 1.0 / a) * np.exp(a * first) - 1.0 / a, w)
            w = 1.0 - (1.0 - w) * np.exp(first - d)
            now = np.where(d > 0.0, side[i] * w, now)
        z[i + 1] = now
    return z


def lowpass(y: np.ndarray, dt: float, time: float, stages: int) -> np.ndarray:
    """Equal first-order stages (T, k) with together ``time`` [s] of lag, input held linear."""
    a = float(np.exp(-dt * stages / time))
    b0 = 1.0 - (1.0 - a) * time / (stages * dt)
    b1 = (1.0 - a) * time / (stages * dt) - a
    for _ in range(stages):
        initial = a * y[:1] + b1 * y[:1]
        y = lfilter([b0, b1], [1.0, -a], y, axis=0, zi=initial)[0]
    return np.asarray(y)


def ornstein(t: np.ndarray, time: float, columns: int, rng: np.random.Generator) -> np.ndarray:
    """Stationary Ornstein–Uhlenbeck signals (T, columns) of unit variance."""
    keep = np.exp(-np.diff(t) / time)
    kicks = rng.standard_normal((len(t), columns))
    out = np.empty((len(t), columns))
    out[0] = state = kicks[0]
    for i, k in enumerate(keep, start=1):
        state = k * state + np.sqrt(1.0 - k * k) * kicks[i]
        out[i] = state
    return out


def dahl(x: np.ndarray, reach: float) -> np.ndarray:
    """Dahl's friction (T,) in −1 … 1 as x (T,) moves (Dahl 1968, TOR-0158(3107-18)-1)."""
    z = np.zeros(len(x))
    for i, d in enumerate(np.diff(x), start=1):
        side = np.sign(d)  # the exact solution over a piece of one direction
        z[i] = side + (z[i - 1] - side) * np.exp(-abs(d) / reach)
    return z
