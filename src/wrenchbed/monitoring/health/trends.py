"""When a quantity changed: a step against the scatter from check to check that a history shows.

Each series is x = a + n(t) + w(t) + b·[t ≥ t_c] + ε. The nuisance n is the recorded temperature,
else a wave of a year (the season of a temperature that nobody recorded), with coefficients of a
Gaussian prior. w is a random walk of unknown speed (`WALKS`), for zeros drift for months; p values
are means over its posterior. The scatter of ε is learnt: an inverse gamma prior from the sensor's
data, worth `PRIOR` checks, and all checks of the history. So b over its standard error has a
Student's t distribution (Gelman et al., Bayesian Data Analysis, 3rd ed., 14.2), with few degrees of
freedom in the first checks. What remains after the fit is judged in the same way by an F of a few
effective degrees of freedom, and the six zeros together by Hotelling's T² with an inverse Wishart
prior.

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
WALKS = (0.0, 0.03, 0.3, 3.0)
"""Variance that a slow walk of a quantity gains in a month, in that of the scatter from check to
check; estimates."""
_WALK_PRIOR = np.array([0.5, 0.2, 0.2, 0.1])
"""Their probabilities before any check; estimates."""
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
    """A step in a series that begins with check ``begin``: size, its standard error, freedom, and
    the probability of as large a step without a change."""

    begin: int
    size: float
    std: float
    freedom: float
    p: float

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

    @cached_property
    def _roots(self) -> np.ndarray:
        """Inverse roots (R, n, n) of the covariance of white scatter and a walk, for `WALKS`."""
        months = 12.0 * (self.years[:, None] - self.years[self.starts][None, :]).clip(0.0)
        walked = (months * self.stretches).sum(axis=1)
        same = self.stretches @ self.stretches.T
        kernel = same * np.minimum(walked[:, None], walked[None, :])
        return np.stack([np.linalg.inv(np.linalg.cholesky(np.eye(self.n) + r * kernel))
                         for r in WALKS])  # fmt: skip

    def _lines(self, begin: int) -> "_Lines":
        """Regression of all quantities on the columns, with the nuisance's prior; kept."""
        if begin not in self._kept:
            ratio = np.maximum(self.basis.per_kelvin / self.expected, _LEAST_RATIO)
            self._kept[begin] = self._fit(begin, self.basis.changes / self.expected, ratio)
        return self._kept[begin]

    def _fit(self, begin: int, y: np.ndarray, ratio: np.ndarray) -> "_Lines":
        """Regression of series (n, K) in their expected scatters, for all of `WALKS`.

        Args:
            ratio: expected change of each per kelvin in its expected scatter (K,).
        """
        plain, flat = self._columns(begin), self._flat(begin)
        prior = np.zeros((len(ratio), plain.shape[1]))
        prior[:, flat:] = 1.0 / ratio[:, None] ** 2
        x, turned = self._roots @ plain, self._roots @ y
        across = np.swapaxes(x, -1, -2)
        square = (across @ x)[:, None] + prior[:, None, :] * np.eye(plain.shape[1])
        inverse = np.linalg.inv(square)
        beta = np.einsum("rkij,rjk->rik", inverse, across @ turned)
        left = turned - x @ beta
        rest = np.swapaxes(left, -1, -2) @ left + np.swapaxes(beta * prior.T, -1, -2) @ beta
        volume = np.linalg.slogdet(self._roots)[1][:, None] + 0.5 * np.linalg.slogdet(inverse)[1]
        return _Lines(beta, inverse, rest, plain[:, flat:] @ beta[:, flat:], volume)

    def _freedom(self, begin: int) -> float:
        """Degrees of freedom of the scatter of one series."""
        return PRIOR + self.n - self._flat(begin)

    def _weights(self, begin: int) -> np.ndarray:
        """Logarithms of the joint probability of each walk and each series (R, K)."""
        lines = self._lines(begin)
        rest = PRIOR + np.diagonal(lines.rest, axis1=1, axis2=2)
        likelihood = lines.volume - 0.5 * self._freedom(begin) * np.log(rest)
        return np.asarray(np.log(_WALK_PRIOR)[:, None] + likelihood)

    def _shares(self, begin: int) -> np.ndarray:
        """Probability of each walk (R, K)."""
        logs = self._weights(begin)
        return np.asarray(np.exp(logs - np.logaddexp.reduce(logs, axis=0)))

    def step(self, begin: int, j: int) -> Step:
        """The step of quantity j that begins with a check after the first of its stretch."""
        lines, share, freedom = self._lines(begin), self._shares(begin)[:, j], self._freedom(begin)
        sizes = lines.beta[:, 0, j]
        variance = (PRIOR + lines.rest[:, j, j]) / freedom * lines.inverse[:, j, 0, 0]
        p = float(share @ (2.0 * special.stdtr(freedom, -np.abs(sizes) / np.sqrt(variance))))
        size = float(share @ sizes)
        std = float(np.sqrt(share @ (variance + (sizes - size) ** 2)))
        unit = float(self.expected[j])
        return Step(begin, unit * size, unit * std, freedom, p)

    def zeros(self, begin: int) -> float:
        """Probability of as large a step of all six zeros together, without one."""
        expected = self.expected[BIASES]
        ratio = np.full(6, float((self.basis.per_kelvin[BIASES] / expected).max()))
        lines = self._fit(begin, self.basis.changes[:, BIASES] / expected, ratio)
        worth = PRIOR + _MORE
        square = worth * np.eye(6) + lines.rest
        freedom = worth + self.n - self._flat(begin)
        logs = np.log(_WALK_PRIOR) + lines.volume.sum(axis=1)
        logs -= 0.5 * freedom * np.linalg.slogdet(square)[1]
        share = np.exp(logs - np.logaddexp.reduce(logs))
        steps = lines.beta[:, 0]
        size = np.einsum("rk,rk->r", steps, np.linalg.solve(square, steps[..., None])[..., 0])
        ratio_f = size / lines.inverse[:, 0, 0, 0] * (freedom - 5.0) / 6.0
        return float(share @ stats.f.sf(ratio_f, 6.0, freedom - 5.0))

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
                found.append(Test(name, begin, step.p, own))
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
            score[begin] = np.logaddexp.reduce(self._weights(begin), axis=0).sum()
            _, scale, freedom = self._left(begin)
            score[begin] -= 0.5 * freedom * float(np.log(scale))
        weight = np.exp(score - score.max())
        return np.asarray(weight / weight.sum())

    def known(self, begin: int) -> np.ndarray:
        """What temperature or season makes of each quantity (n, K), with a step that is fitted."""
        found = self._lines(begin).known
        return np.asarray(np.einsum("rk,rnk->nk", self._shares(begin), found) * self.expected)

    def scatters(self, begin: int) -> np.ndarray:
        """Learnt standard deviation of each quantity (K,) from one check to the next."""
        rest = np.diagonal(self._lines(begin).rest, axis1=1, axis2=2)
        square = (PRIOR + rest) / self._freedom(begin) * (1.0 + np.array(WALKS))[:, None]
        return np.asarray(np.sqrt((self._shares(begin) * square).sum(axis=0)) * self.expected)

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
    """Regressions in units of expected scatters, for each of `WALKS`: coefficients (R, p, K), their
    covariances in units of the scatters' (R, K, p, p), sums of products that are left with the
    prior's share (R, K, K), what the nuisance makes (R, n, K), log volumes (R, K)."""

    beta: np.ndarray
    inverse: np.ndarray
    rest: np.ndarray
    known: np.ndarray
    volume: np.ndarray


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
