"""Noise of a channel that nobody states, from what neither nuisance nor effects explain.

The scatter within a pose lacks a sensor's systematic errors; the residual over all poses also holds
the cause that is sought. Here effects and noise share the residual by marginal likelihood (MacKay
1992, doi 10.1162/neco.1992.4.3.415): y = J c + e, c ~ N(0, s²), e ~ N(0, v).
"""

import numpy as np

SIZES = 4.0 ** np.arange(-3, 4)
"""Standard deviations s of effects, in typical sizes, that are tried: 1/64 to 64."""
LEVELS = np.logspace(-6.0, 0.0, 121)
"""Noise variances v over the residual's mean square that are tried."""
_RANK = 1e-9
"""Singular value over the largest one, below which a column depends on the others."""


def own_noise(residual: np.ndarray, nuisance: np.ndarray, columns: np.ndarray) -> float:
    """Estimate the standard deviation of one reading, in the unit of ``residual``.

    Args:
        residual: measured less expected readings (n,).
        nuisance: derivatives (n, k) by parameters that every fit takes up and no cause explains.
        columns: changes (n, m) of the readings by m effects of typical size.
    """
    basis = orthonormal(nuisance)
    y, free = residual - basis @ (basis.T @ residual), len(residual) - basis.shape[1]
    if free <= 0:
        return 0.0
    along, scale, _ = np.linalg.svd(columns - basis @ (basis.T @ columns), full_matrices=False)
    along, scale = along[:, :free], scale[:free]
    inside = (along.T @ y) ** 2
    outside = max(float(y @ y - inside.sum()), 0.0)
    level = LEVELS[:, None, None] * max(float(y @ y) / free, 1e-300)
    variance = level + (SIZES[:, None] * scale) ** 2  # (levels, sizes, m)
    log = (inside / variance + np.log(variance)).sum(axis=2) + outside / level[:, :, 0]
    log += (free - len(scale)) * np.log(level[:, :, 0])
    best = int(log.min(axis=1).argmin())
    return float(np.sqrt(level[best, 0, 0]))


def orthonormal(columns: np.ndarray) -> np.ndarray:
    """Orthonormal basis (n, r) of the space that columns (n, k) span, whatever their units."""
    norm = np.linalg.norm(columns, axis=0)
    scaled = columns / np.where(norm > 0.0, norm, 1.0)
    u, s, _ = np.linalg.svd(scaled, full_matrices=False)
    return np.asarray(u[:, s > _RANK * s.max(initial=0.0)])
