"""A black box: a flexible model of the residual, which closes a gap and names nothing."""

import numpy as np

from wrenchbed.diagnosis.evidence.features import variables
from wrenchbed.diagnosis.prepare.prepared import Prepared

RIDGES = 10.0 ** np.arange(-3.0, 3.0, 0.5)
"""Prior variances of a coefficient, in noises of a row, that are tried."""
NOISES = 2.0 ** np.arange(0.0, 8.0)
"""Variances of what the box does not fit, in noises of a row, that are tried."""


def black_box(prepared: Prepared, reading: np.ndarray) -> np.ndarray:
    """What a ridge regression on all kernels adds to readings (M, 6) of a simulator.

    Fitted on the rows of the fit, channel by channel, with the prior of largest evidence.
    """
    held, fit = prepared.scene.held, ~prepared.sealed
    x = np.concatenate(list(variables(prepared).values()), axis=1)
    x = (x - x[fit].mean(axis=0)) / np.maximum(x[fit].std(axis=0), 1e-9)
    x = np.column_stack([np.ones(len(x)), x])
    use = np.flatnonzero(fit)[:: prepared.stride]
    target = ((prepared.y - reading[held]) / prepared.sigma)[use]
    u, s, vt = np.linalg.svd(x[use], full_matrices=False)
    inside = u.T @ target
    outside = (target**2).sum() - (inside**2).sum()
    free = target.size - inside.size

    def evidence(prior: float, noise: float) -> float:
        k = (s**2 * prior + noise)[:, None]
        fitted = (inside**2 / k).sum() + 6 * np.log(k).sum()
        return -0.5 * float(fitted + outside / noise + free * np.log(noise))

    noises = float(prepared.noise.mean()) * NOISES
    prior, noise = max(((p, v) for p in RIDGES for v in noises), key=lambda t: evidence(*t))
    shrunk = (s * prior / (s**2 * prior + noise))[:, None] * inside
    result = np.zeros_like(reading)
    result[held] = x @ (vt.T @ shrunk) * prepared.sigma
    return result
