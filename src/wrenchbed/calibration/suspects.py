"""What faults of sensor, mount and joints could move a fit by, where noise does not explain it all.

A gain of one channel makes the readings disagree with every rigid load, and yet moves the mass that
fits best. So the residual is explained by the suspects, each family with a size of its own, found
by maximum marginal likelihood (MacKay 1992, doi 10.1162/neco.1992.4.3.415); what they do to each
parameter is added to its uncertainty, and a fit that a large fault moves is refused by its name.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy import special
from scipy.linalg import solve_triangular

from wrenchbed.calibration.fit_problem import Outcome, Problem
from wrenchbed.calibration.least_squares import BLIND
from wrenchbed.physics.time_derivatives import Jet
from wrenchbed.physics.wrench import CHANNELS

ROWS = 4000
"""Most observations that are looked at, evenly spread: half a minute at 125 Hz."""
SPARE = 20
"""Readings beyond all parameters from which a residual tells its causes."""
SURE, CLEAR = 1e-6, 5.0
"""P-value of the F test of all suspects, and standard deviations of one of them, from which they
explain a part of the residual."""
LARGE = 8.0
"""Sizes of an ordinary imperfection from which it is a fault: 8 % of a gain, 1.6° of a tilt."""
MOVED = 5.0
"""Standard uncertainties by which a fault moves a parameter, if it matters."""
MATTERS = 0.1
"""Part of a parameter's tolerance by which it moves, if it matters: less is not worth a refusal."""
STEP = 1e-6
"""Step of finite differences of angles [rad] and joint values [rad; m]."""
FINEST = 1e-6
"""Least noise over the largest reading, of a simulation without any: no sensor resolves less."""
_SIZES = 2.0 ** np.arange(-6.0, 10.0)
"""Sizes of a family that are tried, in ordinary ones."""
_SWEEPS = 2
"""Passes over the families, whose sizes depend on each other where they explain the same."""


class Suspect(NamedTuple):
    """A fault with its change of each reading (M, 6) at ordinary size."""

    family: str
    name: str
    change: np.ndarray


@dataclass(frozen=True, eq=False)
class _Explained:
    """A residual explained by suspects.

    Attributes:
        shift: of the parameters (K,), in tolerances.
        std: standard uncertainty of the shift (K,), in tolerances.
        least: the part of ``std`` that is due to noise alone (K,), in tolerances.
        times: size of each suspect (S,) in ordinary ones.
        sure: by how many standard deviations each explains more than noise, alone (S,).
    """

    shift: np.ndarray
    std: np.ndarray
    least: np.ndarray
    times: np.ndarray
    sure: np.ndarray


def allowed_for(problem: Problem, outcome: Outcome) -> tuple[Outcome, str | None]:
    """The outcome with an uncertainty that holds what suspects could move, and why it is refuted.

    Args:
        problem: what was fitted, without touches or prior.
        outcome: of the fit.

    Returns:
        The outcome, and a sentence on the fault; None if no large one moves the values.
    """
    if problem.prior or problem.touches is not None:
        return outcome, None
    some = np.unique(np.linspace(0, len(problem.data) - 1, ROWS).astype(int))
    every = list(_suspects(problem, outcome.solution.x, some))
    explained = _explained(problem, outcome, every, some)
    if explained is None:
        return outcome, None
    std = np.sqrt(np.diagonal(outcome.covariance))
    wide = np.hypot(explained.std, explained.shift) * problem.scale
    ratio = np.abs(explained.shift) / explained.least
    moved = (ratio > MOVED) & (np.abs(explained.shift) > MATTERS) & (outcome.solution.blind < BLIND)
    fault = _largest(every, explained)
    factor = np.maximum(1.0, np.divide(wide, std, out=np.ones_like(std), where=std > 0.0))
    grown = replace(outcome, covariance=outcome.covariance * np.outer(factor, factor))
    if not moved.any() or fault is None:
        return grown, None
    k = int(np.argmax(np.where(moved, ratio, 0.0)))
    parameter = problem.model.parameters[problem.free[k]]
    by = abs(explained.shift[k]) * problem.scale[k]
    return grown, (
        "the readings are not those of one load: of the faults that were tried, "
        f"{every[fault].name} explains most, and moves {parameter.name} by {by:.2g} "
        f"{parameter.unit}. "
        "Run `wrenchbed diagnose`, repair what it names, and calibrate again"
    )


def _largest(suspects: list[Suspect], explained: _Explained) -> int | None:
    """The suspect that explains most of those that are surely faults; None if none is."""
    power = [float((s.change**2).sum()) for s in suspects] * explained.times**2
    fault = (np.abs(explained.times) > LARGE) & (explained.sure > CLEAR)
    return int(np.argmax(np.where(fault, power, -1.0))) if fault.any() else None


