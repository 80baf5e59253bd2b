"""Whether the energy of a channel, or of a band of frequencies, exceeds that of its noise.

The noise of averaged rows follows from the scatter of raw ones, their memory included. The spread
of blocks of rows sets the degrees of freedom of an energy (Satterthwaite 1946,
doi 10.2307/3002019), whatever the tails.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.special import chdtrc

from wrenchbed.diagnosis.prepare.noise import HANN
from wrenchbed.diagnosis.prepare.prepared import Prepared

FITTED = 10
"""Numbers that every user fits: bias, mass, CoG."""
EDGES_HZ = (0.0, 1.0, 2.0, 4.0, 8.0, 16.0)
LEAST_P = 1e-300
_LAGS = 4
"""Averaged rows over which noise may have memory."""
_SCALE_VARIANCE = 4.0
"""Relative variance of the noise of averaged rows as estimated, times rows."""
_MEMORY = 2.0
"""A correlation of raw rows counts up to the first that is below so many standard errors."""


@dataclass(frozen=True, eq=False)
class ChannelLevel:
    """Energies of n channels or bands.

    Attributes:
        names: of the channels or bands (n,).
        ratio: energy over that of the noise (n,).
        p_value: of each alone (n,).
        excess: energy above the noise, in shares of the sum over all (n,).
    """

    names: tuple[str, ...]
    ratio: np.ndarray
    p_value: np.ndarray
    excess: np.ndarray


def holm(p_value: np.ndarray) -> np.ndarray:
    """Family-wise p-values (n,) from each alone (Holm 1979)."""
    order = np.argsort(p_value)
    raised = np.maximum.accumulate(p_value[order] * np.arange(len(order), 0, -1))
    result = np.empty(len(order))
    result[order] = np.minimum(1.0, raised)
    return result


def channels(
    prepared: Prepared, residual: np.ndarray, covariance: np.ndarray, names: tuple[str, ...]
) -> ChannelLevel:
    """Energy of each channel of a whitened residual (R, 6).

    Args:
        covariance: of the fit's rows at lags 0 … (lags, 6), whitened, from ``autocovariance``.
    """
    square = residual**2 / covariance[0]
    rows = len(square)
    sums, count = _by_block(square, prepared.block_rows)
    mean = square.mean(axis=0)
    deviation = sums - count[:, None] * mean
    spread = (deviation**2).sum(axis=0) / np.maximum(sums.sum(axis=0), 1e-100) ** 2
    spread = spread * (len(count) + 1) / (len(count) - 1)  # itself uncertain
    relative = np.maximum(spread, max(float(spread.mean()), 2.0 / rows))
    relative = 2.0 * relative - 2.0 / rows  # heavy tails are heavier than a few blocks show
    if prepared.moving:
        relative = relative + _SCALE_VARIANCE / rows
    ratio = mean * rows / max(rows - FITTED / 6, 1.0)
    return ChannelLevel(names, ratio, _exceeding(ratio, relative), _excess(ratio - 1.0))


def bands(prepared: Prepared, residual: np.ndarray, covariance: np.ndarray) -> ChannelLevel:
    """Energy of octaves of a motion's whitened residual (R, 6), by Welch's periodogram."""
    block = prepared.block_rows
    first = np.flatnonzero(np.diff(block, prepend=-1))
    length = int(np.diff(np.append(first, len(block))).min())
    pieces = residual[first[:, None] + np.arange(length)]  # (B, L, 6)
    window = np.hanning(length + 2)[1:-1]
    centred = (pieces - pieces.mean(axis=1, keepdims=True)) * window[:, None]
    power = np.abs(np.fft.rfft(centred, axis=1)) ** 2 / (window**2).sum()
    rate = 1.0 / (prepared.scene.period * prepared.stride)
    frequency = np.fft.rfftfreq(length, 1.0 / rate)
    wave = np.cos(2 * np.pi * np.outer(frequency / rate, np.arange(1, len(covariance))))
    noise = covariance[0] + 2.0 * wave @ covariance[1:]
    relative = (power / np.maximum(noise, 0.3 * covariance[0])).mean(axis=2)  # (B, bins)
    nyquist = 0.5 * rate
    edges = [*(e for e in EDGES_HZ if e < nyquist), nyquist * (1 + 1e-9)]
    names, ratio, theory, inflated, excess = [], [], [], [], []
    for low, high in pairwise(edges):
        inside = (frequency >= low) & (frequency < high) & (frequency > 0)
        n = int(inside.sum())
        if n == 0:
            continue
        each = relative[:, inside].mean(axis=1)
        names.append(f"frequency {low:g}–{high:.3g} Hz")
        ratio.append(float(each.mean()))
        overlap = 1.0 + 2.0 * sum(c * max(0.0, 1 - (i + 1) / n) for i, c in enumerate(HANN))
        theory.append(overlap / (6 * n * len(each)))
        spread = float(each.var(ddof=1)) / len(each) / max(ratio[-1], 1e-100) ** 2
        inflated.append(spread / theory[-1])
        excess.append((power[:, inside] - noise[inside]).sum())
    pooled = np.maximum(inflated, max(1.0, float(np.mean(inflated))))
    variance = np.array(theory) * pooled + _SCALE_VARIANCE / (6 * len(residual))
    level = np.array(ratio)
    return ChannelLevel(tuple(names), level, _exceeding(level, variance), _excess(np.array(excess)))


def autocovariance(prepared: Prepared) -> np.ndarray:
    """Noise of the fit's rows in whitened units at lags 0 … 3 (4, 6).

    At rest rows are poses, without memory. In motion the variogram of raw rows holds their memory
    and little of a slow gap: var(mean of s) = Σ (s − |k|) ρ(k) / s². The variance of a raw
    row is 1 as stated; a slow gap that does show makes the noise larger, not smaller.
    """
    result = np.zeros((_LAGS, 6))
    result[0] = prepared.variance
    if not prepared.moving:
        return result
    s = prepared.stride
    raw = prepared.residual / prepared.sigma
    block = np.where(prepared.sealed, -1 - np.arange(len(raw)), prepared.block)
    vario = np.zeros(((_LAGS + 1) * s, 6))
    for k in range(1, len(vario)):
        inside = block[k:] == block[:-k]
        vario[k] = 0.5 * np.mean((raw[k:] - raw[:-k])[inside] ** 2, axis=0)
    far = np.maximum(vario[_LAGS * s :].mean(axis=0), 1e-300)
    rho = 1.0 - vario / far
    rho *= np.logical_and.accumulate(rho > _MEMORY / np.sqrt(len(raw)), axis=0)
    rho[0] = 1.0
    weight = s - np.abs(np.arange(1 - s, s))
    for lag in range(_LAGS):
        at = np.abs(lag * s + np.arange(1 - s, s))
        result[lag] = weight @ np.where(at[:, None] < _LAGS * s, rho[at % len(rho)], 0.0) / s**2
    result[0] = np.clip(result[0], 0.5 / s, 1.0)
    return result


def _exceeding(ratio: np.ndarray, relative: np.ndarray) -> np.ndarray:
    freedom = 2.0 / relative
    return np.maximum(np.asarray(chdtrc(freedom, freedom * ratio)), LEAST_P)


def _excess(energy: np.ndarray) -> np.ndarray:
    above = np.maximum(energy, 0.0)
    return above / max(float(above.sum()), 1e-300)


def _by_block(x: np.ndarray, block: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    numbers, at, count = np.unique(block, return_inverse=True, return_counts=True)
    sums = np.zeros((len(numbers), x.shape[1]))
    np.add.at(sums, at, x)
    return sums, count
