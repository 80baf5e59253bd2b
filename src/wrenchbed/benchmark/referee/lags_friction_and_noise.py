"""Laws of signals along time: lags, loops, dry friction, coloured noise; and the noise of rows.

Noise of rows is heavy-tailed, correlated as the sensor was measured, of varying strength, and
wanders slowly. Its ranges are estimates.
"""

from collections.abc import Sequence
from itertools import accumulate
from math import log1p

import numpy as np
from scipy.signal import lfilter

from wrenchbed import registry
from wrenchbed.benchmark.fault import Rng, converted
from wrenchbed.benchmark.mujoco_loads import wrench_at
from wrenchbed.benchmark.referee.machine import RefereeFault, Ride
from wrenchbed.benchmark.referee.scenario import RefereeSetting

_ROUNDING = 1e-9
"""Share by which C's logarithm and numpy's differ less: a million times double precision."""
WANDER = 0.3
"""Largest rms of the slow wander in noises of a row: a gap below 0.1."""
_JITTER_S = 1.5e-4
"""Standard deviation of the times at which rows are sampled [s]."""
_ENCODER = {"rad": 2e-5, "m": 5e-6}
"""Noise of reported joint values at rest [rad or m]; in motion a hundredth."""


def after(t: np.ndarray, y: np.ndarray, time: float) -> np.ndarray:
    """Output (T, k) of a first-order lag of ``time`` [s] for y (T, k) at instants (T,), exact."""
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
    """Hysteresis z (T, k), −1 … 1, of x (T, k): dz = dx (1 − (β sgn(dx z) + 1 − β) |z|), exact.

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
    """Integrate one column of `bouc_wen`, a = 1 − 2 β; return values (T − 1,) after each move.
    ``pieces`` (4, T − 1): sign s, length |Δ|, exp(−|Δ|), exp(a |Δ|) of the moves Δ."""
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
    """Output (T, k) of equal low-pass stages, total lag ``time`` [s], y (T, k) every ``dt``."""
    a = float(np.exp(-dt * stages / time))
    b0 = 1.0 - (1.0 - a) * time / (stages * dt)
    b1 = (1.0 - a) * time / (stages * dt) - a
    for _ in range(stages):
        initial = a * y[:1] + b1 * y[:1]
        y = lfilter([b0, b1], [1.0, -a], y, axis=0, zi=initial)[0]
    return np.asarray(y)


def ornstein(t: np.ndarray, time: float, columns: int, rng: Rng) -> np.ndarray:
    """Draw Ornstein–Uhlenbeck signals (T, columns) of unit variance, correlation ``time`` [s]."""
    keep = np.exp(-np.diff(t) / time)
    kicks = rng.standard_normal((len(t), columns))
    kicks[1:] *= np.sqrt(1.0 - keep * keep)[:, None]
    for column in kicks.T:
        pieces = zip(keep.tolist(), column[1:].tolist(), strict=True)
        states = accumulate(
            pieces, lambda x, piece: piece[0] * x + piece[1], initial=float(column[0])
        )
        column[:] = list(states)
    return kicks


def dahl(x: np.ndarray, reach: float) -> np.ndarray:
    """Dahl's friction (T,), −1 … 1, as x (T,) moves; it turns over within ``reach`` of x."""
    moves = np.diff(x)  # the exact solution over a piece of one direction
    pieces = zip(np.exp(-np.abs(moves) / reach).tolist(), np.sign(moves).tolist(), strict=True)
    return np.array(list(accumulate(pieces, _follow, initial=0.0)))


