"""Noise of a motion's rows and of their averages, from the spectrum of a residual.

A gap moves as slowly as the robot, noise does not: above `EDGE` of the rate of the averages there
is noise only, and below it noise is taken as it is just above. The median over stretches (Allen et
al. 2012, doi 10.1103/PhysRevD.85.122006) leaves reversals and jumps out.
"""

import numpy as np
from scipy.signal import spectrogram

EDGE, ABOVE = 0.3, 3.0
"""Of the rate of the averages: no gap above; and, of that edge, up to where noise below it is
taken from."""
STRETCH_S, LEAST = 2.0, 32
"""Length of a stretch [s, rows at least]."""


def noise(residual: np.ndarray, period: float, stride: int) -> tuple[np.ndarray, np.ndarray]:
    """Variance of a row (6,), and of the average of ``stride`` rows times ``stride`` (6,).

    Args:
        residual: rows of a motion (N, 6), any unit.
        period: between rows [s].
    """
    length = min(len(residual), max(LEAST, round(STRETCH_S / period)))
    f, _, power = spectrogram(
        residual, 1.0 / period, "hann", length, length // 2, detrend="linear", axis=0
    )  # (F, 6, stretches)
    wave = np.pi * f * period
    passed = np.ones(len(f))
    passed[1:] = (np.sin(stride * wave[1:]) / (stride * np.sin(wave[1:]))) ** 2
    edge = EDGE / (stride * period)
    slow, near = f < edge, (f >= edge) & (f < ABOVE * edge)
    level = np.median(power[near], axis=(0, 2)) / np.log(2.0)  # of a variable that is χ² of 2
    result = []
    for weight in (np.ones(len(f)), stride * passed):
        fast = np.median(np.einsum("f,fct->ct", weight[~slow], power[~slow]), axis=1)
        result.append((fast + level * weight[slow].sum()) * f[1])
    return result[0], result[1]
