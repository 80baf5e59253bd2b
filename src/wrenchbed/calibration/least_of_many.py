"""The least values of many functions of one variable, found in step.

Brent's search by golden sections and parabolas within bounds (Brent 1973, ch. 5; Forsythe, Malcolm
& Moler 1977, fmin): each function is asked at the points at which `scipy.optimize.minimize_scalar`
(bounded) would ask it, to the last bit.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

_GOLDEN = 0.5 * (3.0 - np.sqrt(5.0))
"""Smaller part of the golden section of 1, by definition."""
_ROOT, _TOLERANCE = np.sqrt(2.2e-16), 1e-5
"""Relative and absolute tolerance of the place: those of scipy, estimates."""

Costs = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Values (A,) at x (A,) of the functions whose numbers are given (A,)."""


def least(cost: Costs, count: int, bounds: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Minima of B functions within bounds: their places (B,) and values (B,)."""
    x, value = np.empty(count), np.empty(count)
    who = np.arange(count)
    start = np.full(count, bounds[0] + _GOLDEN * (bounds[1] - bounds[0]))
    search = _Search.begun(bounds, start, cost(start, who))
    while True:
        going = search.going()
        over = ~going
        x[who[over]], value[who[over]] = search.x[over], search.fx[over]
        if not going.any():
            return x, value
        if over.any():
            who, search = who[going], search.of(going)
        there = search.next()
        search.learn(there, cost(there, who))


@dataclass(eq=False)
class _Search:
    """State of B searches: bounds a, b, the three best places and values, the last two steps."""

    a: np.ndarray
    b: np.ndarray
    x: np.ndarray
    second: np.ndarray
    third: np.ndarray
    fx: np.ndarray
    f_second: np.ndarray
    f_third: np.ndarray
    step: np.ndarray
    before: np.ndarray

    @classmethod
    def begun(cls, bounds: tuple[float, float], x: np.ndarray, fx: np.ndarray) -> "_Search":
        a, b = (np.full_like(x, end) for end in bounds)
        zero = np.zeros_like(x)
        return cls(a, b, x, x, x, fx, fx, fx, zero, zero)

    def of(self, some: np.ndarray) -> "_Search":
        """Search restricted to some of the functions."""
        return _Search(*(v[some] for v in vars(self).values()))

    @property
    def middle(self) -> np.ndarray:
        return 0.5 * (self.a + self.b)

    @property
    def tolerance(self) -> np.ndarray:
        return _ROOT * np.abs(self.x) + _TOLERANCE / 3.0

    def going(self) -> np.ndarray:
        """Which functions (B,) have not converged, boolean."""
        left = np.abs(self.x - self.middle)
        return np.asarray(left > 2.0 * self.tolerance - 0.5 * (self.b - self.a))

    def next(self) -> np.ndarray:
        """Next places to evaluate (B,): by a parabola through the best three, or golden section."""
        x, a, b, middle, tolerance = self.x, self.a, self.b, self.middle, self.tolerance
        fit = np.abs(self.before) > tolerance
        r = (x - self.second) * (self.fx - self.f_third)
        q = (x - self.third) * (self.fx - self.f_second)
        p = (x - self.third) * q - (x - self.second) * r
        q = 2.0 * (q - r)
        p = np.where(q > 0.0, -p, p)
        q = np.abs(q)
        fit &= (np.abs(p) < np.abs(0.5 * q * self.before)) & (p > q * (a - x)) & (p < q * (b - x))
        step = np.divide(p, q, out=np.zeros_like(p), where=fit)
        there = x + step
        at_end = (there - a < 2.0 * tolerance) | (b - there < 2.0 * tolerance)
        step = np.where(at_end, tolerance * _sign(middle - x), step)
        larger = np.where(x >= middle, a - x, b - x)
        self.before = np.where(fit, self.step, larger)
        self.step = np.where(fit, step, _GOLDEN * larger)
        return np.asarray(x + _sign(self.step) * np.maximum(np.abs(self.step), tolerance))

    def learn(self, u: np.ndarray, fu: np.ndarray) -> None:
        """Update of the searches with values (B,) at places (B,)."""
        better, right = fu <= self.fx, u >= self.x
        self.a = np.where(better & right, self.x, np.where(~better & ~right, u, self.a))
        self.b = np.where(better & ~right, self.x, np.where(~better & right, u, self.b))
        x, second, third = self.x, self.second, self.third
        is_second = ~better & ((fu <= self.f_second) | (second == x))
        is_third = ~better & ~is_second & ((fu <= self.f_third) | (third == x) | (third == second))
        down = better | is_second
        self.third = np.where(down, second, np.where(is_third, u, third))
        self.f_third = np.where(down, self.f_second, np.where(is_third, fu, self.f_third))
        self.second = np.where(better, x, np.where(is_second, u, second))
        self.f_second = np.where(better, self.fx, np.where(is_second, fu, self.f_second))
        self.x, self.fx = np.where(better, u, x), np.where(better, fu, self.fx)


def _sign(x: np.ndarray) -> np.ndarray:
    """Sign of x, with 1 for zero."""
    return np.asarray(np.sign(x) + (x == 0))
