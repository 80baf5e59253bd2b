"""Least squares over the joints of an arm: all rows, and without each block of time."""

from dataclasses import dataclass, replace

import numpy as np

FOLDS = 20
"""Blocks of time; their number less one are the degrees of freedom of the intervals: 19 widen them
by 7 %."""
_ROUNDS, _SETTLED, _LEVEL = 30, 1e-9, 1e-3
"""Gauss–Newton steps at most, step over the parameters and change of the weights that end them."""
_NULL = 1e-7
"""Eigenvalue over the largest, columns scaled to 1, below which a direction is undetermined."""
_SHARE = 1e-3
"""Part of a parameter in undetermined directions from which it counts as undetermined."""
_PRIOR_FREEDOM = 1.0
"""Degrees of freedom of the prior that link errors have their ordinary size: one error seen."""
_START_CONSTANT = 10.0
"""Drive constant at which a fit of currents starts [N·m/A]: any will do, it is found linearly."""


@dataclass(frozen=True, eq=False)
class Problem:
    """Filtered efforts of all joints, and the columns that explain them.

    Attributes:
        y: measured effort (M, J).
        nominal: torque of the nominal rigid body (M, J).
        loads: torques by unit changes of inertial parameters (M, J, D), named by ``changes``.
        own: columns of each joint alone (M, J, F): friction and the like, named by ``kinds``.
        use: rows to use (M, J), boolean.
        fold: number of the block of time of each row (M,).
        gains: whether each joint's drive constant is free.
        spread: prior standard deviation of each inertial change (D,).
    """

    y: np.ndarray
    nominal: np.ndarray
    loads: np.ndarray
    changes: tuple[str, ...]
    own: np.ndarray
    kinds: tuple[str, ...]
    use: np.ndarray
    fold: np.ndarray
    gains: bool
    spread: np.ndarray


@dataclass(frozen=True, eq=False)
class Solution:
    """Parameters (K,) from all rows, and (FOLDS, K) without each block of time; whether the data
    determine each (K,), and the weight (J,) of each joint's rows."""

    x: np.ndarray
    folds: np.ndarray
    determined: np.ndarray
    weight: np.ndarray


def solve(problem: Problem) -> Solution:
    """Fit all rows, joints weighted by 1 / rms residual; then fit without each block of time."""
    spread, known = problem.y.std(axis=0), _prior_precision(problem)
    x, weight = start(problem), 1.0 / np.where(spread > 0.0, spread, 1.0)
    for _ in range(_ROUNDS):
        normal, right = _normal(problem, x, weight)
        step = _shortest(normal.sum(axis=0) + np.diag(known), right.sum(axis=0) - known * x)
        x, before = x + step, weight
        square = np.average(residual(problem, x) ** 2, axis=0, weights=problem.use.astype(float))
        weight = 1.0 / np.sqrt(np.maximum(square, 1e-300))
        small = np.abs(step).max() <= _SETTLED * max(1.0, float(np.abs(x).max()))
        if small and np.abs(weight / before - 1.0).max() < _LEVEL:
            break
    normal, right = _normal(problem, x, weight)
    whole = normal.sum(axis=0)
    all_known, all_right = whole + np.diag(known), right.sum(axis=0) - known * x
    blocks = zip(normal, right, strict=True)
    folds = [x + _shortest(all_known - n, all_right - r) for n, r in blocks]
    return Solution(x, np.array(folds), _determined(whole), weight)


def moved_by(p: Problem, s: Solution, torques: np.ndarray) -> np.ndarray:
    """Parameters (H, K) of H fits, each of efforts plus one of H ``torques`` (M, J, H)."""
    gain = parts(p, s.x)[0]
    normal, right = _normal(p, s.x, s.weight)
    whole = normal.sum(axis=0) + np.diag(_prior_precision(p))
    shifted = (_normal(replace(p, y=p.y + gain * one), s.x, s.weight)[1]
               for one in np.moveaxis(torques, -1, 0))  # fmt: skip
    return np.array([s.x + _shortest(whole, (r - right).sum(axis=0)) for r in shifted])


def sizes_shown(p: Problem, s: Solution, torques: np.ndarray, moved: np.ndarray) -> float:
    """Standard deviation of the factors of H ``torques`` (M, J, H), ordinarily 1, that the residual
    shows: their products with it vary more than between blocks of time (method of moments). A few
    of them decide, so it counts with their degrees of freedom (Satterthwaite 1946, doi
    10.2307/3002019) beside the ordinary size. ``moved`` (H, K): parameters by `moved_by`."""
    gain, rest, weight = parts(p, s.x)[0], residual(p, s.x), s.weight * p.use
    each = zip(np.moveaxis(torques, -1, 0), moved, strict=True)
    left = [weight * (residual(replace(p, y=p.y + gain * one), x) - rest) for one, x in each]
    alone = np.stack(left).reshape(len(left), -1)
    block = np.repeat(p.fold, p.y.shape[1])
    products = alone * (weight * rest).ravel()
    score = np.stack([products[:, block == k].sum(axis=1) for k in range(FOLDS)])
    total = score.sum(axis=0)
    noise = FOLDS / (FOLDS - 1) * float(((score - total / FOLDS) ** 2).sum())
    gram = alone @ alone.T
    square = max(float((gram**2).sum()), 1e-300)
    shown = max(0.0, total @ total - noise) / square
    freedom = square**2 / max(float(((gram @ gram) ** 2).sum()), 1e-300)
    return float(np.sqrt((_PRIOR_FREEDOM + freedom * shown) / (_PRIOR_FREEDOM + freedom)))


