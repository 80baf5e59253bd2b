"""Laws with a memory: relays, Preisach's hysteresis, relaxation in time, 1/f noise.

Numbers without a source are estimates.
"""

import numpy as np
from scipy.linalg import solve_banded


def relay(signal: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """State ±1 along time (T, …): up above ``high``, down below ``low``, else as before.

    Before the first crossing the state is on the nearer side.
    """
    up, down = signal > high, signal < low
    instant = np.arange(len(signal)).reshape(-1, *[1] * (up.ndim - 1))
    last_up = np.maximum.accumulate(np.where(up, instant, -1), axis=0)
    last_down = np.maximum.accumulate(np.where(down, instant, -1), axis=0)
    initial = np.where(signal[:1] > 0.5 * (low + high), 1.0, -1.0)
    state = np.where(last_up > last_down, 1.0, -1.0)
    return np.asarray(np.where(last_up == last_down, initial, state))


def preisach(
    signal: np.ndarray, rng: np.random.Generator, reach: float, relays: int = 96
) -> np.ndarray:
    """Hysteresis (T, C) of signals (T, C), about ±1 wide at its widest, without its linear part.

    Relays (centre, half width) are spread at random over the signal's range: the loop's shape
    differs from draw to draw.

    Args:
        reach: mean half width of the relays in units of half the signal's range.
    """
    low, high = signal.min(axis=0), signal.max(axis=0)
    middle, half = (low + high) / 2.0, np.maximum((high - low) / 2.0, 1e-12)
    unit = (signal - middle) / half
    grid = np.linspace(-0.9, 0.9, relays)
    centre = grid[rng.permutation(relays)] + rng.normal(0.0, 0.03, relays)
    width = reach * rng.gamma(4.0, 0.25, relays)
    weight = rng.gamma(3.0, 1.0, relays) * (1.1 - np.abs(grid))
    state = relay(unit[..., None], centre - width, centre + width)
    offset = unit[..., None] - centre
    linear = np.sign(offset - width) + np.sign(offset + width)
    loop = (state - 0.5 * linear) @ (weight / weight.sum())
    return np.asarray(loop / max(1e-6, 2.0 * min(1.0, reach)))


def relax(t: np.ndarray, signal: np.ndarray, time: float) -> np.ndarray:
    """The signal (T, C) after a first-order lag with a time constant [s]."""
    keep = np.exp(-np.diff(t) / time)
    bands = np.ones((2, len(t)))
    bands[1, :-1], bands[1, -1] = -keep, 0.0
    driven = signal.copy()
    driven[1:] *= (1.0 - keep)[:, None]
    return np.asarray(solve_banded((1, 0), bands, driven, check_finite=False))


def slow_noise(rng: np.random.Generator, rows: int, columns: int) -> np.ndarray:
    """1/f noise (rows, columns) of unit rms about a zero mean."""
    spectrum = np.fft.rfft(rng.standard_normal((max(rows, 4), columns)), axis=0)
    frequency = np.arange(len(spectrum), dtype=float)
    frequency[0] = np.inf
    wave = np.fft.irfft(spectrum / np.sqrt(frequency)[:, None], n=max(rows, 4), axis=0)[:rows]
    wave = wave - wave.mean(axis=0)
    return np.asarray(wave / np.maximum(wave.std(axis=0), 1e-12))
