"""Uncertainty that grows with misfit: faults ("suspects") are fitted to what noise leaves.

A gain of one channel makes the readings disagree with every rigid load, and yet moves the mass that
fits best. So parameters and suspects are fitted together, each family of suspects with a size of
its own by maximum marginal likelihood (MacKay 1992, doi 10.1162/neco.1992.4.3.415). What they move
each parameter by is added to its uncertainty. A fit that a large fault moves is refused; the fault
that explains most by itself is named.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import special

from wrenchbed.calibration.fit_problem import Outcome, Problem
from wrenchbed.calibration.least_squares import BLIND
from wrenchbed.calibration.suspect_faults import CONSTANT, Suspect, background, suspects
from wrenchbed.calibration.weighting import at_least, correlation_time
from wrenchbed.physics.taylor_jets import Jet

ROWS = 4000
"""Most observations that are looked at, evenly spread: half a minute at 125 Hz."""
SPARE = 20
"""Least number of readings in excess of all parameters for a residual to tell its causes."""
CLEAR = 4.0
"""Standard deviations from which a suspect is clearly present."""
FEWEST = 2.0
"""Least number of determined sizes from which the spread of a family is taken: a tilt of gravity
and a pull have two in common, and the third, which no data show, follows Student's t of them."""
LARGE = 8.0
"""Multiple of an ordinary imperfection that counts as a fault: 8 % of a gain, 1.6° of a tilt."""
MOVED = 5.0
"""Least shift of a parameter by a fault, in its standard uncertainties, that matters."""
MATTERS = 0.1
"""Least shift of a parameter by a fault, in its tolerance, that is worth a refusal."""
ALIKE, ALIKE_PART = 6.0, 0.05
"""Suspects cannot be told apart if twice their log likelihoods differ by less than this, or than
this part of what they explain: a fault of 20 % is linear in its size to about that part."""
NAMED = 3
"""Most suspects that are named as alike."""
FINEST = 1e-6
"""Least noise over the largest reading, as in noiseless simulations: no sensor is finer."""
RANK = 1e-10
"""Least eigenvalue over the largest, of columns of unit length, that counts in a rank."""
_SMALLEST, _LARGEST = 2.0**-6, 2.0**10
"""Limits of the fitted size of a family of suspects, in their ordinary sizes."""
_ROUNDS, _SETTLED = 30, 0.01
"""Most updates of the families' sizes, and change of their logarithm that ends them."""


@dataclass(frozen=True)
class Fault:
    """Large fault that explains a fit's residual: its sentence, and whether it moves the values."""

    sentence: str
    moves: bool


@dataclass(frozen=True, eq=False)
class _Whitened:
    """Columns of parameters and suspected faults, and the residual, in units of noise, of n rows.

    Attributes:
        A: derivatives by the K parameters, per tolerance (n, K).
        S: changes by faults of ordinary size (n, C); a fault has one column or several.
        r: residual (n,).
        worth: number of independent readings among the n.
        fall: noise of a fit without faults over that of this one, by channel (6,); None if the
            noise is known.
    """

    A: np.ndarray
    S: np.ndarray
    r: np.ndarray
    worth: float
    fall: np.ndarray | None


