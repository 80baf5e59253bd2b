"""Noise of rows: its memory at rest, and in motion the spectrum of what moves faster than a gap.

A gap moves as slowly as the robot, noise does not: above `EDGE` of the rate of the averages there
is hardly anything but noise, and below it noise is taken as it is just above. Noise is the same all
the time, jumps and reversals are not: it is estimated from the quieter of short stretches, scaled
to the mean of all (minimum statistics, Martin 2001, doi 10.1109/89.928915).
"""

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft
from scipy.special import chdtri

from wrenchbed.calibration.observations import Observations
from wrenchbed.data.holds import ROWS_AT_ONCE
from wrenchbed.data.recording import Recording
from wrenchbed.physics.wrench import CHANNELS

EDGE, ABOVE = 0.3, 4.0
"""Of the rate of the averages: no gap above; and, of that edge, up to where noise below it is
taken from."""
STRETCH_S, LEAST = 1.0, 32
"""Length of a stretch [s, rows at least]."""
QUIET = 0.2, 0.5
"""Shares of stretches that are quieter; the smaller of both estimates counts."""
HANN = (4 / 9, 1 / 36)
"""Correlation of a periodogram's neighbours under a Hann window (Welch 1967)."""


def noise_in_motion(
    residual: np.ndarray, period: float, stride: int
) -> tuple[np.ndarray, np.ndarray]:
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
    one_sided = np.where(f > 0.0, 1.0, 0.5)  # of the first interval, half belongs to f < 0
    variances = [
        _sum(power[fast], weight[fast]) + level * weight[~fast].sum()
        for weight in (one_sided, stride * passed * one_sided)
    ]
    return variances[0] * f[1], variances[1] * f[1]


def _sum(power: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Weighted sum (6,) over frequencies of steady noise in the power (F, 6, stretches)."""
    share = np.array(QUIET)
    spread = weight @ weight
    for k, c in enumerate(HANN, start=1):
        spread += 2.0 * c * float(weight[k:] @ weight[:-k])
    freedom = 2.0 * weight.sum() ** 2 / spread
    parts = np.einsum("f,fct->ct", weight, power)
    white = chdtri(freedom, 1.0 - share) / freedom
    return np.asarray((np.quantile(parts, share, axis=1) / white[:, None]).min(axis=0))


def correlation_time(recording: Recording, data: Observations) -> np.ndarray:
    """Integrated autocorrelation time of rows within poses (6,) [rows], at least 1."""
    if len(data.count) == 0 or np.min(data.count) < 8 or data.left_out:
        return np.ones(6)
    n, holds = int(np.min(data.count)), len(data.count)
    starts = np.concatenate([[0], np.cumsum(data.count)[:-1]])
    size = next_fast_len(n + n // 4, real=True)  # as long as the lags that are asked for
    tau = np.ones(6)
    for k, name in enumerate(CHANNELS):
        column, product = recording.columns[name], np.zeros(n // 4)
        for some in np.array_split(starts, max(1, holds * n // ROWS_AT_ONCE)):
            rows = column[some[:, None] + np.arange(n)]  # (some of H, n)
            rows = rows - rows.mean(axis=1, keepdims=True)
            power = np.square(np.abs(rfft(rows, size, axis=1))).sum(axis=0)
            product += irfft(power, size)[: n // 4]
        rho = product / max(product[0], 1e-300 * holds * n)
        rho = rho[1:] + 1.0 / n  # the mean taken from each hold biases it
        tau[k] += 2.0 * rho[rho > 2.0 / np.sqrt(holds * n)].sum()
    return tau
