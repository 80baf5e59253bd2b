"""Fits of many robots of one kind at the same poses, made together: each to the last bit as alone.

It is `least_squares.solve` and `weighting.fit` with a leading axis of robots, for what a campaign
needs: poses at rest, noise known from repeats or stated, no prior, no robust loss, no touches. A
robot that is anything else is left to `calibrate`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from scipy import special

from wrenchbed.calibration.fit_problem import Outcome, Problem
from wrenchbed.calibration.least_squares import (
    COST_DONE,
    HALVINGS,
    MAX_STEPS,
    SAME,
    STEP_DONE,
    Solution,
    triangular_of,
)
from wrenchbed.calibration.observability import RANK_TOLERANCE
from wrenchbed.calibration.weighting import (
    ENOUGH,
    MOST_POSES,
    REWEIGHTINGS,
    TRUST,
    Wander,
    at_least,
    levels,
    modes,
    settled,
    wandered,
)


class _Together:
    """Problems of R robots that share model, poses, times, counts and free parameters."""

    def __init__(self, problems: Sequence[Problem]) -> None:
        first = problems[0]
        self.model, self.free, self.data = first.model, first.free, first.data
        self.q = np.asarray(first.data.q)
        self.scale = first.scale
        self.thetas = np.stack([p.theta for p in problems])
        self.wrench = np.stack([p.data.wrench for p in problems])
        self.covariance = np.stack([p.data.row_covariance for p in problems])

    @property
    def start(self) -> np.ndarray:
        """Start values of the fits (R, K)."""
        return self.thetas[:, list(self.free)]

    def at(self, x: np.ndarray, who: np.ndarray) -> np.ndarray:
        """All parameters (A, P) of robots (A,) with the free ones at x (A, K)."""
        thetas = self.thetas[who]
        thetas[:, list(self.free)] = x
        return thetas

    def residual(self, x: np.ndarray, who: np.ndarray) -> np.ndarray:
        """Measured − predicted wrenches (A, N, 6) [N, N·m] of robots ``who`` (A,)."""
        return self.wrench[who] - self.model.predict(self.q, self.at(x, who)[:, None])


@dataclass(frozen=True, eq=False)
class _Solutions:
    """`least_squares.Solution` of R robots; ``whole`` where the data fix all parameters (R,)."""

    x: np.ndarray
    residual: np.ndarray
    covariance: np.ndarray
    blind: np.ndarray
    steps: np.ndarray
    converged: np.ndarray
    whole: np.ndarray

    def of(self, k: int) -> Solution:
        """Solution of robot k."""
        return Solution(
            self.x[k], self.residual[k], None, self.covariance[k], self.blind[k],
            self.x.shape[1], int(self.steps[k]), bool(self.converged[k]),
        )  # fmt: skip


class _Slopes:
    """Derivatives of each robot's prediction by channels (6, N, K), kept where x hardly moved."""

    def __init__(self, fits: _Together) -> None:
        self._fits = fits
        many, columns = fits.start.shape
        self._at = np.full((many, columns), np.inf)
        self._kept = np.empty((many, 6, len(fits.q), columns))
        self._turned, self._basis = self._kept, np.eye(0)

    def turn(self, basis: np.ndarray) -> None:
        """Give them in a basis (N, N) of the poses from now on."""
        self._turned, self._basis = basis.T @ self._kept, basis

    def remembered(self, problem: Problem, k: int) -> Problem:
        """The problem of robot k, which knows the last derivatives that were made for it."""
        return problem.knowing(self._at[k], np.swapaxes(self._kept[k], 0, 1))

    def __call__(self, x: np.ndarray, who: np.ndarray) -> np.ndarray:
        """Derivatives (A, 6, N, K) of the prediction at x (A, K) of the robots (A,)."""
        off = np.abs((self._at[who] - x) / self._fits.scale).max(axis=1)
        new = off > SAME
        if new.any():
            some = who[new]
            self._at[some] = x[new]
            made = self._fits.model.jacobian(
                self._fits.q, self._fits.at(x[new], some)[:, None], self._fits.free
            )
            self._kept[some] = np.swapaxes(made, 1, 2)
            if len(self._basis):
                self._turned[some] = self._basis.T @ self._kept[some]
        return self._turned[who]


