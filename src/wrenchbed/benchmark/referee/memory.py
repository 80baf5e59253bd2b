"""Laws with a memory over the instants of a ride: lags, loops, dry friction, coloured noise."""

from itertools import accumulate
from math import log1p

import numpy as np
from scipy.signal import lfilter

_ROUNDING = 1e-9
"""Share by which C's logarithm and numpy's differ less: an estimate."""


def after(t: np.ndarray, y: np.ndarray, time: float) -> np.ndarray:
    """First-order lag of y (T, k) with a time constant [s], exact between instants (T,)."""
    keep = np.exp(-np.diff(t) / time).tolist()
    out = np.empty_like(y, dtype=float)
    out[0] = y[0]
    for column, middle in zip(out.T, (0.5 * (y[1:] + y[:-1])).T, strict=True):
        pieces = zip(keep, middle.tolist(), strict=True)
        column[:] = list(accumulate(pieces, _follow, initial=float(column[0])))
    return out


def _follow(state: float, piece: tuple[float, float]) -> float:
    keep, target = piece
    return target + keep * (state - target)


def bouc_wen(x: np.ndarray, shape: float) -> np.ndarray:
    """Loop (T, k) in −1 … 1 of x (T, k): dz = dx (1 − (β sgn(dx z) + 1 − β) |z|), exact in pieces.

    Bouc 1967; Wen 1976, doi 10.1061/JMCEA3.0002106, with A = n = 1 and β = ``shape``, not ½.
    """
    z = np.zeros_like(x)
    moves = np.diff(x, axis=0)
    far = np.abs(moves)
    a = 1.0 - 2.0 * shape
    pieces = np.stack([np.sign(moves), far, np.exp(-far), np.exp(a * far)])
    for k, column in enumerate(z.T):
        column[1:] = _loop(pieces[:, :, k], a)
    return z


def _loop(pieces: np.ndarray, a: float) -> list[float]:
    """One column of `bouc_wen`: pieces (4, T − 1) hold side, length, and both rates' exponentials.

    It unloads first, at another rate, until the loop is 0.
    """
    out, now = [], 0.0
    for side, d, loads, unloads in zip(*pieces.tolist(), strict=True):
        w = side * now
        if d > 0.0:
            if w < 0.0:
                first = -log1p(a * w) / a
                if d < first * (1.0 - _ROUNDING):
                    loads = 1.0
                else:  # it crosses 0; numpy's own functions, as for the other pieces
                    first = min(d, float(-np.log1p(a * w)) / a)
                    unloads, loads = float(np.exp(a * first)), float(np.exp(first - d))
                w = (w + 1.0 / a) * unloads - 1.0 / a
            now = side * (1.0 - (1.0 - w) * loads)
        out.append(now)
    return out


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
    kicks[1:] *= np.sqrt(1.0 - keep * keep)[:, None]
    for column in kicks.T:
        pieces = zip(keep.tolist(), column[1:].tolist(), strict=True)
        column[:] = list(accumulate(pieces, _kicked, initial=float(column[0])))
    return kicks


def _kicked(state: float, piece: tuple[float, float]) -> float:
    keep, kick = piece
    return keep * state + kick


def dahl(x: np.ndarray, reach: float) -> np.ndarray:
    """Dahl's friction (T,) in −1 … 1 as x (T,) moves (Dahl 1968, TOR-0158(3107-18)-1)."""
    moves = np.diff(x)  # the exact solution over a piece of one direction
    pieces = zip(np.exp(-np.abs(moves) / reach).tolist(), np.sign(moves).tolist(), strict=True)
    return np.array(list(accumulate(pieces, _follow, initial=0.0)))
