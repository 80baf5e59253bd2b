"""Weighted fits whose weights come from the data: repeats, stated noise or the residual itself."""

from dataclasses import dataclass

import numpy as np
from scipy import special

from wrenchbed.fit import Noise
from wrenchbed.gauss_newton import Solution, solve
from wrenchbed.jets import Jet
from wrenchbed.model import Model
from wrenchbed.observations import Observations, fallback_covariance

LOSSES = ("linear", "huber", "student")
_HUBER_K = 1.345
"""95 % efficient under normal noise: Holland & Welsch 1977, doi 10.1080/03610927708827533."""
_STUDENT_NU = 4.0
_ROBUST_STEPS = 10
_MAD = 1.4826
"""Standard deviation of a normal variable over its median absolute deviation."""
_REWEIGHTINGS = 3
_TRUST = 0.01
"""Below this p-value of the residual's χ², the noise seen in the repeats does not explain it."""


@dataclass(frozen=True, eq=False)
class Problem:
    """A least-squares fit of the parameters at ``free`` from ``theta`` (P,)."""

    model: Model
    data: Observations
    theta: np.ndarray
    free: tuple[int, ...]
    prior: bool = False
    loss: str = "linear"

    @property
    def scale(self) -> np.ndarray:
        return self.model.parameters.tolerance[list(self.free)]

    @property
    def start(self) -> np.ndarray:
        return self.theta[list(self.free)]

    @property
    def dof(self) -> float:
        """Of the residual per channel; parameters are shared out evenly."""
        k = 0 if self.prior else len(self.free)
        return max(1.0, len(self.data) - k / 6)

    def residual(self, x: np.ndarray) -> np.ndarray:
        """Measured − predicted (M, 6) [N, N·m]."""
        theta = self.theta.copy()
        theta[list(self.free)] = x
        return self.data.wrench - self.model.predict(self.data.q, theta)

    def solve(self, covariance: np.ndarray, count: np.ndarray, start: np.ndarray) -> Solution:
        """Weighted fit; ``covariance`` (6, 6) of one row, ``count`` (M,) rows each."""
        weight = np.ones((len(self.data), 6))
        solution = self._solve(covariance, count, start, weight)
        for _ in range(_ROBUST_STEPS if self.loss != "linear" else 0):
            plain = solution.residual[: weight.size].reshape(-1, 6) / weight
            weight = np.sqrt(_robust_weight(plain, self.loss))
            solution = self._solve(covariance, count, solution.x, weight)
        return solution

    def _solve(
        self, covariance: np.ndarray, count: np.ndarray, start: np.ndarray, weight: np.ndarray
    ) -> Solution:
        whiten = np.linalg.inv(np.linalg.cholesky(covariance)).T
        factor = weight * np.sqrt(count)[:, None]
        prior = self.prior
        nominal, scale = self.model.parameters.nominal[list(self.free)], self.scale

        def residual(x: np.ndarray) -> np.ndarray:
            rows = (self.residual(x) @ whiten * factor).ravel()
            return np.concatenate([rows, (nominal - x) / scale]) if prior else rows

        def jacobian(x: np.ndarray) -> np.ndarray:
            theta = self.theta.copy()
            theta[list(self.free)] = x
            j = self.model.jacobian(self.data.q, theta, self.free)
            rows = (np.einsum("nck,cd->ndk", j, whiten) * factor[..., None]).reshape(-1, len(x))
            return np.concatenate([rows, np.diag(1.0 / scale)]) if prior else rows

        return solve(residual, jacobian, start, scale)


def _robust_weight(residual: np.ndarray, loss: str) -> np.ndarray:
    size = np.abs(residual) / max(1.0, _MAD * float(np.median(np.abs(residual))))
    if loss == "huber":
        return np.minimum(1.0, _HUBER_K / np.maximum(size, 1e-300))
    return (_STUDENT_NU + 1) / (_STUDENT_NU + size**2)


@dataclass(frozen=True, eq=False)
class Outcome:
    """A fit, the covariance (K, K) of its parameters, its degrees of freedom and its noise."""

    solution: Solution
    covariance: np.ndarray
    dof: float
    noise: Noise


