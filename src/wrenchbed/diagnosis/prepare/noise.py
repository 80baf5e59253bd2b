"""Rows that step or repeat: the count that a channel's values stand on, and rows shown again.

Noise of a motion's rows and of their averages, from the spectrum of a residual.

A gap moves as slowly as the robot, noise does not: above `EDGE` of the rate of the averages there
is hardly anything but noise, and below it noise is taken as it is just above. Noise is the same all
the time, jumps and reversals are not: of short stretches the quieter ones tell, as much louder as
noise is on average (minimum statistics, Martin 2001, doi 10.1109/89.928915).
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

EDGE, ABOVE = 0.3, 4.0
"""Of the rate of the averages: no gap above; and, of that edge, up to where noise below it is
taken from."""
STRETCH_S, LEAST = 1.0, 32
"""Length of a stretch [s, rows at least]."""
QUIET = 0.2, 0.5
"""Shares of stretches that are quieter; of what both say the less counts."""
_HANN = (4 / 9, 1 / 36)
"""Correlation of a periodogram's neighbours under a Hann window (Welch 1967)."""


def noise(residual: np.ndarray, period: float, stride: int) -> tuple[np.ndarray, np.ndarray]:
    """Variance of a row (6,), and of the average of ``stride`` rows times ``stride`` (6,).

    Args:
        residual: rows of a motion (N, 6), any unit.
        period: between rows [s].
    """
    from scipy.signal import spectrogram  # slow to load: only when it is used

    length = min(len(residual), max(LEAST, round(STRETCH_S / period)))
    f, _, power = spectrogram(
        residual, 1.0 / period, "hann", length, length - length // 4, detrend="constant", axis=0
    )  # (F, 6, stretches)
    wave = np.pi * f * period
    passed = np.ones(len(f))
    passed[1:] = (np.sin(stride * wave[1:]) / (stride * np.sin(wave[1:]))) ** 2
    edge = EDGE / (stride * period)
    fast, near = f >= edge, (f >= edge) & (f < ABOVE * edge)
    share = np.array(QUIET)
    each = np.quantile(power[near], share, axis=2) / chdtri(2, 1.0 - share)[:, None, None] * 2.0
    level = np.median(each, axis=1).min(axis=0)
    whole = np.where(f > 0.0, 1.0, 0.5)  # of the first interval, half belongs to f < 0
    told = [
        _sum(power[fast], weight[fast]) + level * weight[~fast].sum()
        for weight in (whole, stride * passed * whole)
    ]
    return told[0] * f[1], told[1] * f[1]