class _Whitening(Protocol):
    """Gives rows of the robots (A,) unit variance and leaves none correlated."""

    def rows(self, rows: np.ndarray, who: np.ndarray) -> np.ndarray:
        """Whitened rows from rows (A, N, 6)."""

    def slopes(self, slopes: np.ndarray, who: np.ndarray) -> np.ndarray:
        """Whitened derivatives from derivatives by channels (A, 6, N, K)."""


class _Steady(_Whitening):
    """Means over ``count`` (N,) rows of covariances (R, 6, 6)."""

    def __init__(self, covariance: np.ndarray, count: np.ndarray) -> None:
        self._turn, self._factor = _turn(covariance), np.sqrt(count)[:, None]

    def rows(self, rows: np.ndarray, who: np.ndarray) -> np.ndarray:
        return np.asarray((rows @ self._turn[who]) * self._factor)

    def slopes(self, slopes: np.ndarray, who: np.ndarray) -> np.ndarray:
        return _mixed(slopes, self._turn[who]) * self._factor


class _Wandering(_Whitening):
    """Means that wander by levels (R, 1, 6), and whose channels then correlate."""

    def __init__(self, slow: Wander, left: np.ndarray) -> None:
        self._basis = slow.basis
        self._root = np.sqrt(slow.independent + slow.level * slow.spread[:, None])
        calm = self._calm(left, np.arange(len(left)))
        self._turn = _turn(np.stack([np.corrcoef(rows, rowvar=False) for rows in calm]))

    def _calm(self, rows: np.ndarray, who: np.ndarray) -> np.ndarray:
        return np.asarray((self._basis.T @ rows) / self._root[who])

    def rows(self, rows: np.ndarray, who: np.ndarray) -> np.ndarray:
        return np.asarray(self._calm(rows, who) @ self._turn[who])

    def slopes(self, slopes: np.ndarray, who: np.ndarray) -> np.ndarray:
        return _mixed(slopes / np.swapaxes(self._root[who], 1, 2)[..., None], self._turn[who])


def _turn(covariance: np.ndarray) -> np.ndarray:
    """Matrices (R, 6, 6) that decorrelate six channels of these covariances, from the right."""
    return np.swapaxes(np.linalg.inv(np.linalg.cholesky(covariance)), 1, 2)


