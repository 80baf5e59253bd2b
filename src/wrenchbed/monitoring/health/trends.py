"""When a quantity changed: a step against the scatter from check to check that a history shows.

Each series is x = a + n(t) + b·[t ≥ t_c] + ε. The nuisance n is the recorded temperature, else a
wave of a year (the season of a temperature that nobody recorded), with coefficients of a Gaussian
prior. The scatter of ε is learnt: an inverse gamma prior from the sensor's data, worth `PRIOR`
checks, and all checks of the history. So b over its standard error has a Student's t distribution
(Gelman et al., Bayesian Data Analysis, 3rd ed., 14.2), with few degrees of freedom in the first
checks. What remains after the fit is judged in the same way by an F of a few effective degrees of
freedom, and the six zeros together by Hotelling's T² with an inverse Wishart prior.

False alarms are budgeted over time: `ALARMS_A_YEAR` is spent in proportion to the time since the
check before, and divided over tests and over the number of checks since the step (Bonferroni).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy import special, stats

from wrenchbed.monitoring.health.quantities import BIASES, QUANTITIES, Basis

ALARMS_A_YEAR = 0.01
"""Probability of a false alarm in a year of checks of a healthy robot."""
PRIOR = 6.0
"""Checks that the expected scatter is worth; estimate."""
SINCE = {1: 0.5, 2: 0.25, 4: 0.125, 8: 0.125}
"""Checks since a step, and the share of the budget that is spent on such steps."""
SHARES = {"quantities": 0.5, "zeros": 0.25, "misfit": 0.25}
"""Shares of the budget of the tests."""
SEASON_K = 5.0
"""Amplitude of a year's wave of a temperature that nobody recorded [K]; estimate."""
_MORE = 2.0
"""Checks that the prior of all zeros' covariance is worth beside: more than 5 in all."""
_EFFECTIVE, _WORTH = 6.0, 24.0
"""Effective degrees of freedom of a check's misfit, and of its prior: its scatter may lie in few
directions; estimates."""
_GROWN = 1.5
"""Expected variance of what the fit leaves, in that of the noise within a check; estimate."""
YEAR_S = 365.25 * 86400.0
MISFIT, ZEROS = "misfit", "sensor.bias"
"""Names of the tests of what remains, and of all zeros together."""


@dataclass(frozen=True)
class Test:
    """One test at one check.

    Attributes:
        name: of the quantity, `MISFIT` or `ZEROS`.
        begin: first check after the step.
        p: probability of as much without a change.
        level: below which it is an alarm.
    """

    name: str
    begin: int
    p: float
    level: float

    @property
    def alarm(self) -> bool:
        """Whether it stands."""
        return self.p < self.level


@dataclass(frozen=True, eq=False)
class Step:
    """A step in a series that begins with check ``begin``: size, its standard error, freedom."""

    begin: int
    size: float
    std: float
    freedom: float

    @property
    def t(self) -> float:
        """Size in standard errors."""
        return self.size / self.std

    @property
    def interval95(self) -> tuple[float, float]:
        """Student's t."""
        half = float(special.stdtrit(self.freedom, 0.975)) * self.std
        return self.size - half, self.size + half