def _suspects(problem: Problem, x: np.ndarray, some: np.ndarray) -> Iterator[Suspect]:
    """Gains, crosstalk, tilt of gravity, zeros of joints and a delay, at some observations."""
    model, theta = problem.model, problem.at(x)
    q, t = problem.data.q[some], problem.data.t
    read = model.predict(q, theta)
    for i, to in enumerate(CHANNELS):
        for j, of in enumerate(CHANNELS):
            change = np.zeros_like(read)
            size = 0.01 if i == j else 0.005 * _arm(i, j)
            change[:, i] = size * read[:, j]
            if i == j:
                yield Suspect("gain", f"a wrong gain of {to}", change)
            else:
                yield Suspect("crosstalk", f"a crosstalk of {of} in {to}", change)
    gravity = np.asarray(model.gravity)
    for axis in np.linalg.svd(gravity[None])[2][1:]:
        tilted = replace(model, gravity=tuple(gravity + STEP * np.cross(axis, gravity)))
        change = (tilted.predict(q, theta) - read) * (np.deg2rad(0.2) / STEP)
        yield Suspect("tilt", "another direction of gravity", change)
    for j, joint in enumerate(model.robot.joints):
        unit = np.eye(len(model.robot.joints))[j]
        shifted = Jet(q.v + STEP * unit, q.d, q.dd) if isinstance(q, Jet) else q + STEP * unit
        size = np.deg2rad(0.2) if joint.unit == "rad" else 2e-4
        change = (model.predict(shifted, theta) - read) * (size / STEP)
        yield Suspect("zero", f"a wrong zero of {joint.name}", change)
    if isinstance(q, Jet):
        whole = model.predict(problem.data.q, theta)
        late = -0.002 * np.gradient(whole, t, axis=0)[some]
        yield Suspect("delay", "a wrench that is late", late)


def _arm(i: int, j: int) -> float:
    """Lever between channels of different kinds: 0.1 m of torque from force, its inverse back."""
    return 1.0 if (i < 3) == (j < 3) else 0.1 if j < 3 else 10.0


def _explained(
    problem: Problem, outcome: Outcome, suspects: list[Suspect], some: np.ndarray
) -> _Explained | None:
    """The residual explained by suspects; None where they explain no more than noise would."""
    x = outcome.solution.x
    residual, slopes = problem.residual(x)[some], problem.jacobian(x)[some] * problem.scale
    changes = np.stack([s.change for s in suspects], axis=2)
    least = np.maximum(outcome.noise.expected, FINEST * np.abs(problem.data.wrench).max(axis=0))
    least = np.where(least > 0.0, least, np.inf)  # a channel that reads nothing
    noise = np.maximum(outcome.noise.scatter, least)
    for _ in range(2):  # the second time by the noise that suspects leave
        A, S, r = (
            (v / noise.reshape(1, 6, *[1] * (v.ndim - 2))).reshape(-1, *v.shape[2:])
            for v in (slopes, changes, residual)
        )
        both = np.column_stack([A, S])
        if not (np.isfinite(both).all() and np.isfinite(r).all()):
            return None
        u, s, _ = np.linalg.svd(both, full_matrices=False)
        kept = u[:, s > 1e-9 * s[0]]
        rest = r - kept @ (kept.T @ r)
        spare = len(r) - kept.shape[1]
        if spare < SPARE:
            return None
        unit = np.where(np.isinf(noise), 0.0, noise)
        scale = np.sqrt((rest.reshape(-1, 6) ** 2).mean(axis=0) * len(r) / spare) * unit
        noise = np.where(np.isinf(least), np.inf, np.maximum(scale, least))
    q = np.linalg.qr(A)[0]
    left = r - q @ (q.T @ r)
    explained, remains = float(left @ left - rest @ rest), float(rest @ rest)
    many = kept.shape[1] - A.shape[1]
    ratio = explained / max(many, 1) / max(remains / spare, 1e-300)
    S_left = S - q @ (q.T @ S)
    length = np.linalg.norm(S_left, axis=0)
    least = 1e-6 * np.linalg.norm(S, axis=0) + 1e-300
    alone = np.abs(S_left.T @ left) / np.maximum(length, least)
    if special.fdtrc(max(many, 1), spare, ratio) > SURE and alone.max() < CLEAR:
        return None
    return _posterior(A, S, r, _sizes(S_left, left, [s.family for s in suspects]), alone)


def _sizes(S: np.ndarray, left: np.ndarray, family: list[str]) -> np.ndarray:
    """Size of each suspect's family (S,) that makes the residual likeliest, one family at a time.

    Args:
        S: changes by the suspects that no parameter takes up (n, S), in units of noise.
        left: residual that no parameter takes up (n,), in units of noise.
        family: of each suspect.
    """
    q, R = np.linalg.qr(S)
    y = q.T @ left
    groups = {f: np.array([g == f for g in family]) for f in dict.fromkeys(family)}
    size = np.full(len(family), _SIZES[0])

    def cost(trial: np.ndarray) -> float:
        try:
            lower = np.linalg.cholesky(np.eye(len(R)) + (R * trial**2) @ R.T)
        except np.linalg.LinAlgError:  # beside such sizes, noise is less than rounding
            return np.inf
        white = solve_triangular(lower, y, lower=True, check_finite=False)
        return float(2.0 * np.log(np.diagonal(lower)).sum() + white @ white)

    for _ in range(_SWEEPS):
        for of in groups.values():
            trials = [np.where(of, s, size) for s in _SIZES]
            size = min(trials, key=cost)
    return size


def _posterior(
    A: np.ndarray, S: np.ndarray, r: np.ndarray, size: np.ndarray, sure: np.ndarray
) -> _Explained:
    """Parameters and suspects together, each suspect with a prior of its family's size."""
    both = np.column_stack([A, S])
    k = A.shape[1]
    precision = np.concatenate([np.full(k, 1e-12), 1.0 / size**2])
    covariance = np.linalg.inv(both.T @ both + np.diag(precision))
    mean, std = covariance @ (both.T @ r), np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
    alone = np.diagonal(np.linalg.pinv(A.T @ A, rcond=1e-12))
    least = np.sqrt(np.maximum(alone, 1e-300))
    return _Explained(mean[:k], std[:k], least, mean[k:], sure)