def allowed_for(problem: Problem, outcome: Outcome) -> tuple[Outcome, Fault | None]:
    """Return the fit with uncertainties widened by what suspected faults may move, and the fault
    that is clearly present and large, else None."""
    some = np.unique(np.linspace(0, len(problem.data) - 1, ROWS).astype(int))
    fit = _Rows(problem, outcome, some, list(suspects(problem, outcome.solution.x, some)))
    more = list(background(problem, outcome.solution.x, some))
    columns = fit.wrenches.shape[2] - 1 + sum(s.change.shape[2] for s in more)
    if 6 * len(some) - columns >= SPARE:
        fit = replace(fit, every=fit.every + more)
    seen, every = _whitened(fit), fit.every
    if seen is None or (sizes := _sizes(seen, every)) is None:
        return outcome, None
    q = np.linalg.qr(seen.A)[0]
    residual, alone = seen.r - q @ (q.T @ seen.r), seen.S - q @ (q.T @ seen.S)
    shift, spread = _posterior(seen, sizes)
    names, size, changes = _likeliest(every, seen, alone, residual)
    covariance = np.linalg.pinv(seen.A.T @ seen.A, rcond=1e-12)  # by noise alone
    by_one = np.abs(covariance @ (seen.A.T @ changes)).max(axis=1)
    # one of the likeliest faults may be the only one: its family's size knows too little of it
    grown = at_least(outcome, np.maximum(np.hypot(spread, shift), by_one) * problem.scale)
    clear = max(float(np.linalg.norm(changes[:, 0] - q @ (q.T @ changes[:, 0]))), CLEAR)
    if np.sqrt((size**2).mean()) * (1.0 - CLEAR / clear) < LARGE:  # or noise may make it so large
        return grown, None
    known = np.sqrt(np.maximum(np.diagonal(covariance), 1e-300))
    ratio = np.where(outcome.solution.blind < BLIND, np.abs(shift) / known, 0.0)
    moved = bool(((ratio > MOVED) & (np.abs(shift) > MATTERS)).any())
    k = int(np.argmax(np.where(np.abs(shift) > MATTERS, ratio, 0.0)))
    by = f"{abs(shift[k]) * problem.scale[k]:.2g} {problem.model.parameters[problem.free[k]].unit}"
    name = problem.model.parameters.names[problem.free[k]]
    return grown, Fault(_sentence(names, size, f"{name} moves by {by} with it"), moved)


def _sentence(names: list[str], size: np.ndarray, moves: str) -> str:
    """Sentence on the likeliest faults ``names``. If the first is a zero of the sensor, its values
    are ``size`` (6,) times `CONSTANT`; else the clause ``moves`` says what the fault shifts."""
    if names[0] == "a zero of the sensor":
        values = ", ".join(f"{v:.3g}" for v in size * CONSTANT)
        return (
            f"the sensor has a zero of ({values}) N, N·m that the model lacks, and the values hang "
            "on it. Free sensor.bias too (--free default sensor.bias), or tare the sensor"
        )
    return (
        "the readings are not those of one load: of the faults that were tried, "
        f"{', or '.join(names)} explains most, and {moves}. "
        "Run `wrenchbed diagnose`, repair what it names, and calibrate again"
    )


@dataclass(frozen=True, eq=False)
class _Rows:
    """Linear fit, at observations of indices ``some``, by the parameters of ``problem`` and the
    faults ``every``, about the solution in ``outcome``."""

    problem: Problem
    outcome: Outcome
    some: np.ndarray
    every: list[Suspect]

    @cached_property
    def wrenches(self) -> np.ndarray:
        """Rows (M, 6, K + C + 1) [N, N·m] of M observations: derivatives by K parameters, per
        tolerance, changes by faults (C columns), and residual."""
        problem, x = self.problem, self.outcome.solution.x
        slopes, changes = problem.jacobian(x)[self.some] * problem.scale, self.every
        residual = problem.residual(x)[self.some][..., None]
        return np.concatenate([slopes, *(s.change for s in changes), residual], axis=2)

    @cached_property
    def others(self) -> np.ndarray:
        """Rows (R, K + C + 1) of R residuals of touches and prior, in units of their noise; columns
        as in `wrenches`."""
        problem, x, count = self.problem, self.outcome.solution.x, len(self.problem.free)
        blocks, columns = [], self.wrenches.shape[2] - count - 1
        touches, robot, theta = problem.touches, problem.model.robot, problem.at(x)
        if touches is not None:
            residual = touches.residual(robot, theta)[:, None]
            slopes = touches.jacobian(robot, theta, problem.free) * problem.scale
            none = [np.zeros((len(residual), s.change.shape[2])) for s in self.every]
            tips = [n if s.tips is None else s.tips for s, n in zip(self.every, none, strict=True)]
            blocks.append(np.concatenate([slopes, *tips, residual], axis=1))
        if problem.prior:
            to_centre = ((problem.centre - x) / problem.scale)[:, None]
            none_of = np.zeros((count, columns))
            blocks.append(np.concatenate([np.eye(count), none_of, to_centre], axis=1))
        return np.concatenate([np.empty((0, count + columns + 1)), *blocks])

    @cached_property
    def least(self) -> np.ndarray:
        """Lower bound (6,) [N, N·m] of an observation's noise; inf for a channel that is all 0."""
        largest = np.abs(self.problem.data.wrench).max(axis=0)
        noise = self.outcome.noise  # without a known one that of the residual is no bound
        expected = 0.0 if noise.source == "residual" else noise.expected
        least = np.maximum(expected, FINEST * largest)
        return np.where(least > 0.0, least, np.inf)

    def white(self, noise: np.ndarray) -> np.ndarray:
        """All n rows (n, K + C + 1): those of `wrenches`, divided by the noise (6,) [N, N·m] of a
        reading, then those of `others`; columns are K parameters, C fault columns, residual."""
        wrenches = (self.wrenches / noise[:, None]).reshape(-1, self.wrenches.shape[2])
        return np.concatenate([wrenches, self.others])


