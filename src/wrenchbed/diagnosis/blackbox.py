"""A black box: a flexible model of the residual, which closes a gap and names nothing."""

import numpy as np

from wrenchbed.diagnosis.features import variables
from wrenchbed.diagnosis.prepare import Prepared

RIDGES = 10.0 ** np.arange(-3.0, 3.0, 0.5)
"""Prior variances of a coefficient, in noises of a row, that are tried."""


def black_box(prepared: Prepared, reading: np.ndarray) -> np.ndarray:
    """What a ridge regression on all kernels adds to readings (M, 6) of a simulator.

    Fitted on the unsealed rows, channel by channel; its one size is the one of largest evidence.
    """
    held, fit = prepared.scene.held, ~prepared.sealed
    x = np.concatenate(list(variables(prepared).values()), axis=1)
    x = (x - x[fit].mean(axis=0)) / np.maximum(x[fit].std(axis=0), 1e-9)
    x = np.column_stack([np.ones(len(x)), x])
    target = (prepared.y - reading[held]) @ prepared.turn.T
    use = np.flatnonzero(fit)[:: prepared.stride]
    u, s, vt = np.linalg.svd(x[use], full_matrices=False)
    turned, rest = u.T @ target[use], (target[use] ** 2).sum() - ((u.T @ target[use]) ** 2).sum()
    noise = float(prepared.noise.mean())
    loose = target[use].size - turned.size

    def evidence(prior: float, level: float) -> float:
        k = (s**2 * prior + level)[:, None]
        fitted = (turned**2 / k).sum() + 6 * np.log(k).sum()
        return -0.5 * float(fitted + rest / level + loose * np.log(level))

    levels = noise * 2.0 ** np.arange(0.0, 8.0)
    prior, level = max(((p, v) for p in RIDGES for v in levels), key=lambda t: evidence(*t))
    shrunk = (s * prior / (s**2 * prior + level))[:, None] * turned
    guess = x @ (vt.T @ shrunk) @ np.linalg.inv(prepared.turn).T
    result = np.zeros_like(reading)
    result[held] = guess
    return result
