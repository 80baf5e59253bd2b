"""Weights of a fit, from the data: repeats, stated noise, or the residual.

The mean of a hold (a pose at rest) has an independent error and one that wanders slowly as 1/f
noise does: neighbouring holds err together, and wander limits how well the bias of a recording is
known. Both levels are found per channel by restricted maximum likelihood (Patterson & Thompson
1971, doi 10.1093/biomet/58.3.545), which allows for the fitted parameters.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy import special
from scipy.fft import next_fast_len
from scipy.special import sici

from wrenchbed.calibration.fit import FitNoise
from wrenchbed.calibration.fit_problem import Outcome, Problem, Whitening
from wrenchbed.calibration.least_squares import Solution
from wrenchbed.calibration.observations import FALLBACK_COVARIANCE, Observations
from wrenchbed.physics.taylor_jets import Jet

_MOST_POSES = 1500
"""Most poses for which the N × N eigenvectors are worth their cost."""
_DECADES_BELOW = 1.0
"""Decades by which the 1/f band reaches below the inverse of the campaign's length."""
_RANGE = (-8.0, 12.0)
"""Searched range of the natural logarithm of wander over independent variance."""
_SEARCHED = 0.01
"""Accuracy of that logarithm: 1 % of a ratio that the data know to a factor of two at best."""
_REWEIGHTINGS, _SETTLED = 3, 1e-6
"""Most updates of the weights, and the relative change at which they have converged."""
_TRUST = 0.01
"""P-value of the residual's χ² below which the noise of the repeats does not explain it."""
_BATCHES = 20
_ENOUGH = 20
"""Poses in excess of the parameters from which the residual shows wander and correlation."""


@dataclass(frozen=True, eq=False)
class Wander:
    """Noise model of a hold's mean: independent variance (6,) and 1/f level (6,) [N², (N·m)²].

    ``basis`` (N, N) and ``spread`` (N,) are eigenvectors and eigenvalues of `kernel`, for N holds.
    """

    independent: np.ndarray
    level: np.ndarray
    basis: np.ndarray
    spread: np.ndarray

    def whiten(self, rows: np.ndarray) -> np.ndarray:
        """Transform rows (N, 6) or (N, 6, K) to unit variance without correlation in time."""
        turned = np.tensordot(self.basis.T, rows, axes=1)
        root = np.sqrt(self.independent + self.level * self.spread[:, None])
        return turned / root.reshape(root.shape + (1,) * (rows.ndim - 2))


def kernel(t: np.ndarray) -> np.ndarray:
    """Covariance matrix (N, N) of unit 1/f noise at times (N,) [s], ∫ cos(2πfτ)/f df from a tenth
    of the inverse of the whole time to one cycle a pose; faster noise looks independent."""
    span = float(t[-1] - t[0])
    low, high = 10.0**-_DECADES_BELOW / span, len(t) / span
    lag = 2 * np.pi * np.abs(t[:, None] - t)
    np.fill_diagonal(lag, 1.0)
    result = sici(high * lag)[1] - sici(low * lag)[1]
    np.fill_diagonal(result, np.log(high / low))
    return np.asarray(result)