def _whitened(fit: _Rows) -> _Whitened | None:
    """Divide a fit's rows by the noise that remains after parameters and suspected faults are
    fitted, of few by that of the repeats, or after one fault; None where even that leaves few."""
    least, before, motion = fit.least, fit.outcome.noise, isinstance(fit.problem.data.q, Jet)
    noise = alone = np.maximum(before.scatter, least)
    count, k = 6 * len(fit.some), len(fit.problem.free)
    for _ in range(2):  # the second time by the noise that suspects leave
        white = fit.white(noise)
        if not np.isfinite(white).all():
            return None
        rest, rank = _rest(white)
        explained = count - rank < SPARE or not before.inflated  # or few: what is known counts
        if before.source != "residual" and explained and not motion:
            white = fit.white(least)
            return _Whitened(white[:, :k], white[:, k:-1], white[:, -1], float(count), None)
        if count - rank < SPARE:  # too few to estimate noise anew: what one suspect leaves counts
            tried = [_rest(white[:, [*range(k), *of, -1]]) for of in _columns(fit.every, k)]
            cost = {count * np.log(r @ r + 1e-300) + n * np.log(count): (r, n) for r, n in tried}
            rest, rank = cost[min(cost)]  # by Schwarz' criterion
            if count - rank < SPARE or motion:
                return None
        rest, spare = rest[:count].reshape(-1, 6), count - rank
        time = correlation_time(rest) if motion else np.ones(6)
        unit = np.where(np.isinf(noise), 0.0, noise)
        scale = np.sqrt((rest**2).mean(axis=0) * rest.size / spare * time) * unit
        noise = np.where(np.isinf(least), np.inf, np.maximum(scale, least))
        worth = float((len(rest) / time).sum())
    white = fit.white(noise)
    fall = np.where(np.isinf(least), 1.0, alone * np.sqrt(time) / noise)
    return _Whitened(white[:, :k], white[:, k:-1], white[:, -1], worth, fall)


def _columns(every: list[Suspect], first: int = 0) -> list[range]:
    """Columns of each fault in a matrix in which those of all faults begin at ``first``."""
    ends = first + np.cumsum([len(s.families) for s in every])
    return [range(end - len(s.families), end) for s, end in zip(every, ends, strict=True)]


def _rest(white: np.ndarray) -> tuple[np.ndarray, int]:
    """Fit the last column of white (n, …) by the others; return its residual (n,), their rank."""
    length = np.linalg.norm(white[:, :-1], axis=0)
    columns = white[:, :-1] / np.where(length > 0.0, length, 1.0)
    values, basis = np.linalg.eigh(columns.T @ columns)
    basis = basis[:, values > RANK * values[-1]]
    along = basis.T @ (columns.T @ white[:, -1]) / values[values > RANK * values[-1]]
    return white[:, -1] - columns @ (basis @ along), len(along)


