"""Uncertainty that grows with misfit: what noise does not explain is explained by suspects.

A gain of one channel makes the readings disagree with every rigid load, and yet moves the mass that
fits best. So parameters and suspects are fitted together, each family of suspects with a size of
its own, found by maximum marginal likelihood (MacKay 1992, doi 10.1162/neco.1992.4.3.415). What
they do to each parameter is added to its uncertainty; a fit that a large fault moves is refused by
the name of the fault that explains most by itself.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from wrenchbed.calibration.fit_problem import Outcome, Problem
from wrenchbed.calibration.least_squares import BLIND
from wrenchbed.calibration.suspects import CONSTANT, Suspect, background, suspects
from wrenchbed.calibration.weighting import correlation_time
from wrenchbed.physics.time_derivatives import Jet

ROWS = 4000
"""Most observations that are looked at, evenly spread: half a minute at 125 Hz."""
SPARE = 20
"""Readings beyond all parameters from which a residual tells its causes."""
SURE, CLEAR = 1e-3, 5.0
"""P-value of all suspects together, and standard deviations of one of them, from which they
explain a part of the residual."""
LARGE = 8.0
"""Sizes of an ordinary imperfection from which it is a fault: 8 % of a gain, 1.6° of a tilt."""
MOVED = 5.0
"""Standard uncertainties by which a fault moves a parameter, if it matters."""
MATTERS = 0.1
"""Part of a parameter's tolerance by which it moves, if it matters: less is not worth a refusal."""
ALIKE, ALIKE_PART = 6.0, 0.05
"""Suspects differ by so much of twice the log likelihood, or by this part of what they explain, if
the residual cannot tell them apart: a fault of 20 % is linear in its size to about that part."""
NAMED = 3
"""Most suspects that are named as alike."""
FINEST = 1e-6
"""Least noise over the largest reading, of a simulation without any: no sensor resolves less."""
_SMALLEST, _LARGEST = 2.0**-6, 2.0**10
"""Limits of a family's size, in ordinary ones."""
_ROUNDS = 30
"""Updates of the families' sizes; most settle within ten."""


@dataclass(frozen=True)
class Fault:
    """A fault that explains the residual of a fit, in a sentence; whether it moves the values."""

    sentence: str
    moves: bool


@dataclass(frozen=True, eq=False)
class _Whitened:
    """Parameters, suspects and residual in units of noise.

    Attributes:
        A: derivatives by the parameters, in tolerances (n, K).
        S: changes by the suspects at ordinary size (n, C).
        r: residual (n,).
        worth: independent readings that the n are worth.
        rest: degrees of freedom of the noise.
    """

    A: np.ndarray
    S: np.ndarray
    r: np.ndarray
    worth: float
    rest: float


def allowed_for(problem: Problem, outcome: Outcome) -> tuple[Outcome, Fault | None]:
    """The outcome with an uncertainty that holds what suspects could move, and a large fault."""
    x = outcome.solution.x
    some = np.unique(np.linspace(0, len(problem.data) - 1, ROWS).astype(int))
    every = list(suspects(problem, x, some))
    more = list(background(problem, x, some))
    columns = sum(s.change.shape[2] for s in (*every, *more)) + len(problem.free)
    if 6 * len(some) - columns >= SPARE:
        every += more
    seen = _whitened(problem, outcome, every, some)
    if seen is None:
        return outcome, None
    q = np.linalg.qr(seen.A)[0]
    left, alone = seen.r - q @ (q.T @ seen.r), seen.S - q @ (q.T @ seen.S)
    if not _more_than_noise(seen, alone, left):
        return outcome, None
    groups = _columns(every)
    shift, spread = _posterior(seen, _sizes(alone, left, every))
    std = np.sqrt(np.diagonal(outcome.covariance))
    wide = np.hypot(spread, shift) * problem.scale
    factor = np.maximum(1.0, np.divide(wide, std, out=np.ones_like(std), where=std > 0.0))
    grown = replace(outcome, covariance=outcome.covariance * np.outer(factor, factor))
    names, size = _likeliest(every, groups, seen, alone, left)
    if np.sqrt((size**2).mean()) < LARGE:
        return grown, None
    ratio = np.where(outcome.solution.blind < BLIND, np.abs(shift) / _by_noise(seen), 0.0)
    moved = bool(((ratio > MOVED) & (np.abs(shift) > MATTERS)).any())
    k = int(np.argmax(np.where(np.abs(shift) > MATTERS, ratio, 0.0)))
    by = f"{abs(shift[k]) * problem.scale[k]:.2g} {problem.model.parameters[problem.free[k]].unit}"
    name = problem.model.parameters.names[problem.free[k]]
    return grown, Fault(_sentence(names, size, f"{name} moves by {by} with it"), moved)


