"""White and 1/f noise of evenly sampled rows, fitted to their periodogram.

Whittle's likelihood with the exact expected periodogram of the model (debiased, Sykulski et al.
2019, doi 10.1093/biomet/asy071): what sampling folds back and what a short record leaks is in it.
The 1/f part is that of `NoiseModel`: its autocovariance at lag τ is E₁(2π f_low τ) −
E₁(2π f_high τ) for a level of 1.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.fft import next_fast_len, rfft
from scipy.special import exp1

_ROUNDS = 60
"""Largest number of steps of Fisher scoring; it converges within 10 to 20."""
_SETTLED = 1e-7
_SHOWN, _ONE_SIDED = 2.0, 1.645
"""Sigmas from which on a 1/f part stands out, and below which 95 % of cases lie."""
BELOW_ARM_HZ, _ENOUGH_LOW = 2.0, 16
"""Frequency below which servo-held arms hardly vibrate [Hz] (their lowest modes are above 5 Hz),
and fewest frequencies that separate a white floor from 1/f noise: each is then known to 25 %."""
_MISFIT = 3.0
"""Mean squared misfit of the octaves, in their variances, above which the law does not hold: noise
that follows the law has more once in 1,000 (8 octaves)."""


@dataclass(frozen=True, eq=False)
class Clock:
    """Sampling of N rows at an even rate, with the band of the 1/f part.

    Attributes:
        rate: sampling rate [Hz].
        f_low, f_high: ends of the 1/f part [Hz].
    """

    rows: int
    rate: float
    f_low: float
    f_high: float

    @cached_property
    def frequency(self) -> np.ndarray:
        """Fourier frequencies (K,) [Hz] between zero and the Nyquist frequency."""
        return np.arange(1, (self.rows + 1) // 2) * (self.rate / self.rows)

    @cached_property
    def covariance(self) -> np.ndarray:
        """Autocovariance (N,) at lags of 0 … N − 1 rows of 1/f noise with a level of 1."""
        lag = 2.0 * np.pi * np.arange(1, self.rows) / self.rate
        rest = exp1(self.f_low * lag) - exp1(self.f_high * lag)
        return np.concatenate([[np.log(self.f_high / self.f_low)], rest])

    @cached_property
    def flicker(self) -> np.ndarray:
        """Expected periodogram (K,) [1/Hz] of 1/f noise with a level of 1."""
        n = self.rows
        weighted = (1.0 - np.arange(n) / n) * self.covariance
        spectrum = 2.0 * np.fft.rfft(weighted).real - weighted[0]
        return np.asarray(2.0 / self.rate * spectrum[1 : len(self.frequency) + 1])

    @property
    def white(self) -> np.ndarray:
        """Expected periodogram (K,) [1/Hz] of white noise with a standard deviation of 1."""
        return np.full(len(self.frequency), 2.0 / self.rate)

    def periodogram(self, rows: np.ndarray) -> np.ndarray:
        """One-sided power spectral density (K,) [1/Hz] of rows (N,), without their mean."""
        spectrum = np.fft.rfft(rows - rows.mean())[1 : len(self.frequency) + 1]
        return np.asarray(2.0 / (self.rate * self.rows) * np.abs(spectrum) ** 2)

    def slope_std(self, white: float, flicker: float) -> float:
        """Standard deviation of a fitted straight line's slope, in units of the rows per second, by
        white noise of standard deviation ``white`` and 1/f noise of amplitude ``flicker``."""
        t = (np.arange(self.rows) - (self.rows - 1) / 2.0) / self.rate
        weight = t / (t @ t)
        padded = rfft(weight, next_fast_len(2 * self.rows, real=True))
        shared = np.fft.irfft(np.abs(padded) ** 2, next_fast_len(2 * self.rows, real=True))
        shared = shared[: self.rows]
        flickering = 2.0 * shared @ self.covariance - shared[0] * self.covariance[0]
        return float(np.sqrt(white**2 * shared[0] + flicker**2 * max(flickering, 0.0)))


@dataclass(frozen=True)
class Spectrum:
    """White and 1/f noise of one channel, with uncertainties, without quantisation noise.

    Attributes:
        white, flicker: standard deviation, and amplitude of the 1/f part, as in `NoiseModel`.
        white_std, flicker_std: of these; that of an insignificant 1/f part, which is 0, is NaN.
        flicker_most: upper 95 % limit of ``flicker``.
        misfit: mean squared misfit of the octaves over their variances, 1 if the model holds.
    """

    white: float
    flicker: float
    white_std: float
    flicker_std: float
    flicker_most: float
    misfit: float

    @property
    def follows(self) -> bool:
        """Whether white and 1/f noise explain the power in each octave of frequency."""
        return self.misfit <= _MISFIT

    def density(self, clock: Clock) -> np.ndarray:
        """Expected periodogram (K,) of this white and 1/f noise at a clock's frequencies."""
        return self.white**2 * clock.white + self.flicker**2 * clock.flicker