def modes(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues (N,) and eigenvectors (N, N) of the 1/f kernel at times (N,) [s]."""
    spread, basis = np.linalg.eigh(kernel(t))
    return np.maximum(spread, 0.0), basis


def estimate(
    kernel_modes: tuple[np.ndarray, np.ndarray], residual: np.ndarray, design: np.ndarray,
    least: np.ndarray,
) -> Wander:  # fmt: skip
    """Estimate the levels of independent and 1/f noise in every channel.

    Args:
        kernel_modes: eigenvalues and eigenvectors, from `modes`.
        residual: measured − fitted (N, 6).
        design: derivatives of the readings by the parameters (N, 6, K).
        least: smallest variance of the independent part (6,).
    """
    spread, basis = kernel_modes
    columns = basis.T @ np.moveaxis(design, 1, 0)
    each = zip(columns, (basis.T @ residual).T, strict=True)
    independent, level = np.transpose([_levels(x, r, spread) for x, r in each])
    return Wander(np.maximum(independent, least), level, basis, spread)


def _levels(design: np.ndarray, residual: np.ndarray, spread: np.ndarray) -> tuple[float, float]:
    """Independent variance and 1/f level of one channel, from its derivatives (N, K), residual (N,)
    and kernel eigenvalues (N,), all in the basis of the kernel's eigenvectors."""
    from scipy.optimize import minimize_scalar  # slow to load: only when it is used

    u, s, _ = np.linalg.svd(design, full_matrices=False)
    span = u[:, s > 1e-9 * max(float(s[0]), 1e-300)]

    def restricted(ratio: float) -> tuple[float, float]:
        return _restricted(residual, span, 1.0 / (1.0 + ratio * spread))

    found = minimize_scalar(
        lambda x: restricted(float(np.exp(x)))[0], bounds=_RANGE, method="bounded",
        options={"xatol": _SEARCHED},
    )  # fmt: skip
    ratio = float(np.exp(found.x)) if found.fun < restricted(0.0)[0] else 0.0
    alone = restricted(ratio)[1]
    return alone, ratio * alone


def _restricted(r: np.ndarray, span: np.ndarray, weight: np.ndarray) -> tuple[float, float]:
    """Restricted −log likelihood of residuals r (N,) with weights (N,), and the variance of unit
    weight; ``span`` (N, k) are the orthonormal directions that the fit absorbs."""
    weighted = weight * r
    gram, right = span.T @ (weight[:, None] * span), span.T @ weighted
    dof = len(r) - len(right)
    square = max(float(r @ weighted - right @ np.linalg.solve(gram, right)) / dof, 1e-300)
    cost = dof * np.log(square) - np.log(weight).sum() + np.linalg.slogdet(gram)[1]
    return float(cost) / 2.0, square


def none_of(variance: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """Return a function that divides rows (N, 6) or (N, 6, K) by the root of a variance (6,)."""
    root = np.sqrt(variance)
    return lambda rows: rows / root.reshape(root.shape + (1,) * (rows.ndim - 2))


def fit(problem: Problem) -> Outcome:
    """Fit with the weights of the known noise (repeats or stated) if the residual agrees with it.

    Else weights come from the residual: its scatter, of enough poses its 1/f wander too, of motions
    always its correlation time. Uncertainties are never below those of the known noise.
    """
    data = problem.data
    if data.source == "residual" or not data.row_covariance.any():
        return _blind(problem)
    solution = problem.solve(_rows(data.row_covariance, data.count), problem.start)
    chi2 = float((solution.residual[: data.wrench.size] ** 2).sum())
    explained = bool(special.chdtrc(6 * problem.dof, chi2) > _TRUST)
    known = np.sqrt(np.diagonal(solution.covariance))
    if isinstance(data.q, Jet):
        outcome = _scattered(problem, solution, inflated=not explained)
        return outcome if explained else at_least(outcome, known)
    if explained:
        noise = _noise(problem, solution, data.source, float(data.count.sum()) * np.ones(6))
        return Outcome(solution, solution.covariance, data.dof, noise)
    few = len(data) - len(problem.free) < _ENOUGH or len(data) > _MOST_POSES
    if few or problem.loss != "linear":
        return at_least(_scattered(problem, solution), known)
    return at_least(_wandering(problem, solution), known)


def at_least(outcome: Outcome, least: np.ndarray) -> Outcome:
    """Raise the standard uncertainties of a fit to at least ``least`` (K,)."""
    now = np.sqrt(np.diagonal(outcome.covariance))
    factor = np.maximum(1.0, np.divide(least, now, out=np.ones_like(now), where=now > 0.0))
    return replace(outcome, covariance=outcome.covariance * np.outer(factor, factor))


def _rows(covariance: np.ndarray, count: np.ndarray) -> Whitening:
    """Return a whitening of means over ``count`` (M,) rows, whose row covariance is (6, 6)."""
    turn = np.linalg.inv(np.linalg.cholesky(covariance))

    def whiten(rows: np.ndarray) -> np.ndarray:
        factor = np.sqrt(count).reshape((-1, 1) + (1,) * (rows.ndim - 2))
        return np.asarray(np.moveaxis(np.tensordot(rows, turn, axes=(1, 1)), -1, 1) * factor)

    return whiten


def _blind(problem: Problem) -> Outcome:
    """Fit without known noise: one noise level of all forces and one of all torques, as residuals
    often are effects that the model lacks; their size in a single channel is chance."""
    data = problem.data
    solution = problem.solve(_rows(FALLBACK_COVARIANCE, np.ones(len(data))), problem.start)
    factor = 1.0
    for _ in range(_REWEIGHTINGS):
        variance = problem.residual_variance(solution.x)
        if _exact(variance, data):
            whitened = solution.residual[: data.wrench.size]
            factor = float(whitened @ whitened) / (6 * problem.dof)
            break
        pooled = np.repeat([variance[:3].mean(), variance[3:].mean()], 3)
        time = _correlation_time(problem, solution.x)
        solution = problem.solve(none_of(pooled * time), solution.x)
    effective = float(data.count.sum()) / _correlation_time(problem, solution.x)
    noise = _noise(problem, solution, "residual", effective)
    return Outcome(solution, solution.covariance * factor, problem.dof, noise)


def _scattered(problem: Problem, solution: Solution, inflated: bool = True) -> Outcome:
    """Refine a solution by weights from each channel's residual variance and correlation time.
    ``inflated``: whether the known noise explains less than the residual."""
    data = problem.data
    expected = np.diagonal(data.row_covariance) / float(np.mean(data.count))
    variance = np.zeros(6)
    for _ in range(_REWEIGHTINGS):
        # many parameters may swallow a channel's residual, never its noise
        measured = np.maximum(problem.residual_variance(solution.x), expected)
        time = _correlation_time(problem, solution.x)
        if np.allclose(measured * time, variance, rtol=_SETTLED, atol=0.0):
            break
        variance = measured * time
        solution = problem.solve(none_of(variance), solution.x)
    fraction = np.minimum(1.0, expected / np.maximum(measured, 1e-300)) if inflated else np.ones(6)
    effective = float(data.count.sum()) / time * fraction
    noise = _noise(problem, solution, data.source, effective, inflated)
    return Outcome(solution, solution.covariance, problem.dof, noise)


def _wandering(problem: Problem, solution: Solution) -> Outcome:
    """Refine a solution by weights from its residual's scatter, 1/f wander, channel correlation."""
    data = problem.data
    least = np.diagonal(data.row_covariance) / float(np.mean(data.count))
    order = np.argsort(data.t)
    kernel_modes = modes(data.t[order])
    for _ in range(_REWEIGHTINGS):
        design, residual = problem.jacobian(solution.x)[order], problem.residual(solution.x)[order]
        slow = estimate(kernel_modes, residual, design, least)
        z = slow.whiten(residual)
        between = np.corrcoef(z, rowvar=False)
        together = _rows(between, np.ones(len(data)))

        def whiten(rows: np.ndarray, slow: Wander = slow, last: Whitening = together):  # type: ignore[no-untyped-def]
            return last(slow.whiten(rows[order]))

        solution = problem.solve(whiten, solution.x)
    constant = slow.whiten(np.ones((len(data), 6)))
    effective = np.diagonal(data.row_covariance) * (constant**2).sum(axis=0)
    noise = _noise(problem, solution, data.source, effective, inflated=True)
    return Outcome(solution, solution.covariance, problem.dof, noise)


def _exact(found: np.ndarray, data: Observations) -> bool:
    """Whether a residual's variance ``found`` (6,) [N², (N·m)²] is nothing but rounding."""
    size = np.abs(data.wrench).max()
    return bool(found.min() < (1e-12 * size) ** 2)


def _correlation_time(problem: Problem, x: np.ndarray) -> np.ndarray:
    """Integrated autocorrelation time of a motion's residual (6,) [samples]; 1 for poses."""
    return correlation_time(problem.residual(x)) if isinstance(problem.data.q, Jet) else np.ones(6)


def correlation_time(r: np.ndarray) -> np.ndarray:
    """Integrated autocorrelation time (6,) of evenly sampled rows (N, 6) [samples], with Sokal's
    window: Goodman & Weare 2010, doi 10.2140/camcos.2010.5.65, Section 3."""
    r = r - r.mean(axis=0)
    length = next_fast_len(2 * len(r), real=True)
    power = np.abs(np.fft.rfft(r.T, length)) ** 2
    rho = np.fft.irfft(power, length)[:, : len(r)].T
    tau = 2 * np.cumsum(rho / np.maximum(rho[0], 1e-300), axis=0) - 1
    window = np.argmax(np.arange(len(r))[:, None] > 5 * tau, axis=0)
    return np.maximum(np.maximum(1.0, tau[window, np.arange(6)]), _batch_time(r))


def _batch_time(r: np.ndarray) -> np.ndarray:
    """Factor (6,) by which correlation, 1/f noise included, inflates the variance of the mean, from
    the scatter of `_BATCHES` batch means."""
    length = len(r) // _BATCHES
    batches = r[: length * _BATCHES].reshape(_BATCHES, length, 6).mean(axis=1)
    return length * batches.var(axis=0, ddof=1) / np.maximum(r.var(axis=0), 1e-300)


def _noise(
    problem: Problem, solution: Solution, source: str, effective: np.ndarray, inflated: bool = False
) -> FitNoise:
    data = problem.data
    rows = float(np.mean(data.count))
    scatter = np.sqrt(problem.residual_variance(solution.x))
    known = source != "residual"
    alone = np.sqrt(np.diagonal(data.row_covariance)) if known else scatter * np.sqrt(rows)
    return FitNoise(alone, source, alone / np.sqrt(rows), scatter, effective, rows, inflated)