def _sum(power: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Weighted sum (6,) over frequencies of steady noise in the power (F, 6, stretches)."""
    share = np.array(QUIET)
    spread = weight @ weight
    for k, c in enumerate(_HANN, start=1):
        spread += 2.0 * c * float(weight[k:] @ weight[:-k])
    freedom = 2.0 * weight.sum() ** 2 / spread
    parts = np.einsum("f,fct->ct", weight, power)
    white = chdtri(freedom, 1.0 - share) / freedom
    return np.asarray((np.quantile(parts, share, axis=1) / white[:, None]).min(axis=0))


ON = 0.1
"""A value is on a lattice if it is off by less than this part of its step."""
ALL = 0.97
"""Share of steps between rows that must be on it."""
LEAST_STEPS = 20
EXACT = 1e-9
"""Values closer than this part of the range are the same number."""
FAR, FAR_TO_NEAR = 11, 1.5
"""Distance [rows] at which only coarse counts show the same row again, and how much oftener they
may do so next to each other."""
FEW = 0.015
"""Share of rows beyond what counts may make, below which no row is taken for a repeat."""
DEVICES = (0, 1, 2), (3, 4, 5)
"""Channels that a device of its own may deliver: a clipped channel repeats alone."""
WINDOW = 64
"""Rows over which a channel's own chance of repeating is taken."""


@dataclass(frozen=True)
class Step:
    """A channel's count and its standard uncertainty [N or N·m]."""

    value: float
    std: float


def step(y: np.ndarray) -> Step | None:
    """The largest step on whose multiples a channel (N,) stands; None for a continuous one."""
    reach = float(np.ptp(y))
    if reach <= 0.0:
        return None
    gaps = np.diff(np.unique(y))
    gaps = gaps[gaps > EXACT * reach]
    if len(gaps) < 3:
        return None
    d = np.abs(np.diff(y))
    d = d[d > EXACT * reach]
    if len(d) < LEAST_STEPS:
        return None
    for candidate in sorted(np.quantile(gaps, [0.0, 0.05, 0.25, 0.5]), reverse=True):
        found = _refined(d, float(candidate))
        if found is not None:
            return found
    return None


def _refined(d: np.ndarray, size: float) -> Step | None:
    """Fit a step to ever larger multiples of it, then judge all of them."""
    d = np.sort(d)
    reach = 4.0
    while True:
        near = d[d < (reach + 0.5) * size]
        k = np.round(near / size)
        if (k > 0).sum() < 3:
            return None
        size = float((near @ k) / (k @ k))
        if len(near) == len(d):
            break
        reach *= 2.0
    k = np.round(d / size)
    off = d - k * size
    if np.mean((np.abs(off) < ON * size) & (k > 0)) < ALL:
        return None
    return Step(size, float(np.sqrt((off @ off) / max(len(d) - 1, 1) / (k @ k))))


@dataclass(frozen=True, eq=False)
class Repeats:
    """Rows that show again what the row before showed.

    Attributes:
        stale: which (N,).
        share: of all rows.
        std: standard uncertainty of the share.
        expected: share that coarse counts alone may make.
        length: mean length of a run of repeats [rows].
        channels: indices of those that repeat.
    """

    stale: np.ndarray
    share: float
    std: float
    expected: float
    length: float
    channels: tuple[int, ...]

    @property
    def some(self) -> bool:
        """Whether rows repeat more often than coarse counts may make them."""
        return bool(self.channels) and self.share >= self.expected + FEW


def repeats(wrench: np.ndarray) -> Repeats:
    """Repeats of whole rows (N, 6), else of all forces or all torques at once without a count."""
    same = wrench[1:] == wrench[:-1]
    whole = same.all(axis=1)
    own = same[~whole]
    if len(own) < 2 * WINDOW:
        return _repeats(whole, 1.0, ())
    expected = max(_chance(own), FAR_TO_NEAR * _far(wrench, whole))
    found = _repeats(whole, expected, (0, 1, 2, 3, 4, 5))
    if found.share > found.expected + 0.01:
        return found
    for group in DEVICES:
        again = same[:, group[0]]
        together = all(np.array_equal(same[:, k], again) for k in group)
        if together and again.mean() > 0.02 and all(_continuous(wrench[:, k]) for k in group):
            return _repeats(again, 0.0, group)
    return found


def _repeats(again: np.ndarray, expected: float, channels: tuple[int, ...]) -> Repeats:
    stale = np.concatenate([[False], again])
    share = float(stale.mean())
    runs = int(np.count_nonzero(np.diff(stale.astype(int)) == 1))
    length = float(stale.sum() / runs) if runs else 0.0
    std = float(np.sqrt(share * (1.0 - share) * max(1.0, 2.0 * length - 1.0) / len(stale)))
    return Repeats(stale, share, std, expected, length, channels)


def _chance(same: np.ndarray) -> float:
    """Share of whole repeats that the channels' counts (M, 6) may make.

    The root of the product of the channels' own shares, window by window: six independent channels
    would repeat together as often as the product says, fully correlated ones as often as one.
    """
    whole = len(same) // WINDOW * WINDOW
    own = same[:whole].reshape(-1, WINDOW, 6).mean(axis=1)
    return float(np.sqrt(own.prod(axis=1)).mean())


def _far(wrench: np.ndarray, whole: np.ndarray) -> float:
    """Share of rows that equal an earlier one with others between: only counts come back."""
    changes = np.concatenate([[0], np.cumsum(~whole)])
    same = (wrench[FAR:] == wrench[:-FAR]).all(axis=1)
    return float(np.mean(same & (changes[FAR:] > changes[:-FAR])))


def _continuous(y: np.ndarray) -> bool:
    """Whether a channel's changes hardly ever have the same size twice, and none has an end."""
    fresh = y[np.concatenate([[True], y[1:] != y[:-1]])]
    if len(fresh) < WINDOW:
        return False
    _, count = np.unique(fresh, return_counts=True)
    return bool(count.max() <= 2 and len(count) > 0.98 * len(fresh))