def fit(problem: Problem) -> Outcome:
    """Fit with the known noise; if the residual denies it, fit again with the residual's own."""
    data = problem.data
    known = data.source != "residual" and bool(data.row_covariance.any())
    row = data.row_covariance if known else fallback_covariance()
    solution = problem.solve(row, data.count, problem.start)
    rows = float(np.mean(data.count))
    if known:
        chi2 = float((solution.residual[: data.wrench.size] ** 2).sum())
        if special.chdtrc(6 * problem.dof, chi2) > _TRUST:
            noise = _noise(problem, solution, row, data.source, inflated=False)
            return Outcome(solution, solution.covariance, data.dof, noise)
    factor, expected = 1.0, np.diagonal(row) / rows if known else np.zeros(6)
    for _ in range(_REWEIGHTINGS):
        found = _found(problem, solution.x)
        if _exact(found, data):
            whitened = solution.residual[: data.wrench.size]
            factor = float(whitened @ whitened) / (6 * problem.dof)
            break
        pooled = _pooled(found, expected)
        solution = problem.solve(pooled, np.ones(len(data), dtype=int), solution.x)
    source = data.source if known else "residual"
    noise = _noise(problem, solution, row if known else None, source, inflated=known)
    factor *= float(np.mean(_correlation_time(problem, solution.x)))
    return Outcome(solution, solution.covariance * factor, problem.dof, noise)


def _found(problem: Problem, x: np.ndarray) -> np.ndarray:
    """Variance of the observations about the fit (6,) [N², (N·m)²]; robust if the loss is."""
    r = problem.residual(x)
    if problem.loss == "linear":
        return np.asarray((r**2).sum(axis=0) / problem.dof)
    return np.asarray((_MAD * np.median(np.abs(r), axis=0)) ** 2 * len(r) / problem.dof)


def _pooled(found: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """Weights' variance (6, 6): the known noise, and beyond it one level of forces, one of torques.

    What is left is often an effect that the model lacks; to weigh each channel by its own share of
    it would trust chance.
    """
    beyond = np.maximum(found - expected, 0.0)
    return np.diag(expected + np.repeat([beyond[:3].mean(), beyond[3:].mean()], 3))


def _exact(found: np.ndarray, data: Observations) -> bool:
    """Whether nothing but rounding is left."""
    size = np.abs(data.wrench).max()
    return bool(found.min() < (1e-12 * size) ** 2)


def _correlation_time(problem: Problem, x: np.ndarray) -> np.ndarray:
    """Integrated autocorrelation time of a motion's residual (6,) [samples]; 1 for poses.

    Sokal's window: Goodman & Weare 2010, doi 10.2140/camcos.2010.5.65, Section 3.
    """
    if not isinstance(problem.data.q, Jet):
        return np.ones(6)
    r = problem.residual(x)
    r = r - r.mean(axis=0)
    power = np.abs(np.fft.rfft(r, 2 * len(r), axis=0)) ** 2
    rho = np.fft.irfft(power, axis=0)[: len(r)]
    tau = 2 * np.cumsum(rho / np.maximum(rho[0], 1e-300), axis=0) - 1
    window = np.argmax(np.arange(len(r))[:, None] > 5 * tau, axis=0)
    return np.maximum(1.0, tau[window, np.arange(6)])


def _noise(
    problem: Problem, solution: Solution, row: np.ndarray | None, source: str, inflated: bool
) -> Noise:
    data = problem.data
    rows = float(np.mean(data.count))
    found = np.sqrt(_found(problem, solution.x))
    alone = found * np.sqrt(rows) if row is None else np.sqrt(np.diagonal(row))
    expected = alone / np.sqrt(rows)
    worth = np.full(6, rows)
    if inflated:
        worth = rows * np.minimum(1.0, np.square(expected / np.maximum(found, 1e-300)))
    worth = worth / _correlation_time(problem, solution.x)
    return Noise(alone, source, expected, found, worth, rows, inflated)