def _sentence(names: list[str], size: np.ndarray, moves: str) -> str:
    """On faults that explain the residual alike, the first of so many ordinary sizes."""
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


def _columns(every: list[Suspect]) -> list[slice]:
    """Columns of each suspect among those of all."""
    ends = np.cumsum([s.change.shape[2] for s in every])
    return [slice(end - s.change.shape[2], end) for s, end in zip(every, ends, strict=True)]


def _whitened(
    problem: Problem, outcome: Outcome, every: list[Suspect], some: np.ndarray
) -> _Whitened | None:
    """Parameters and suspects in units of the noise that all of them leave; None if too few."""
    x, motion = outcome.solution.x, isinstance(problem.data.q, Jet)
    slopes, changes = problem.jacobian(x)[some] * problem.scale, [s.change for s in every]
    rows = np.concatenate([slopes, *changes, problem.residual(x)[some][..., None]], axis=2)
    more = _beyond_wrenches(problem, x, every)
    least = np.maximum(outcome.noise.expected, FINEST * np.abs(problem.data.wrench).max(axis=0))
    least = np.where(least > 0.0, least, np.inf)  # a channel that reads nothing
    noise, worth = np.maximum(outcome.noise.scatter, least), float(rows[..., 0].size)
    for _ in range(2):  # the second time by the noise that suspects leave
        white = np.concatenate([(rows / noise[:, None]).reshape(-1, rows.shape[2]), more])
        if not np.isfinite(white).all():
            return None
        u, s, _ = np.linalg.svd(white[:, :-1], full_matrices=False)
        kept = u[:, s > 1e-9 * s[0]]
        r = white[:, -1]
        rest = (r - kept @ (kept.T @ r))[: rows[..., 0].size].reshape(-1, 6)
        spare = rest.size - kept.shape[1]
        if spare < SPARE:
            return None
        time = correlation_time(rest) if motion else np.ones(6)
        unit = np.where(np.isinf(noise), 0.0, noise)
        scale = np.sqrt((rest**2).mean(axis=0) * rest.size / spare * time) * unit
        noise = np.where(np.isinf(least), np.inf, np.maximum(scale, least))
        worth = float((len(rest) / time).sum())
    white = np.concatenate([(rows / noise[:, None]).reshape(-1, rows.shape[2]), more])
    k = len(problem.free)
    share = worth / rest.size
    return _Whitened(white[:, :k], white[:, k:-1], white[:, -1], worth, max(1.0, spare * share))


def _beyond_wrenches(problem: Problem, x: np.ndarray, every: list[Suspect]) -> np.ndarray:
    """Rows (R, K + C + 1) of touches and prior, in units of their noise."""
    count, blocks = len(problem.free), []
    columns = sum(s.change.shape[2] for s in every)
    touches, robot, theta = problem.touches, problem.model.robot, problem.at(x)
    if touches is not None:
        residual = touches.residual(robot, theta)[:, None]
        slopes = touches.jacobian(robot, theta, problem.free) * problem.scale
        tips = [
            np.zeros((len(residual), s.change.shape[2])) if s.tips is None else s.tips
            for s in every
        ]
        blocks.append(np.concatenate([slopes, *tips, residual], axis=1))
    if problem.prior:
        to_centre = ((problem.centre - x) / problem.scale)[:, None]
        blocks.append(
            np.concatenate([np.eye(count), np.zeros((count, columns)), to_centre], axis=1)
        )
    return np.concatenate([np.empty((0, count + columns + 1)), *blocks])