def _mixed(slopes: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Channels of slopes (A, 6, N, K) mixed by (A, 6, 6)."""
    mixed = np.swapaxes(turn, 1, 2) @ slopes.reshape(len(slopes), 6, -1)
    return np.asarray(mixed.reshape(slopes.shape))


def fit_each(problems: Sequence[Problem]) -> list[Outcome | None]:
    """`weighting.fit` of each problem; None of one that it has to fit alone.

    Args:
        problems: of one model and the same poses, which differ in what was read.
    """
    fits, first = _Together(problems), problems[0]
    slopes = _Slopes(fits)
    solutions = _solve(fits, slopes, _Steady(fits.covariance, fits.data.count), fits.start)
    explained = special.chdtrc(6 * first.dof, (solutions.residual**2).sum(axis=1)) > TRUST
    outcomes: list[Outcome | None] = [None] * len(problems)
    for k in np.flatnonzero(solutions.whole & explained).tolist():
        outcomes[k] = settled(slopes.remembered(problems[k], k), solutions.of(k))
    wandering = np.flatnonzero(solutions.whole & ~explained)
    if len(fits.q) - len(fits.free) < ENOUGH or len(fits.q) > MOST_POSES or not len(wandering):
        return outcomes
    slow, last = _wandering(fits, slopes, solutions, wandering)
    for a in np.flatnonzero(last.whole).tolist():
        k = int(wandering[a])
        problem = slopes.remembered(problems[k], k)
        own = replace(slow, independent=slow.independent[a, 0], level=slow.level[a, 0])
        outcome = wandered(problem, last.of(a), own)
        outcomes[k] = at_least(outcome, solutions.covariance[k])
    return outcomes


def _solve(fits: _Together, slopes: _Slopes, whiten: _Whitening, start: np.ndarray,
           who: np.ndarray | None = None) -> _Solutions:  # fmt: skip
    """`least_squares.solve` of the robots (A,), from start (A, K)."""
    who = np.arange(len(start)) if who is None else who
    many, columns = start.shape
    scale, x = fits.scale, start.copy()

    def white(x: np.ndarray, some: np.ndarray) -> np.ndarray:
        return whiten.rows(fits.residual(x, who[some]), some).reshape(len(some), -1)

    def factors(some: np.ndarray) -> tuple[np.ndarray, ...]:
        both = np.empty((len(some), len(fits.q), 6, columns + 1))
        both[..., :-1] = np.swapaxes(whiten.slopes(slopes(x[some], who[some]), some), 1, 2)
        both[..., -1] = r[some].reshape(both.shape[:-1])
        triangle, turned = triangular_of(both.reshape(len(some), -1, columns + 1))
        return (turned, *np.linalg.svd(triangle * scale, full_matrices=False))

    r = white(x, np.arange(many))
    s, vt = np.ones((many, columns)), np.empty((many, columns, columns))
    steps = np.zeros(many, int)
    converged, fresh = np.zeros(many, bool), np.zeros(many, bool)
    going = np.arange(many)
    while len(going):
        steps[going] += 1
        turned, u, s[going], vt[going] = factors(going)
        by_rows = np.ascontiguousarray(np.swapaxes(u, 1, 2))
        along = (by_rows @ turned[..., None])[..., 0] / s[going]
        step = (np.swapaxes(vt[going], 1, 2) @ along[..., None])[..., 0]
        moved, gained = _halve(white, x, r, step * scale, going)
        size = np.abs(step).max(axis=1)
        converged[going] = ~moved | (size < STEP_DONE) | (gained < COST_DONE)
        fresh[going] = ~moved | (size < SAME)
        going = going[~converged[going] & _whole(s[going]) & (steps[going] < MAX_STEPS)]
    stale = np.flatnonzero(~fresh & _whole(s))
    if len(stale):
        _, _, s[stale], vt[stale] = factors(stale)
    seen = np.swapaxes(vt, 1, 2)
    covariance = (seen / (s**2)[:, None]) @ vt * np.outer(scale, scale)
    blind = np.sqrt(np.clip(1.0 - (seen**2).sum(axis=2), 0.0, 1.0))
    return _Solutions(x, r, covariance, blind, steps, converged, _whole(s))


def _whole(s: np.ndarray) -> np.ndarray:
    """Whether singular values (R, K) fix all parameters (R,), boolean."""
    return np.asarray(np.isfinite(s[:, 0]) & (s[:, -1] > RANK_TOLERANCE * s[:, 0]))


def _halve(
    white: Callable[[np.ndarray, np.ndarray], np.ndarray],
    x: np.ndarray,
    r: np.ndarray,
    step: np.ndarray,
    who: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """`least_squares.halve` of the robots (A,); x and r become what they reach."""
    cost = _squares(r[who])
    moved, gained = np.zeros(len(who), bool), np.zeros(len(who))
    with np.errstate(all="ignore"):
        for _ in range(HALVINGS):
            left = np.flatnonzero(~moved)
            if not len(left):
                break
            some = who[left]
            trial = white(x[some] + step[left], some)
            new = _squares(trial)
            good = np.isfinite(new) & (new <= cost[left])
            here = left[good]
            x[who[here]] += step[here]
            r[who[here]] = trial[good]
            moved[here] = True
            gained[here] = (cost[here] - new[good]) / np.maximum(cost[here], 1e-300)
            step = step / 2
    return moved, gained


def _squares(r: np.ndarray) -> np.ndarray:
    """Sums of squares |r|² (A,) of rows (A, M)."""
    return np.asarray((r[:, None] @ r[..., None])[:, 0, 0])


def _wandering(
    fits: _Together, slopes: _Slopes, solutions: _Solutions, who: np.ndarray
) -> tuple[Wander, _Solutions]:
    """The last levels (A, 1, 6) of the robots (A,), and their fits with weights by these."""
    order = np.argsort(fits.data.t)
    spread, basis = modes(fits.data.t[order])
    basis = basis[np.argsort(order)]  # rows as the poses come
    slopes.turn(basis)
    covariance = np.diagonal(fits.covariance[who], axis1=1, axis2=2)
    least = (covariance / float(np.mean(fits.data.count))).ravel()
    x, last = solutions.x[who], solutions
    for _ in range(REWEIGHTINGS):
        residual = fits.residual(x, who)
        channels = slopes(x, who)
        by_channel = (basis.T @ np.swapaxes(residual, 1, 2)[..., None])[..., 0]
        independent, level = levels(
            channels.reshape(-1, *channels.shape[2:]), by_channel.reshape(-1, len(order)),
            spread, least,
        )  # fmt: skip
        slow = Wander(independent.reshape(-1, 1, 6), level.reshape(-1, 1, 6), basis, spread)
        last = _solve(fits, slopes, _Wandering(slow, residual), x, who)
        x = last.x
    return slow, last
