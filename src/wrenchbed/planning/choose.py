"""Choose what to record: random poses, the most informative ones, or a multi-sine motion."""

from collections.abc import Callable

import numpy as np

from wrenchbed import registry
from wrenchbed.calibration.tracker import planned_slopes
from wrenchbed.data.plan import Plan
from wrenchbed.errors import PlanError
from wrenchbed.planning.criteria import INDICES, InverseTrace
from wrenchbed.planning.exchange import Pool, exchange
from wrenchbed.robots.base import Robot, SimulatedRobot
from wrenchbed.simulation.closed_form import Model

BASE_PERIOD_S = 10.0
"""Period of a multi-sine's slowest sine [s]."""
HARMONICS = 5
_FADE_S = 2.0
_SPEED_SHARE = 0.6
_REACH = np.deg2rad(20.0)
_REACH_M = 0.05
TRACKER_NOISE = 5e-5
"""Noise of a target's position at rest [m], that of `Simulation` in examples: a laser tracker."""


def poses(robot: Robot, n: int, seed: int) -> Plan:
    """Plan n random feasible poses in random order; a `PlanError` if n < 1, or without joints."""
    if n < 1:
        raise PlanError(f"a plan of {n} poses is empty")
    if not robot.joints:
        raise PlanError(f"robot {robot.name!r} has no joints to plan for")
    return Plan.of(robot.name, robot.sample(n, np.random.default_rng(seed)))


def informative(
    robot: Robot,
    n: int,
    index: str,
    pool: int,
    seed: int,
    progress: Callable[[float], None] = lambda _: None,
) -> Plan:
    """Choose n of ``pool`` random poses that make an observability index of the model largest.

    The Jacobian is that of readings over their noise by parameters over their tolerances.

    Args:
        index: ``O1`` … ``O5`` (observability) or ``A`` (A-optimality), see `criteria`.
        progress: called with the index after each exchange of poses that raises it.

    Raises:
        PlanError: an unknown index, a pool smaller than n, too few poses for the parameters, or
            free parameters that cannot be told apart.
    """
    q = _candidates(robot, n, pool, seed)
    model = Model.of(robot)
    theta = model.parameters.nominal
    columns = model.parameters.select(robot.free)
    criteria = INDICES | {"A": InverseTrace(np.eye(len(columns)), "A")}
    if index not in criteria:
        raise PlanError(f"index {index!r} is not one of {', '.join(criteria)}")
    std = registry.load("sensors", robot.sensor).noise.row_std
    scale = model.parameters.tolerance[list(columns)]
    candidates = Pool(model.jacobian(q, theta, columns) / std[:, None] * scale)
    chosen = exchange(candidates, criteria[index], n, seed=seed, tell=progress).chosen
    return Plan.of(robot.name, q[np.random.default_rng(seed).permutation(chosen)])


def for_tracker(
    robot: Robot, n: int, pool: int, seed: int, progress: Callable[[float], None] = lambda _: None
) -> Plan:
    """Choose n of ``pool`` random poses at which a laser tracker shows a robot's geometry best.

    I-optimal: minimises the mean variance with which a fit to the tracker's readings predicts
    positions; ``progress`` gets the rms error [m] after each exchange that lowers it. A `PlanError`
    for a robot without joints, or a pool smaller than n.
    """
    q = _candidates(robot, n, pool, seed)
    slopes = planned_slopes(robot, q)
    flat = slopes.reshape(-1, slopes.shape[-1])
    criterion = InverseTrace(flat.T @ flat / len(q))
    chosen = exchange(
        Pool(slopes / TRACKER_NOISE), criterion, n, prior=np.eye(slopes.shape[-1]), seed=seed,
        tell=lambda value: progress(float(value**-0.5)),
    ).chosen  # fmt: skip
    return Plan.of(robot.name, q[np.random.default_rng(seed).permutation(chosen)])


def _candidates(robot: Robot, n: int, pool: int, seed: int) -> np.ndarray:
    """Draw ``pool`` feasible joint values (pool, J); a `PlanError` unless n can be chosen of
    them."""
    if not robot.joints:
        raise PlanError(f"robot {robot.name!r} has no joints to plan for")
    if not 1 <= n <= pool:
        raise PlanError(f"{n} poses cannot be chosen from a pool of {pool}")
    return robot.pool(pool, seed)


def multisine(robot: Robot, seconds: float, rate: float, seed: int) -> Plan:
    """Return a plan of a sum of sines in each joint about a feasible pose, from rest to rest, with
    rows at ``rate`` [Hz].

    Harmonics of 0.1 Hz with random phases: Swevers et al. 1997, doi 10.1109/70.631234. A
    `PlanError` if there are no joints, it is too short, or no feasible motion was found.
    """
    if not isinstance(robot, SimulatedRobot):
        raise PlanError(f"robot {robot.name!r} has no joints to plan for")
    fine = 2 * _FADE_S + 1 <= seconds < np.inf and 10.0 <= rate < np.inf
    if not fine:
        raise PlanError(f"a motion takes at least {2 * _FADE_S + 1:.0f} s at 10 Hz or more")
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * rate)) / rate
    fade = _smooth(np.minimum(t, t[-1] - t) / _FADE_S)
    reach = np.array([_REACH_M if j.unit == "m" else _REACH for j in robot.joints])
    top = np.array([j.speed for j in robot.joints]) * _SPEED_SHARE
    for _ in range(50):
        middle = robot.sample(1, rng)[0]
        wave = _wave(t, len(robot.joints), rng) * fade[:, None]
        speed = np.abs(np.gradient(wave, t, axis=0)).max(axis=0)
        swing = np.minimum(reach / np.abs(wave).max(axis=0), top / speed)
        for shrink in (1.0, 0.5, 0.25):
            q = middle + shrink * swing * wave
            if not robot.infeasible(q, robot.parameters.nominal):
                return Plan.of(robot.name, q, rate_hz=rate)
    raise PlanError(f"found no feasible motion of {robot.name!r} in 50 tries: try another seed")


def _wave(t: np.ndarray, joints: int, rng: np.random.Generator) -> np.ndarray:
    """Sum (N, J) at t (N,) [s] of harmonics of `BASE_PERIOD_S`, with random weights and phases."""
    phase = rng.uniform(0.0, 2 * np.pi, (HARMONICS, joints))
    weight = rng.uniform(0.3, 1.0, (HARMONICS, joints))
    turn = 2 * np.pi * t[:, None] / BASE_PERIOD_S
    return np.asarray(sum(weight[k] * np.sin((k + 1) * turn + phase[k]) for k in range(HARMONICS)))


def _smooth(share: np.ndarray) -> np.ndarray:
    s = np.clip(share, 0.0, 1.0)
    return np.asarray(s**3 * (10 - 15 * s + 6 * s**2))