def rows(
    setting: RefereeSetting, ride: Ride, clean: np.ndarray, faults: Sequence[RefereeFault], rng: Rng
) -> tuple[np.ndarray, np.ndarray]:
    """Make the recorded wrenches (N, 6) [N, N·m] of a clean signal (T, 6), with noise and the
    faults that scatter rows, and the reported joint values (N, J) [rad or m]."""
    path = setting.path
    t = path.t[path.rows]
    late = np.clip(_JITTER_S * rng.standard_normal(len(t)), -3 * _JITTER_S, 3 * _JITTER_S)
    rate = np.gradient(clean, path.t, axis=0)[path.rows]
    y = clean[path.rows] + (late[:, None] * rate if setting.mode == "dynamic" else 0.0)
    changed = [f.rows for f in faults if f.rows is not None]
    y = y + np.prod([r.gain for r in changed], axis=0, initial=1.0) * _noise(setting, rng)
    y = y + _slow(setting, t, rng)
    for r in changed:
        if r.shake is not None:
            y = y + shaken(setting, ride, r.shake(t))
    y = converted(y, changed)
    for r in changed:
        y = y[held(len(y), r.stale, rng)]
    unit = np.array([_ENCODER[j.unit] for j in setting.robot.joints])
    unit = unit * (0.01 if setting.mode == "dynamic" else 1.0)
    q = path.q[path.rows]
    return y, q + unit * rng.standard_normal(q.shape)


def shaken(setting: RefereeSetting, ride: Ride, a: np.ndarray) -> np.ndarray:
    """Wrench (N, 6) at the recorded rows that accelerations of the base (N, 3) [m/s²] add."""
    rotation = ride.rotation[setting.path.rows]
    return wrench_at(setting.cog, -setting.mass * np.einsum("nij,ni->nj", rotation, a))


def held(n: int, stale: tuple[float, float], rng: Rng) -> np.ndarray:
    """Row shown for each of n rows (n,); ``stale``: chance of a repeat, its mean length."""
    chance, length = stale
    if chance == 0.0:
        return np.arange(n)
    shown = np.arange(n)
    i = int(rng.geometric(chance))
    while i < n:
        end = min(n, i + int(rng.geometric(1.0 / length)))
        shown[i:end] = shown[i - 1]
        i = end + int(rng.geometric(chance))
    return shown


def _noise(setting: RefereeSetting, rng: Rng) -> np.ndarray:
    """Draw noise (N, 6): Laplace and normal parts, AR(2), correlated as the sensor was measured."""
    n = len(setting.path.rows)
    heavy = rng.uniform(0.0, 0.5)
    white = np.sqrt(1 - heavy) * rng.standard_normal((n, 6))
    white += np.sqrt(heavy) * rng.laplace(0.0, np.sqrt(0.5), (n, 6))
    calm = ornstein(np.arange(n) * 1.0, rng.uniform(50.0, 400.0), 1, rng)
    white *= np.exp(rng.uniform(0.0, 0.2) * calm)
    radius, turn = rng.uniform(0.0, 0.55), rng.uniform(0.0, np.pi)
    colour = lfilter([1.0], [1.0, -2 * radius * np.cos(turn), radius**2], white, axis=0)
    measured = registry.load("sensors", setting.robot.sensor).noise.correlation
    share = rng.uniform(0.0, 0.9)
    mix = np.linalg.cholesky(share * measured + (1 - share) * np.eye(6) + 1e-9 * np.eye(6))
    colour = colour / colour.std(axis=0) @ mix.T
    return np.asarray(colour * setting.noise * rng.uniform(0.95, 1.05, 6))


def _slow(setting: RefereeSetting, t: np.ndarray, rng: Rng) -> np.ndarray:
    """Draw a slow wander (N, 6) of four rates, together at most 0.3 noises of a row."""
    span = float(t[-1] - t[0])
    times = span * np.array([0.5, 0.1, 0.02, 0.004])
    every = np.linspace(t[0], t[-1], 2000)
    waves = np.mean([ornstein(every, float(s), 6, rng) for s in times], axis=0) * 2.0
    level = rng.uniform(0.0, WANDER) * rng.uniform(0.5, 1.0, 6) * setting.noise
    return np.stack([np.interp(t, every, waves[:, k]) for k in range(6)], axis=1) * level
