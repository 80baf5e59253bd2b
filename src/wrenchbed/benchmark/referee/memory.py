"""Laws with a memory over the instants of a ride: lags, loops, dry friction, coloured noise."""

from collections.abc import Callable
from itertools import accumulate
from math import log1p

import numpy as np
from scipy.signal import lfilter


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


_ROUNDING = 1e-9
"""Share by which C's logarithm and numpy's differ less: an estimate."""


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


STEP_S = 0.1
"""Step of a convolution in time [s]: an estimate, short beside all that is convolved."""
RELAYS = 14
"""Thresholds of a Preisach plane along each axis, and a twentieth of the points of its middle
curve: an estimate."""


def by_convolution(
    t: np.ndarray, y: np.ndarray, law: Callable[[np.ndarray], np.ndarray]
) -> np.ndarray:
    """∫ law(t − s) dy(s) (T, k) of y (T, k), with law(0) = 0; on a grid of `STEP_S`."""
    grid = np.arange(t[0], t[-1] + STEP_S, STEP_S)
    even = np.stack([np.interp(grid, t, c) for c in y.T], axis=1)
    late = law(grid - grid[0] + STEP_S / 2.0)
    steps = np.diff(even, axis=0, prepend=even[:1])
    sums = np.stack([np.convolve(c, late)[: len(grid)] for c in steps.T], axis=1)
    return np.stack([np.interp(t, grid, c) for c in sums.T], axis=1)


def two_speeds(t: np.ndarray, y: np.ndarray, up: float, down: float) -> np.ndarray:
    """First-order lag of y (T, k): time constants [s] where its magnitude must grow, and fall."""
    out = np.empty_like(y, dtype=float)
    out[0] = state = y[0].astype(float)
    for i, dt in enumerate(np.diff(t), start=1):
        growing = state * (y[i] - state) >= 0.0
        state = y[i] + np.exp(-dt / np.where(growing, up, down)) * (state - y[i])
        out[i] = state
    return out


def play(x: np.ndarray, half: float) -> np.ndarray:
    """The middle of a backlash of half a width that x (T, k) drives (T, k)."""
    out = np.empty_like(x)
    out[0] = at = x[0]
    for i in range(1, len(x)):
        out[i] = at = np.clip(at, x[i] - half, x[i] + half)
    return out


def preisach(x: np.ndarray, spread: float, narrow: float) -> np.ndarray:
    """Lag (T, k), −1 … 1 or so, of Preisach's relays that x (T, k) in −1 … 1 switches.

    A relay goes up at its middle plus its half width and down at minus; there are many of middle 0
    (Gaussian of ``spread``) and of small width (exponential of ``narrow``). Preisach 1935,
    doi 10.1007/BF01349418.
    """
    axis = (np.arange(RELAYS) + 0.5) / RELAYS
    middle, half = (m.ravel() for m in np.meshgrid(2.0 * axis - 1.0, axis))
    density = np.exp(-0.5 * (middle / spread) ** 2 - half / narrow)
    density *= np.abs(middle) + half < 1.0  # others never switch
    density /= density.sum()
    state = np.where(x[0][:, None] > middle, 1.0, -1.0)
    none = np.empty_like(x)
    for i, row in enumerate(x):
        above, below = row[:, None] > middle + half, row[:, None] < middle - half
        state = np.where(above, 1.0, np.where(below, -1.0, state))
        none[i] = state @ density
    grid = np.linspace(-1.0, 1.0, 20 * RELAYS)[:, None]
    branches = [np.sign(grid - middle - side * half) @ density for side in (-1.0, 1.0)]
    return np.asarray(np.interp(x, grid[:, 0], 0.5 * (branches[0] + branches[1])) - none)
