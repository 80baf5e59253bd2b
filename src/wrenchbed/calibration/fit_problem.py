"""A least-squares problem: model, observations, free parameters, any whitening and loss."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from wrenchbed.calibration.fit import FitNoise
from wrenchbed.calibration.least_squares import SAME, Solution, solve
from wrenchbed.calibration.observations import Observations
from wrenchbed.calibration.touch_points import Touches
from wrenchbed.simulation.closed_form import Model

LOSSES = ("linear", "huber")
_HUBER_K = 1.345
"""95 % efficient under normal noise: Holland & Welsch 1977, doi 10.1080/03610927708827533."""
_ROBUST_STEPS = 10
_MAD = 1.4826
"""Standard deviation of a normal variable over its median absolute deviation."""

Whitening = Callable[[np.ndarray], np.ndarray]
"""Rows (M, 6) or (M, 6, K) → the same shape, uncorrelated and of unit variance."""


@dataclass(frozen=True, eq=False)
class Problem:
    """Least-squares fit of the parameters at indices ``free``, starting from ``theta`` (P,).

    With a prior, each free parameter has the mean ``centre`` (K,) and its tolerance as standard
    deviation. ``touches``, contacts of the tool's tip with known points, add position residuals.
    """

    model: Model
    data: Observations
    theta: np.ndarray
    free: tuple[int, ...]
    centre: np.ndarray
    prior: bool = False
    loss: str = "linear"
    touches: Touches | None = None
    _last: dict[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict, repr=False)

    def _once(
        self, what: str, x: np.ndarray, make: Callable[[np.ndarray], np.ndarray], near: float = 0.0
    ) -> np.ndarray:
        """Return ``make(x)``; for an x within ``near`` tolerances of the last one, the result kept
        under the name ``what``."""
        known = self._last.get(what)
        if known is None or np.abs((known[0] - x) / self.scale).max(initial=0.0) > near:
            known = self._last[what] = (x.copy(), make(x))
        return known[1]

    @property
    def scale(self) -> np.ndarray:
        """Tolerance of each free parameter (K,), in its unit."""
        return self.model.parameters.tolerance[list(self.free)]

    @property
    def start(self) -> np.ndarray:
        """Start value of each free parameter (K,), in its unit."""
        return self.theta[list(self.free)]

    @property
    def dof(self) -> float:
        """Degrees of freedom of the residual per channel: rows less a sixth of the parameters."""
        k = 0 if self.prior else len(self.free)
        return max(1.0, len(self.data) - k / 6)

    def at(self, x: np.ndarray) -> np.ndarray:
        """Full parameter vector (P,) with the free parameters set to x (K,)."""
        theta = self.theta.copy()
        theta[list(self.free)] = x
        return theta

    def residual(self, x: np.ndarray) -> np.ndarray:
        """Measured − predicted wrench (M, 6) [N, N·m] at x (K,)."""
        return self._once(
            "residual", x, lambda y: self.data.wrench - self.model.predict(self.data.q, self.at(y))
        )

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        """Derivative (M, 6, K) of the predicted wrench by the free parameters at x (K,)."""
        return self._once(
            "jacobian", x, lambda y: self.model.jacobian(self.data.q, self.at(y), self.free), SAME
        )

    def residual_variance(self, x: np.ndarray) -> np.ndarray:
        """Variance of the residual (6,) [N², (N·m)²] at x (K,); robust if the loss is."""
        r = self.residual(x)
        if self.loss == "linear":
            return np.asarray((r**2).sum(axis=0) / self.dof)
        return np.asarray((_MAD * np.median(np.abs(r), axis=0)) ** 2 * len(r) / self.dof)

    def solve(self, whiten: Whitening, start: np.ndarray) -> Solution:
        """Solve the weighted fit from ``start`` (K,); a robust loss reweights against outliers."""
        weight = np.ones((len(self.data), 6))
        solution = self._solve(whiten, start, weight)
        for _ in range(_ROBUST_STEPS if self.loss != "linear" else 0):
            plain = solution.residual[: weight.size].reshape(-1, 6) / weight
            weight = np.sqrt(_robust_weight(plain))
            solution = self._solve(whiten, solution.x, weight)
        return solution

    def _solve(self, whiten: Whitening, start: np.ndarray, weight: np.ndarray) -> Solution:
        scale, robot = self.scale, self.model.robot

        def residual(x: np.ndarray) -> np.ndarray:
            rows = [(whiten(self.residual(x)) * weight).ravel()]
            if self.touches is not None:
                rows.append(self.touches.residual(robot, self.at(x)))
            if self.prior:
                rows.append((self.centre - x) / scale)
            return np.concatenate(rows)

        def jacobian(x: np.ndarray) -> np.ndarray:
            white = whiten(self.jacobian(x))
            if self.loss != "linear":
                white = white * weight[..., None]
            rows = [white.reshape(-1, len(x))]
            if self.touches is not None:
                rows.append(self.touches.jacobian(robot, self.at(x), self.free))
            if self.prior:
                rows.append(np.diag(1.0 / scale))
            return np.concatenate(rows) if len(rows) > 1 else white.reshape(-1, len(x))

        return solve(residual, jacobian, start, scale)


@dataclass(frozen=True, eq=False)
class Outcome:
    """Result of a fit: solution, covariance (K, K) of its parameters, degrees of freedom, noise."""

    solution: Solution
    covariance: np.ndarray
    dof: float
    noise: FitNoise


def _robust_weight(residual: np.ndarray) -> np.ndarray:
    size = np.abs(residual) / max(1.0, _MAD * float(np.median(np.abs(residual))))
    return np.minimum(1.0, _HUBER_K / np.maximum(size, 1e-300))
