"""Uncertainty that grows with misfit: what a fit leaves over is never taken as knowledge.

Misfit of a model is smooth in the pose, noise is not. What the residual holds of the lowest
functions of gravity's direction measures how much of the same size the fit has swallowed in each
of its parameters, whose derivatives are such functions too.
"""

from dataclasses import replace

import numpy as np
from scipy import special

from wrenchbed.calibration.fit_problem import Outcome, Problem
from wrenchbed.calibration.least_squares import BLIND, triangular
from wrenchbed.calibration.observability import RANK_TOLERANCE
from wrenchbed.physics.time_derivatives import value

DOUBT = 1e-3
"""P-value below which the residual counts as dependent on the pose."""
MOVED = 5.0
"""Standard uncertainties by which a zero of the sensor moves a parameter, if it matters."""
CLEAR = 10.0
"""Standard uncertainties of white noise by which the zero itself differs from none; estimate."""
ROUNDING = 1e-9
"""Residual over the largest reading that counts as zero."""
ENOUGH = 2000
"""Observations from which a zero is determined well enough."""


def grown(
    problem: Problem, outcome: Outcome, known: np.ndarray | None, smooth: np.ndarray | None = None
) -> Outcome:
    """The outcome with a covariance that misfit has only made larger.

    Args:
        problem: what was fitted.
        outcome: with weights from the residual.
        known: covariance (K, K) by the known noise alone, if it is known.
        smooth: `functions` of the problem, where they are known already.
    """
    smooth = functions(problem) if smooth is None else smooth
    covariance = outcome.covariance * _power(problem, outcome, smooth)
    if known is not None:
        now, least = np.sqrt(np.diagonal(covariance)), np.sqrt(np.diagonal(known))
        factor = np.maximum(1.0, np.divide(least, now, out=np.ones_like(now), where=now > 0.0))
        covariance = covariance * np.outer(factor, factor)
    return replace(outcome, covariance=covariance)


def _power(problem: Problem, outcome: Outcome, smooth: np.ndarray) -> float:
    """Power of the residual in a function of the pose over its power in any, at least 1."""
    residual = problem.residual(outcome.solution.x)
    count, many = len(residual), smooth.shape[1]
    dims = 6 * many - len(problem.free)
    if count < 3 * many or dims < many:
        return 1.0
    noise = outcome.noise
    usual = np.square(noise.scatter) * _correlated(outcome, count)
    power = float((((smooth.T @ residual) ** 2) / np.maximum(usual, 1e-300)).sum())
    return max(1.0, power / dims) if special.chdtrc(dims, power) < DOUBT else 1.0


def _correlated(outcome: Outcome, count: int) -> np.ndarray:
    """Observations that one independent one stands for (6,), 1 at rest."""
    noise = outcome.noise
    if noise.rows > 1.0:
        return np.ones(6)
    share = np.minimum(1.0, np.square(noise.expected / np.maximum(noise.scatter, 1e-300)))
    worth = noise.effective / (share if noise.inflated else 1.0)
    return np.maximum(1.0, count / np.maximum(worth, 1.0))


def functions(problem: Problem) -> np.ndarray:
    """Orthonormal functions (M, ≤ 9) of gravity's direction in the sensor, up to quadratic."""
    robot = problem.model.robot
    robot_theta = robot.robot_theta(problem.theta)
    seen = robot.gravity_seen(value(problem.data.q), robot_theta, np.asarray(problem.model.gravity))
    x, y, z = (seen / np.linalg.norm(problem.model.gravity)).T
    one = np.ones_like(x)
    design = np.column_stack([one, x, y, z, x * y, y * z, z * x, x * x - y * y, 3.0 * z * z - 1.0])
    u, s, _ = np.linalg.svd(design, full_matrices=False)
    return np.asarray(u[:, s > 1e-2 * s[0]])


def zero(problem: Problem, outcome: Outcome) -> np.ndarray | None:
    """Zero of the sensor (6,) [N, N·m] that the model lacks; None if no parameter hangs on it."""
    names = {problem.model.parameters.names[i] for i in problem.free}
    if any(name.startswith("sensor.bias") for name in names):
        return None
    x, count = outcome.solution.x, len(problem.free)
    some = np.unique(np.linspace(0, len(problem.data) - 1, ENOUGH).astype(int))
    residual = problem.residual(x)[some]
    unit = np.maximum(residual.std(axis=0), ROUNDING * np.abs(problem.data.wrench).max(axis=0))
    slopes = problem.jacobian(x)[some] * problem.scale / unit[:, None]
    constant = np.broadcast_to(np.eye(6), (len(some), 6, 6))
    design = np.concatenate([slopes, constant], axis=2).reshape(-1, count + 6)
    target = (residual / unit).ravel()
    if problem.prior:
        design = np.vstack([design, np.eye(count, count + 6)])
        target = np.append(target, (problem.centre - x) / problem.scale)
    triangle, turned = triangular(design, target)
    u, s, vt = np.linalg.svd(triangle, full_matrices=False)
    keep = s > RANK_TOLERANCE * s[0]
    back = vt[keep].T / s[keep]
    found, spread = back @ (u[:, keep].T @ turned), np.linalg.norm(back, axis=1)[count:]
    std = np.sqrt(np.diagonal(outcome.covariance))
    moved = np.abs(found[:count]) * problem.scale > MOVED * std
    clear = np.abs(found[count:]) > CLEAR * spread
    if not (clear.any() and (moved & (outcome.solution.blind < BLIND)).any()):
        return None
    return np.asarray(found[count:] * unit)