def _more_than_noise(seen: _Whitened, alone: np.ndarray, left: np.ndarray) -> bool:
    """Whether suspects explain more of the residual than they do of noise."""
    along = np.abs(alone.T @ left) / _lengths(seen, alone)
    if along.max() > CLEAR:
        return True
    u, s, _ = np.linalg.svd(alone, full_matrices=False)
    kept = u[:, s > 1e-9 * s[0]]
    many = max(1, kept.shape[1])
    return bool(special.fdtrc(many, seen.rest, float(((kept.T @ left) ** 2).sum()) / many) < SURE)


def _lengths(seen: _Whitened, alone: np.ndarray) -> np.ndarray:
    """Lengths (C,) of what parameters leave of suspects, never rounding alone."""
    return np.maximum(np.linalg.norm(alone, axis=0), 1e-6 * np.linalg.norm(seen.S, axis=0) + 1e-300)


def _sizes(alone: np.ndarray, left: np.ndarray, every: list[Suspect]) -> np.ndarray:
    """Size of each column's family (C,) that makes the residual likeliest (MacKay's updates).

    Args:
        alone: changes by the suspects that no parameter takes up (n, C), in units of noise.
        left: residual that no parameter takes up (n,), in units of noise.
        every: the suspects.
    """
    R = np.linalg.qr(np.column_stack([alone, left]), mode="r")
    square, right = R[:, :-1].T @ R[:, :-1], R[:, :-1].T @ R[:, -1]
    family = np.array([f for s in every for f in s.families])
    families = [family == f for f in dict.fromkeys(family.tolist())]
    size = np.ones(len(family))
    for _ in range(_ROUNDS):
        covariance = np.linalg.inv(square * np.outer(size, size) + np.eye(len(size)))
        mean = covariance @ (right * size)  # in units of the sizes
        for of in families:
            determined = max(float(of.sum() - np.trace(covariance[np.ix_(of, of)])), 1e-9)
            now = float(size[of][0]) * np.sqrt(float((mean[of] ** 2).sum()) / determined)
            size[of] = np.clip(now, _SMALLEST, _LARGEST)
    return size


def _posterior(seen: _Whitened, size: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Shift (K,) and spread (K,) of the parameters beside suspects of such sizes, in tolerances."""
    both = np.column_stack([seen.A, seen.S])
    k = seen.A.shape[1]
    precision = np.concatenate([np.full(k, 1e-12), 1.0 / size**2])
    covariance = np.linalg.inv(both.T @ both + np.diag(precision))
    spread = np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
    return (covariance @ (both.T @ seen.r))[:k], spread[:k]


def _by_noise(seen: _Whitened) -> np.ndarray:
    """Standard uncertainty (K,) of the parameters by noise alone, in tolerances."""
    alone = np.diagonal(np.linalg.pinv(seen.A.T @ seen.A, rcond=1e-12))
    return np.sqrt(np.maximum(alone, 1e-300))


def _likeliest(
    every: list[Suspect],
    groups: list[slice],
    seen: _Whitened,
    alone: np.ndarray,
    left: np.ndarray,
) -> tuple[list[str], np.ndarray]:
    """Names of the suspects that explain the residual best by themselves, and the best one's sizes.

    What k shapes explain counts less by k log n (Schwarz 1978, doi 10.1214/aos/1176344136); of
    suspects that explain it alike, those of fewest shapes are named.
    """
    scores = []
    for of in groups:
        u, s, vt = np.linalg.svd(alone[:, of], full_matrices=False)
        keep = s > 1e-6 * np.linalg.norm(seen.S[:, of])
        along = u[:, keep].T @ left
        sizes = vt[keep].T @ (along / s[keep])
        scores.append((float(along @ along) - keep.sum() * np.log(seen.worth), sizes))
    best = max(score for score, _ in scores)
    least = best - max(ALIKE, ALIKE_PART * best)
    alike = [k for k in range(len(every)) if scores[k][0] >= least]
    alike.sort(key=lambda k: (len(scores[k][1]), -scores[k][0]))
    few = [k for k in alike if len(scores[k][1]) == len(scores[alike[0]][1])]
    return [every[k].name for k in few[:NAMED]], scores[few[0]][1]