def followed_gravity(p: Problem, pull: np.ndarray, stated: np.ndarray) -> np.ndarray:
    """Gravity (3,) [m/s²], as large as the stated one (3,), that best explains the efforts beside
    each joint's own columns; pull: torques per unit of gravity along each base axis (M, J, 3)."""
    free = replace(p, loads=pull, changes=("x", "y", "z"), spread=np.full(3, np.inf))
    other = stated + parts(free, solve(free).x)[1]
    return np.asarray(other * np.linalg.norm(stated) / np.linalg.norm(other))


def _prior_precision(p: Problem) -> np.ndarray:
    """Prior precision (K,) of the parameters: of inertial changes, else 0. Rows of a block count as
    one, because model errors are alike in them."""
    result = np.zeros(len(start(p)))
    at = p.y.shape[1] * p.gains
    result[at : at + len(p.changes)] = len(p.y) / FOLDS / p.spread**2
    return result


def residual(p: Problem, x: np.ndarray) -> np.ndarray:
    """Torque residual (M, J) at parameters x (K,)."""
    gain, change, friction = parts(p, x)
    body = p.nominal + p.loads @ change
    return np.asarray(p.y - gain * body - np.einsum("mjf,jf->mj", p.own, friction))


def parts(p: Problem, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Split parameters or flags (…, K): gains (…, J), inertial changes (…, D), joints' own (…, J,
    F)."""
    joints, changes = p.y.shape[1], len(p.changes)
    at = joints * p.gains
    gain = x[..., :at] if at else np.ones(joints, dtype=x.dtype)
    own = x[..., at + changes :].reshape(*x.shape[:-1], joints, -1)
    return gain, x[..., at : at + changes], own


def start(p: Problem) -> np.ndarray:
    """Initial parameters (K,): those of the nominal robot."""
    joints = p.y.shape[1]
    gains = np.full(joints * p.gains, 1.0 / _START_CONSTANT)
    return np.concatenate([gains, np.zeros(len(p.changes) + joints * len(p.kinds))])


def _normal(p: Problem, x: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Normal equations of each block: JᵀWJ (FOLDS, K, K), JᵀWr (FOLDS, K); W: ``weight`` (J,)."""
    rest, (gain, change, _) = residual(p, x), parts(p, x)
    body = p.nominal + p.loads @ change
    joints, changes, kinds = p.y.shape[1], len(p.changes), len(p.kinds)
    at = joints * p.gains
    normal, right = np.zeros((FOLDS, len(x), len(x))), np.zeros((FOLDS, len(x)))
    blocks = _blocks(p.fold)
    for j in range(joints):
        first = at + changes + kinds * j
        spans = (range(j, j + p.gains), range(at, at + changes), range(first, first + kinds))
        places = np.array([k for span in spans for k in span], dtype=int)
        of_joint = body[:, j : j + p.gains]
        columns = [of_joint, gain[j] * p.loads[:, j], p.own[:, j], rest[:, j : j + 1]]
        some = np.concatenate(columns, axis=1) * (weight[j] * p.use[:, j : j + 1])
        some = np.concatenate([some, np.zeros_like(some[:1])])[blocks]
        products = np.swapaxes(some, 1, 2) @ some
        normal[:, places[:, None], places] += products[:, :-1, :-1]
        right[:, places] += products[:, :-1, -1]
    return normal, right


def _blocks(fold: np.ndarray) -> np.ndarray:
    """Row numbers of each block (FOLDS, L), padded with −1."""
    order, count = np.argsort(fold, kind="stable"), np.bincount(fold, minlength=FOLDS)
    place = np.arange(count.max())
    first = np.cumsum(count) - count
    within = np.minimum(first[:, None] + place, len(fold) - 1)
    return np.where(place < count[:, None], order[within], -1)


def _scaled(normal: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Roots (K,) of a matrix's diagonal; eigenvalues, eigenvectors of it scaled by these roots."""
    scale = np.sqrt(np.maximum(np.diagonal(normal), 1e-300))
    value, vector = np.linalg.eigh(normal / np.outer(scale, scale))
    return scale, value, vector


def _shortest(normal: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solution (K,) of normal equations, ``right`` side (K,): the shortest in scaled columns."""
    scale, value, vector = _scaled(normal)
    inverse = np.divide(1.0, value, out=np.zeros_like(value), where=value > _NULL * value[-1])
    return np.asarray(vector @ (inverse * (vector.T @ (right / scale))) / scale)


def _determined(normal: np.ndarray) -> np.ndarray:
    _, value, vector = _scaled(normal)
    return np.asarray((vector[:, value < _NULL * value[-1]] ** 2).sum(axis=1) < _SHARE)
