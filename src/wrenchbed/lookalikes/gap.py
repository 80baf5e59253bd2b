"""How far two readings are apart, in noise of one row, with what every fit takes out left out."""

import numpy as np

from wrenchbed.lookalikes.design import Design

STATED = ("sensor.bias", "tool.mass", "tool.cog")
"""Causes that count on the configured gap: a fit of bias, mass and CoG would hide them."""


def gap(design: Design, difference: np.ndarray, *, configured: bool = False) -> float:
    """Mean of r'Σ⁻¹r/6 of a noise-free difference (N, 6), Σ from ``noise_std``.

    Args:
        configured: count all of it, not only what bias, mass and CoG cannot take up.
    """
    r = (difference / design.noise_std).ravel()
    total = float(r @ r)
    if not configured:
        part = design.nuisance.T @ r
        total -= float(part @ part)
    return max(total, 0.0) / len(r)
