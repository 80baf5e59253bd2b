"""Whether a recording is like the learning cases: a test of exchangeability.

Features of the design and of the unexplained residual make a point. Its Mahalanobis distance,
ranked among those of the learning cases, has a conformal p-value (Vovk et al. 2005) that assumes no
distribution of the points.
"""

from collections.abc import Sequence

import numpy as np

from wrenchbed.diagnosis.explain.claims import allowed
from wrenchbed.diagnosis.explain.structures import MARGIN, Analysis

NAMES = ("joints", "observations", "rows", "force", "torque", "orientations", "rest")
"""Features: joints; then as decimal logarithms observations, rows of each, force and torque over
the noise of a row, and the least mean square of the load's direction along any axis; last the share
of the gap that the best explanation leaves abnormally, 0 where a smooth function predicts it."""
LEAST_P = 0.01
"""p-value below which a recording counts as unlike the learning cases."""
RIDGE = 1e-3
"""Variance added to each feature, so that one equal in all learning cases may differ a little."""


def design_of(a: Analysis) -> tuple[float, ...]:
    """Features of a recording and its analysis, in the order of `NAMES`."""
    p = a.prepared
    load = p.scene.load[p.scene.held][:, :6]
    size = np.sqrt((load**2).reshape(-1, 2, 3).mean(axis=(0, 2)))
    size = size / p.row_sigma[:6].reshape(2, 3).mean(axis=1)
    force = load[:, :3] / np.maximum(np.linalg.norm(load[:, :3], axis=1, keepdims=True), 1e-9)
    spread = np.linalg.eigvalsh(force.T @ force / len(force))[0]
    best = a.ranking.explanations[0]
    smooth = a.ranking.mixed >= best.log_posterior + MARGIN
    rest = 0.0 if smooth else max(best.rest - allowed(best), 0.0)
    values = (len(p.y), float(np.mean(p.count)) * p.stride, *size, spread)
    logs = np.log10(np.maximum(values, 1e-6))
    share = rest / max(rest, a.ranking.gap, 1.0)
    return (float(len(p.robot.joints)), *(float(v) for v in logs), float(share))


def p_value(design: Sequence[float], designs: np.ndarray) -> float:
    """Conformal p-value that a recording with features ``design`` (F,) is like those from which the
    probabilities were learnt, ``designs`` (N, F): the share of these N + 1 points whose Mahalanobis
    distance from their common mean is at least the recording's."""
    points = np.vstack([designs, np.asarray(design)])
    away = points - points.mean(axis=0)
    covariance = away.T @ away / len(points) + RIDGE * np.eye(points.shape[1])
    distance = np.einsum("nf,nf->n", away, np.linalg.solve(covariance, away.T).T)
    return float((distance >= distance[-1]).mean())
