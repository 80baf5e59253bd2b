"""Noise of rows: its memory at rest, and in motion its spectrum above the gap's band.

A gap changes as slowly as the robot moves, noise does not: above `EDGE` of the rate of the averages
there is hardly anything but noise, and below it noise is taken as it is just above. Noise is
steady, jumps and reversals are not: it is estimated from the quieter of short stretches, scaled to
the mean of all (minimum statistics, Martin 2001, doi 10.1109/89.928915).
"""

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft
from scipy.special import chdtri

from wrenchbed.calibration.observations import Observations, floored
from wrenchbed.data.holds import ROWS_AT_ONCE, about_means
from wrenchbed.data.recording import Recording
from wrenchbed.physics.wrench import CHANNELS, UNITS

EDGE, ABOVE = 0.3, 4.0
"""Noise is taken from ``EDGE`` times the averages' rate, above any gap, to ``ABOVE`` times that."""
STRETCH_S, LEAST = 1.0, 32
"""Length [s] of the stretches of a motion that are compared, and their least number of rows."""
QUIET = 0.2, 0.5
"""Quantiles of the stretches' power that give the noise; the smaller of both estimates counts."""
HANN = (4 / 9, 1 / 36)
"""Correlation of a periodogram's neighbours under a Hann window (Welch 1967)."""
OVER, CHANCE = 1.5, 1e-3
"""Ratio of the scatter within poses to the stated noise above which the latter is wrong, more than
data sheets vary by, and the probability that chance exceeds it: once in a thousand recordings."""
MOVE_S, TOGETHER = 0.1, 0.7
"""Lag [s] after which a sensor's noise is forgotten and a motion is not, and the correlation of
rows at that lag from which they move: they share more than half of their variance."""
AT_ONE, NEIGHBOURS, LEAST_IN_POSE = 0.6, 3, 32
"""Share of the scatter within this number of frequency bins (the window's main lobe) from which it
is periodic, and rows that a pose needs for the test: twice white noise's share in them, ≤ 0.3."""


def noise_in_motion(
    residual: np.ndarray, period: float, stride: int
) -> tuple[np.ndarray, np.ndarray]:
    """Noise variance (6,) of a row, and that of averages of ``stride`` rows times ``stride``, from
    the residual of rows (N, 6), in its unit squared, sampled each ``period`` [s]."""
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
    quiet = np.array(QUIET)
    each = np.quantile(power[near], quiet, axis=2) / chdtri(2, 1.0 - quiet)[:, None, None] * 2.0
    level = np.median(each, axis=1).min(axis=0)
    one_sided = np.where(f > 0.0, 1.0, 0.5)  # of the first interval, half belongs to f < 0
    variances = [
        _sum(power[fast], weight[fast]) + level * weight[~fast].sum()
        for weight in (one_sided, stride * passed * one_sided)
    ]
    return variances[0] * f[1], variances[1] * f[1]


def _sum(power: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Weighted sum (6,) over frequencies, ``weight`` (F,), of a power's (F, 6, T) steady part."""
    quiet = np.array(QUIET)
    spread = weight @ weight
    for k, c in enumerate(HANN, start=1):
        spread += 2.0 * c * float(weight[k:] @ weight[:-k])
    freedom = 2.0 * weight.sum() ** 2 / spread
    parts = np.einsum("f,fct->ct", weight, power)
    white = chdtri(freedom, 1.0 - quiet) / freedom
    return np.asarray((np.quantile(parts, quiet, axis=1) / white[:, None]).min(axis=0))


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


def not_systematic(
    recording: Recording, data: Observations, covariance: np.ndarray, source: str
) -> tuple[np.ndarray, str, str]:
    """Covariance of a row (6, 6), its source, and a note if repeats contradict a stated noise.

    What moves slowly or at one frequency within poses is no noise: joints that froze while the
    robot went on, or a vibration. The stated noise is used there, so that it remains a gap.
    """
    stated = recording.metadata.sensor.noise_std
    if source != "repeats" or stated is None:
        return covariance, source, ""
    floor = floored(np.diag(np.square(stated)), recording)
    std, measured = np.sqrt(np.diagonal(floor)), np.sqrt(np.diagonal(covariance))
    chance = float(np.sqrt(chdtri(data.dof, CHANCE) / data.dof))
    over = measured > OVER * chance * std
    if not over.any():
        return covariance, source, ""
    moves = over & systematic(recording, data)
    ratio = measured / np.maximum(std, 1e-12)
    k = int(np.argmax(np.where(moves if moves.any() else over, ratio, 0)))
    text = (
        f"rows of {CHANNELS[k]} within a pose scatter by {measured[k]:.3g} {UNITS[k]} rms, "
        f"{std[k]:.3g} {UNITS[k]} is stated: "
    )
    if not moves.any():
        return covariance, source, text + "the measured scatter counts as noise"
    why = "it moves together, as noise does not, so that the stated noise counts: did the joints "
    return floor, "stated", text + why + "freeze while the robot moved on, or did the tool vibrate?"


def systematic(recording: Recording, data: Observations) -> np.ndarray:
    """Whether each channel's rows (6,) move slowly or at one frequency within poses, boolean."""
    keep = data.keep
    rows = [recording.columns[c][keep] for c in CHANNELS]
    period = float(np.median(np.diff(recording.t)))
    lag = max(1, round(MOVE_S / max(period, 1e-9)))
    late, now, peak, power = (np.zeros(6) for _ in range(4))
    for some, away in about_means(rows, data.wrench, data.count):
        for r in np.split(away, np.cumsum(data.count[some])[:-1]):
            if len(r) > 3 * lag:
                late += (r[lag:] * r[:-lag]).sum(axis=0)
                now += (r[lag:] ** 2).sum(axis=0)
            if len(r) >= LEAST_IN_POSE:
                spectrum = np.square(np.abs(rfft(r, axis=0)))
                sums = np.cumsum(np.vstack([np.zeros(6), spectrum]), axis=0)
                peak += (sums[NEIGHBOURS:] - sums[:-NEIGHBOURS]).max(axis=0)
                power += spectrum.sum(axis=0)
    return (late > TOGETHER * np.maximum(now, 1e-300)) | (peak > AT_ONE * np.maximum(power, 1e-300))