def fit(density: np.ndarray, keep: np.ndarray, clock: Clock) -> Spectrum:
    """Fit white and 1/f noise to a periodogram (K,) at the frequencies ``keep`` (K,), boolean.

    Where these do not explain it (a vibrating arm), the 1/f part is fitted below `BELOW_ARM_HZ`,
    and the white part gets the rest, so that a row's variance is kept.
    """
    seen, basis = density[keep], np.stack([clock.white[keep], clock.flicker[keep]])
    power, information = _scored(seen, basis)
    misfit = _misfit(seen / (power @ basis))
    if misfit > _MISFIT:
        return _coloured(density, keep, clock, misfit)
    std = np.sqrt(np.diagonal(np.linalg.inv(information)))
    most = float(np.sqrt(power[1] + _ONE_SIDED * std[1]))
    if power[1] > _SHOWN * std[1]:
        white, flicker = np.sqrt(power)
        white_std, flicker_std = (_root_std(p, s) for p, s in zip(power, std, strict=True))
        return Spectrum(float(white), float(flicker), white_std, flicker_std, most, misfit)
    alone = float(seen.mean() / basis[0, 0])
    white_std = _root_std(alone, alone / np.sqrt(len(seen)))
    return Spectrum(float(np.sqrt(alone)), 0.0, white_std, float("nan"), most, misfit)


def _scored(seen: np.ndarray, basis: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Fit densities ``seen`` (n,) by Fisher scoring with the unit spectra of white and 1/f noise,
    ``basis`` (2, n): powers (2,) and information (2, 2)."""
    power = np.array([seen[len(seen) // 2 :].mean() / basis[0, 0], 0.0])
    low = slice(0, max(2, len(seen) // 50))
    power[1] = max(0.0, float(np.mean((seen[low] - power[0] * basis[0, low]) / basis[1, low])))
    from scipy.optimize import nnls  # slow to load: only when it is used

    information = np.eye(2)
    for _ in range(_ROUNDS):
        expected = power @ basis
        scaled = basis / expected
        information = scaled @ scaled.T
        new = nnls(scaled.T, seen / expected)[0]
        settled = np.abs(new - power) <= _SETTLED * power.max()
        power = 0.5 * (power + new)
        if settled.all():
            break
    return power, information


def _coloured(density: np.ndarray, keep: np.ndarray, clock: Clock, misfit: float) -> Spectrum:
    """Fit the 1/f part of a periodogram (K,) to its low frequencies alone, of those in ``keep``
    (K,); the white part is the rest of the variance. ``misfit`` goes into the result."""
    low = np.flatnonzero(keep & (clock.frequency <= BELOW_ARM_HZ))
    low = low if len(low) > 1 else np.flatnonzero(keep)[:2]
    seen, basis = density[low], np.stack([clock.white[low], clock.flicker[low]])
    if len(seen) >= _ENOUGH_LOW:
        power, information = _scored(seen, basis)
        flicker, std = float(power[1]), float(np.sqrt(np.linalg.inv(information)[1, 1]))
    else:  # too few to tell the white floor: an upper estimate
        flicker = float(np.mean(seen / basis[1]))
        std = flicker / np.sqrt(len(seen))
    step = clock.rate / clock.rows
    shown = flicker * float(clock.flicker.sum()) * step
    white = max(float(density.sum()) * step - shown, 0.0)
    white_std = float(np.sqrt((density**2).sum())) * step
    return Spectrum(
        float(np.sqrt(white)), float(np.sqrt(flicker)), _root_std(white, white_std),
        _root_std(flicker, std), float(np.sqrt(flicker + _ONE_SIDED * std)), misfit,
    )  # fmt: skip


def _root_std(power: float, std: float) -> float:
    """Standard uncertainty of √power, from the standard uncertainty of ``power``."""
    return float(std / (2.0 * np.sqrt(power)) if power > std else np.sqrt(std) / 2.0)


def octaves(count: int) -> Iterator[slice]:
    """Yield slices that divide ``count`` frequencies: first 4, each next one twice as many."""
    first, size = 0, 4
    while first < count:
        last = first + size if count - first - size >= size else count
        yield slice(first, last)
        first, size = last, 2 * size


def _misfit(ratio: np.ndarray) -> float:
    """Mean over octaves of (mean ratio − 1)² times the number of frequencies: 1 is expected.
    ``ratio`` (K,): measured over fitted density."""
    parts = [ratio[part] for part in octaves(len(ratio))]
    return float(np.mean([(part.mean() - 1.0) ** 2 * len(part) for part in parts]))
