"""Vibration of the base: row scatter that turns with the tool as a world-fixed acceleration does.

The covariance of rows is N + M_h A M_hᵀ: N is of the sensor and the same in every pose; A is that
of an acceleration in world axes; M_h = [m I; m [c]×] R_hᵀ is its effect on the sensor (mass m, CoG
c, orientation R_h of hold h). Products of two channels are linear in N and A, so least squares over
holds separates them, and the holds' disagreement gives the uncertainty. Electronic noise is all N.
An isotropic acceleration looks like N, so that part of A is taken as small as possible.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from wrenchbed.diagnosis.between_rows.row_residual_scatter import Scatter

_I, _J = np.triu_indices(6)
_P, _Q = np.triu_indices(3)
_TRACELESS = np.linalg.svd(np.eye(3)[_P, _Q][None])[2][1:].T
"""Basis (6, 5) of symmetric 3×3 matrices with trace 0, each as its 6 upper elements."""
_EQUAL = 3.0
"""Standard deviations below which the two smaller principal variances are taken as equal."""
SURE = 1e-4
"""Largest p-value with which shaking of the base is reported."""
ALIKE = 1e-5
"""Least eigenvalue of the design, over its trace, with which poses separate A from N."""
GRID = 4
"""Trial frequencies per width of a spectral line, 1/(length of a group [s])."""
LOWEST_HZ = 3.0
"""Lowest frequency of a line [Hz]: below it drift within a hold, and the sway of an arm that has
just stopped, look like a line; bases and tables shake faster."""
NARROW = 0.45
"""Fraction of the shaking's power within one line, from which its frequency is named: peaks of
broad shaking reach a lower one by chance, a higher one misses a line that a window smears."""
JACKKNIFE = 8
"""Groups of holds, each left out once for the frequency's uncertainty: with fewer the uncertainty
itself is rough, more need more holds than a short recording has."""


@dataclass(frozen=True, eq=False)
class Line:
    """A peak of a power spectrum: frequency and its std [Hz]; its share of the variance, 0…1."""

    frequency: float
    std: float
    share: float


@dataclass(frozen=True, eq=False)
class Shaking:
    """Random acceleration of the base, and the row variance that it adds.

    Attributes:
        rise: added variance of a row (6,), in units of `Scatter.scale` squared.
        seen: part of it that the residual rows show (6,).
        std: standard uncertainty of ``rise`` (6,).
        rms: acceleration along its main direction [m/s²].
        direction: unit vector in base axes (3,).
        line: narrow peak of its spectrum; None if the power is spread over frequencies.
    """

    rise: np.ndarray
    seen: np.ndarray
    std: np.ndarray
    rms: float
    direction: np.ndarray
    line: Line | None


def shaking(s: Scatter) -> Shaking | None:
    """Random acceleration of the base; None if insignificant, or if the poses cannot show it."""
    maps = (s.lever / s.scale[:, None]) @ s.rotation.transpose(0, 2, 1)  # (G, 6, 3)
    unit = maps[:, _I][:, :, _P] * maps[:, _J][:, :, _Q]
    other = maps[:, _I][:, :, _Q] * maps[:, _J][:, :, _P]
    design = np.where(_P == _Q, unit, unit + other)  # (G, 21, 6)
    products = np.concatenate([s.means(s.rows[:, k:] * s.rows[:, k, None]) for k in range(6)], 1)
    weight = s.count / s.count.sum()
    X = (design - np.tensordot(weight, design, 1)) @ _TRACELESS
    Y = products - weight @ products
    noise = np.sqrt(np.maximum(Y.var(axis=0), 1e-12))  # products of noisier channels are noisier
    X, Y = X / noise[:, None], Y / noise
    gram = np.einsum("g,gki,gkj->ij", weight, X, X)
    whole = np.einsum("g,gki->", weight, (design / noise[:, None]) ** 2)
    if np.linalg.eigvalsh(gram)[0] <= ALIKE * whole:
        return None
    inverse = np.linalg.inv(gram)
    a = inverse @ np.einsum("g,gki,gk->i", weight, X, Y)
    score = weight[:, None] * np.einsum("gki,gk->gi", X, Y - X @ a)
    covariance = inverse @ (score.T @ score) @ inverse * len(s.count) / (len(s.count) - 1.0)
    free = len(s.count) - 5
    quadratic = float(a @ np.linalg.solve(covariance, a)) * max(free - 4, 1) / free
    if chdtrc(5, quadratic) > SURE:
        return None
    A, power, direction = _least(_TRACELESS @ a, float(np.sqrt(np.trace(covariance) / 5.0)))
    mean = np.tensordot(weight, design[:, _I == _J], 1)  # (6, 6)
    rise = seen = np.maximum(mean @ A, 0.0)
    relative = float(np.sqrt(a @ covariance @ a) / max(a @ a, 1e-300))
    std, rms = rise * relative, float(np.sqrt(power))
    x = _along(s, maps, direction)
    if not s.steady(x):
        return None
    frequency_line = line(s, x, rms**2)
    if frequency_line is not None:
        passed = max(s.passed(frequency_line.frequency), 0.25)
        rise, std, rms = rise / passed, std / passed, rms / np.sqrt(passed)
    return Shaking(rise, seen, std, rms, direction, frequency_line)


def _least(vector: np.ndarray, std: float) -> tuple[np.ndarray, float, np.ndarray]:
    """Smallest covariance with traceless part ``vector``, both (6,) as xx, xy, xz, yy, yz, zz; its
    largest variance and axis. Variances closer than 3 ``std`` count as equal."""
    B = np.zeros((3, 3))
    B[_P, _Q] = B[_Q, _P] = vector
    power, axes = np.linalg.eigh(B)
    low = power[0] if power[1] - power[0] > _EQUAL * std else 0.5 * (power[0] + power[1])
    power = np.maximum(power - low, 0.0)
    A = (axes * power) @ axes.T
    return A[_P, _Q], float(power[2]), axes[:, 2]


def _along(s: Scatter, maps: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Acceleration of the base along ``direction`` (3,), estimated from each row (N,) [m/s²];
    ``maps`` (G, 6, 3): change of rows, as scaled in ``s``, per acceleration in base axes."""
    sensor = np.linalg.pinv(np.cov(s.rows.T) + 1e-9 * np.eye(6))
    v = maps @ direction
    weights = (v @ sensor) / np.einsum("gk,kl,gl->g", v, sensor, v)[:, None]
    return np.asarray((s.rows * np.repeat(weights, s.count, axis=0)).sum(axis=1))