def _sizes(seen: _Whitened, every: list[Suspect]) -> np.ndarray | None:
    """Standard deviation (C,) of the size of each column, common to faults of a kind, at maximum
    marginal likelihood (MacKay's updates); None if noise alone is more probable and no fault is
    clearly present."""
    k = seen.A.shape[1]
    R = np.asarray(np.linalg.qr(np.column_stack([seen.A, seen.S, seen.r]), mode="r"))[:, k:]
    least, R = 1e-6 * np.linalg.norm(R[:, :-1], axis=0) + 1e-300, R[k:]
    square, right = R[:, :-1].T @ R[:, :-1], R[:, :-1].T @ R[:, -1]
    _, family = np.unique([f for s in every for f in s.families], return_inverse=True)
    size = np.ones(len(family))
    for _ in range(_ROUNDS):
        covariance = np.linalg.inv(square * np.outer(size, size) + np.eye(len(size)))
        mean = covariance @ (right * size)  # in units of the sizes
        determined = np.bincount(family, 1.0 - np.diagonal(covariance))
        grown = np.sqrt(np.bincount(family, mean**2) / np.maximum(determined, 1e-9))
        last, size = size, np.clip(size * grown[family], _SMALLEST, _LARGEST)
        if np.abs(np.log(size / last)).max() < _SETTLED:
            break
    scaled, r = R[:, :-1] * size, R[:, -1]
    marginal, dof = np.eye(len(R)) + scaled @ scaled.T, max(1.0, seen.worth - k)
    known = float(r @ r) if seen.fall is None else dof * (1.0 + np.log(seen.fall**2).mean())
    left = float(r @ np.linalg.solve(marginal, r)) + np.linalg.slogdet(marginal)[1]
    # a size that is fitted costs its prior range over the width that one number leaves
    cost = np.log(np.log(_LARGEST / _SMALLEST) / np.sqrt(4.0 * np.pi))
    clear = np.abs(right) > CLEAR * np.maximum(np.sqrt(np.diagonal(square)), least)
    evidence = 0.5 * (known - left) - cost * np.minimum(determined, 1.0).sum()
    if evidence <= 0.0 and not clear.any():
        return None
    return np.asarray(np.where(determined >= 1.0, student(determined), 1.0)[family] * size)


def student(count: np.ndarray) -> np.ndarray:
    """95 % interval over the normal one where ``count`` numbers (…), 2 or more, tell a spread."""
    return np.asarray(special.stdtrit(np.maximum(count, FEWEST), 0.975) / special.ndtri(0.975))


def _posterior(seen: _Whitened, size: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Shift (K,) and standard deviation (K,) of the parameters, in tolerances, when suspected
    faults of standard deviations ``size`` (C,) are fitted, too."""
    both = np.column_stack([seen.A, seen.S])
    k = seen.A.shape[1]
    precision = np.concatenate([np.full(k, 1e-12), 1.0 / size**2])
    covariance = np.linalg.inv(both.T @ both + np.diag(precision))
    spread = np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
    return (covariance @ (both.T @ seen.r))[:k], spread[:k]


def _likeliest(
    every: list[Suspect], seen: _Whitened, alone: np.ndarray, residual: np.ndarray
) -> tuple[list[str], np.ndarray, np.ndarray]:
    """Names of the faults that best explain the residual, each alone; sizes (k,) of the first one's
    k columns; and changes (n, L) by the L faults that explain it nearly as well.

    k columns cost k log n (Schwarz 1978, doi 10.1214/aos/1176344136); of faults that explain it
    alike, those with fewest are named. ``alone`` (n, C): changes beyond the parameters'.
    """
    scores = list[tuple[float, np.ndarray, np.ndarray]]()
    for of in _columns(every):
        u, s, vt = np.linalg.svd(alone[:, of], full_matrices=False)
        keep = s > 1e-6 * np.linalg.norm(seen.S[:, of])
        along = u[:, keep].T @ residual
        sizes = vt[keep].T @ (along / s[keep])
        score = float(along @ along) - keep.sum() * np.log(seen.worth)
        hidden = vt[~keep].T * student(keep.sum()) * np.sqrt((sizes**2).sum() / max(1, keep.sum()))
        scores.append((score, sizes, seen.S[:, of] @ np.column_stack([sizes, hidden])))
    best = max(score for score, *_ in scores)
    least = best - max(ALIKE, ALIKE_PART * best)
    alike = [k for k in range(len(every)) if scores[k][0] >= least]
    alike.sort(key=lambda k: (len(scores[k][1]), -scores[k][0]))
    few = [k for k in alike if len(scores[k][1]) == len(scores[alike[0]][1])]
    changes = np.column_stack([scores[k][2] for k in alike])
    return [every[k].name for k in few[:NAMED]], scores[few[0]][1], changes