@dataclass(frozen=True, eq=False)
class Trends:
    """The series of a history from its last baseline on.

    Args:
        basis: its values.
    """

    basis: Basis
    _kept: dict[int, "_Lines"] = field(default_factory=dict, repr=False)

    @cached_property
    def starts(self) -> list[int]:
        """First checks of all stretches: history begins anew with each."""
        checks = self.basis.checks
        return [k for k, c in enumerate(checks) if k == 0 or c.baseline]

    @property
    def n(self) -> int:
        """Number of checks."""
        return len(self.basis.checks)

    @property
    def since(self) -> int:
        """First check of the last stretch."""
        return self.starts[-1]

    @cached_property
    def years(self) -> np.ndarray:
        """Times (n,) since the first check [years of 365.25 days]."""
        first = self.basis.checks[0].time
        return np.array([(c.time - first).total_seconds() for c in self.basis.checks]) / YEAR_S

    @cached_property
    def warm(self) -> bool:
        """Whether all checks know their temperature."""
        return bool(np.isfinite([c.temperature for c in self.basis.checks]).all())

    @cached_property
    def nuisance(self) -> np.ndarray:
        """Columns (n, k) of temperature, or of the season, in kelvin."""
        if self.warm:
            degrees = np.array([c.temperature for c in self.basis.checks])
            return np.asarray(degrees - degrees[self.since])[:, None]
        wave = 2.0 * np.pi * self.years
        return SEASON_K * np.stack([np.cos(wave), np.sin(wave)], axis=1)

    @cached_property
    def expected(self) -> np.ndarray:
        """Expected scatter of each quantity (K,)."""
        return self.basis.scatter(self.warm)

    @cached_property
    def stretches(self) -> np.ndarray:
        """One column (n, s) of ones a stretch."""
        which = np.searchsorted(self.starts, np.arange(self.n), side="right") - 1
        return np.eye(len(self.starts))[which]

    def _columns(self, begin: int) -> np.ndarray:
        """Step (none where it begins after the last check), stretches and nuisance (n, …)."""
        step = (np.arange(self.n) >= begin).astype(float)[:, None][:, : self.n - begin]
        return np.column_stack([step, self.stretches, self.nuisance])

    def _flat(self, begin: int) -> int:
        """Columns without a prior: step and stretches."""
        return int(begin < self.n) + len(self.starts)

    def _lines(self, begin: int) -> "_Lines":
        """Regression of all quantities on the columns, with the nuisance's prior; kept."""
        if begin not in self._kept:
            ratio = np.maximum(self.basis.per_kelvin / self.expected, _LEAST_RATIO)
            self._kept[begin] = self._fit(begin, self.basis.changes, ratio)
        return self._kept[begin]

    def _fit(self, begin: int, y: np.ndarray, ratio: np.ndarray) -> "_Lines":
        """Regression of series (n, K).

        Args:
            ratio: expected change of each per kelvin in its expected scatter (K,).
        """
        x, flat = self._columns(begin), self._flat(begin)
        prior = np.zeros((len(ratio), x.shape[1]))
        prior[:, flat:] = 1.0 / ratio[:, None] ** 2
        inverse = np.linalg.inv(x.T @ x + prior[:, None, :] * np.eye(x.shape[1]))
        beta = np.einsum("kij,jk->ik", inverse, x.T @ y)
        left = y - x @ beta
        rest = left.T @ left + (beta * prior.T).T @ beta
        return _Lines(beta, inverse, rest, x[:, flat:] @ beta[flat:])

    def _freedom(self, begin: int) -> float:
        """Degrees of freedom of the scatter of one series."""
        return PRIOR + self.n - self._flat(begin)

    def step(self, begin: int, j: int) -> Step:
        """The step of quantity j that begins with a check after the first of its stretch."""
        lines = self._lines(begin)
        std = self.scatters(begin)[j] * np.sqrt(lines.inverse[j, 0, 0])
        return Step(begin, float(lines.beta[0, j]), float(std), self._freedom(begin))

    def zeros(self, begin: int) -> float:
        """Probability of as large a step of all six zeros together, without one."""
        expected = self.expected[BIASES]
        ratio = np.full(6, float((self.basis.per_kelvin[BIASES] / expected).max()))
        lines = self._fit(begin, self.basis.changes[:, BIASES] / expected, ratio)
        worth = PRIOR + _MORE
        size = lines.beta[0] @ np.linalg.solve(worth * np.eye(6) + lines.rest, lines.beta[0])
        own = worth + self.n - self._flat(begin) - 5.0
        return float(stats.f.sf(size / lines.inverse[0, 0, 0] * own / 6.0, 6.0, own))

    def misfit(self, begin: int) -> float:
        """Probability of as large a change of what the fit leaves, without one."""
        size, scale, freedom = self._left(begin)
        return float(stats.f.sf(size / scale, _EFFECTIVE, freedom))

    def rest(self, begin: int) -> float:
        """Variance of what the fit leaves from check to check, in the noise within a check."""
        return self._left(begin)[1]

    def _left(self, begin: int) -> tuple[float, float, float]:
        """Change of what the fit leaves, its scatter, both in the noise within a check, and the
        freedom of the scatter."""
        left, x = self.basis.left, self._columns(begin)[:, : self._flat(begin)]
        inverse = np.linalg.inv(x.T @ x)
        beta = inverse @ (x.T @ left)
        rest = float(((left - x @ beta) ** 2).sum()) / self.basis.freedom
        freedom = _WORTH + _EFFECTIVE * (self.n - x.shape[1])
        scale = (_WORTH * _GROWN + _EFFECTIVE * rest) / freedom
        size = float((beta[0] ** 2).sum()) / self.basis.freedom / inverse[0, 0]
        return size, scale, freedom

    def budget(self) -> float:
        """Probability of a false alarm that the last check may spend."""
        if self.n < 2:
            return 0.0
        return ALARMS_A_YEAR * float(min(self.years[-1] - self.years[-2], 1.0))

    def tests(self) -> list[Test]:
        """All tests of the last check."""
        found, budget = [], self.budget()
        for m, share in SINCE.items():
            begin = self.n - m
            if begin <= self.since:
                continue
            own = budget * share * SHARES["quantities"] / len(QUANTITIES)
            for j, name in enumerate(QUANTITIES):
                step = self.step(begin, j)
                p = 2.0 * float(special.stdtr(step.freedom, -abs(step.t)))
                found.append(Test(name, begin, p, own))
            found.append(Test(ZEROS, begin, self.zeros(begin), budget * share * SHARES["zeros"]))
            left = self.misfit(begin)
            found.append(Test(MISFIT, begin, left, budget * share * SHARES["misfit"]))
        return found

    def visible(self) -> np.ndarray:
        """Smallest step of each quantity (K,) that the next check would show with 50 %."""
        if self.n - self.since < 2:
            return np.full(len(QUANTITIES), np.inf)
        level = self.budget() * SINCE[1] * SHARES["quantities"] / len(QUANTITIES)
        steps = [self.step(self.n - 1, j) for j in range(len(QUANTITIES))]
        return np.array([-special.stdtrit(s.freedom, level / 2.0) * s.std for s in steps])

    def begins(self) -> np.ndarray:
        """Probability (n,) of each check to be the first after one step of all quantities.

        From the integrated likelihoods of all series, independent of each other, each as a t.
        """
        score = np.full(self.n, -np.inf)
        for begin in range(self.since + 1, self.n):
            score[begin] = self._evidence(begin)
            _, scale, freedom = self._left(begin)
            score[begin] -= 0.5 * freedom * float(np.log(scale))
        weight = np.exp(score - score.max())
        return np.asarray(weight / weight.sum())

    def _evidence(self, begin: int) -> float:
        """Logarithm of all series' likelihood with a step, integrated out, but for a constant."""
        lines = self._lines(begin)
        rest = PRIOR + np.diagonal(lines.rest) / self.expected**2
        volume = np.linalg.slogdet(lines.inverse)[1]
        return float((0.5 * volume - 0.5 * self._freedom(begin) * np.log(rest)).sum())

    def known(self, begin: int) -> np.ndarray:
        """What temperature or season makes of each quantity (n, K), with a step that is fitted."""
        return self._lines(begin).known

    def scatters(self, begin: int) -> np.ndarray:
        """Learnt standard deviation of each quantity (K,) from check to check."""
        rest = np.diagonal(self._lines(begin).rest)
        square = (PRIOR * self.expected**2 + rest) / self._freedom(begin)
        return np.asarray(np.sqrt(square))

    def slopes(self) -> tuple[np.ndarray, np.ndarray]:
        """Even trends since the last baseline (K,) [1/year], and half their 95 % intervals.

        Infinite with less than three checks.
        """
        t = self.years[self.since :] - self.years[self.since]
        wide = np.full(len(QUANTITIES), np.inf)
        if len(t) < 3:
            return np.zeros(len(QUANTITIES)), wide
        y = self.basis.changes[self.since :] - self.known(self.n)[self.since :]
        x = np.column_stack([t, np.ones(len(t))])
        inverse = np.linalg.inv(x.T @ x)
        beta = inverse @ x.T @ y
        rest = ((y - x @ beta) ** 2).sum(axis=0)
        freedom = PRIOR + len(t) - 2
        std = np.sqrt((PRIOR * self.expected**2 + rest) / freedom * inverse[0, 0])
        return beta[0], float(special.stdtrit(freedom, 0.975)) * std


class _Lines(NamedTuple):
    """Regressions: coefficients (p, K), their covariances in units of the scatters' (K, p, p), sums
    of products that are left with the prior's share (K, K), what the nuisance makes (n, K)."""

    beta: np.ndarray
    inverse: np.ndarray
    rest: np.ndarray
    known: np.ndarray


_LEAST_RATIO = 1e-6
"""Least typical share of temperature in a scatter: none."""


def interval(weights: np.ndarray, share: float = 0.95) -> tuple[int, int]:
    """First and last of the likeliest checks that hold a share of a distribution (n,)."""
    order = np.argsort(-weights)
    kept = order[: int(np.searchsorted(np.cumsum(weights[order]), share)) + 1]
    return int(kept.min()), int(kept.max())


def names(tests: Sequence[Test]) -> list[str]:
    """Of the tests that stand, the surest first."""
    standing = sorted((t for t in tests if t.alarm), key=lambda t: t.p / t.level)
    return list(dict.fromkeys(t.name for t in standing))