def line(s: Scatter, x: np.ndarray, power: float) -> Line | None:
    """Strongest spectral line of a signal x (N,) at the rows of ``s``; None if it holds little of
    the variance ``power``."""
    size = int(s.count.max())
    length = size / s.rate
    grid = np.fft.rfftfreq(GRID * size, 1.0 / s.rate)
    use = (grid >= LOWEST_HZ) & (grid < 0.495 * s.rate)
    if use.sum() < 3 or power <= 0.0:
        return None
    table = np.zeros((len(s.count), size))
    group = np.repeat(np.arange(len(s.count)), s.count)
    table[group, np.arange(len(x)) - s.starts[group]] = x
    spectrum = np.fft.rfft(table, GRID * size, axis=1)[:, use]
    grid, total = grid[use], 2.0 * np.abs(spectrum / s.count[:, None]) ** 2
    mean = total.mean(axis=0)
    peak = int(np.argmax(mean))
    fraction = (mean[peak] - float(np.median(mean))) / power
    if fraction < NARROW:
        return None
    fine = grid[peak] + np.linspace(-0.5, 0.5, 11) / length
    parts = _power(s, x, fine)
    group = np.arange(len(parts)) % JACKKNIFE
    tops = [_top(fine, parts[group != k].mean(axis=0)) for k in range(JACKKNIFE)]
    std = np.sqrt((JACKKNIFE - 1.0) * np.var(tops))
    return Line(_top(fine, parts.mean(axis=0)), float(std), float(min(fraction, 1.0)))


def _power(s: Scatter, x: np.ndarray, frequencies: np.ndarray) -> np.ndarray:
    """Variance of a sine fitted to x (N,) in each of G groups of rows, at F frequencies: (G, F)."""
    t = s.t - np.repeat(s.t[s.starts], s.count)

    def wave(at: slice) -> np.ndarray:
        return np.asarray(x[at, None] * np.exp((-2j * np.pi) * t[at, None] * frequencies))

    return 2.0 * np.abs(s.means_of(wave)) ** 2


def _top(f: np.ndarray, p: np.ndarray) -> float:
    """Frequency f (F,) at the maximum of a spectrum p (F,), by a parabola through three samples."""
    k = int(np.clip(np.argmax(p), 1, len(p) - 2))
    left, middle, right = p[k - 1 : k + 2]
    bend = left - 2.0 * middle + right
    shift = 0.5 * (left - right) / bend if bend < 0.0 else 0.0
    return float(f[k] + np.clip(shift, -1.0, 1.0) * (f[1] - f[0]))
