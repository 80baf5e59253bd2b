"""Experiments that may follow a recording: what to do, how long it takes, the plan to run."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from wrenchbed.data.plan import Plan
from wrenchbed.diagnosis.prepare import scenes
from wrenchbed.diagnosis.prepare.configured_simulator import Configuration
from wrenchbed.diagnosis.prepare.prepared import BLOCKS_IN_MOTION, RATES_HZ, Prepared
from wrenchbed.errors import PlanError
from wrenchbed.physics.taylor_jets import Jet
from wrenchbed.planning.choose import multisine
from wrenchbed.robots.base import Robot, SimulatedRobot
from wrenchbed.robots.checked_moves import duration, reachable

POSES = 20
"""Largest number of poses of a proposed recording: some five minutes."""
PAYLOAD_KG, MOUNTING_S = 0.5, 120.0
"""Mass of a second payload [kg], and the time to mount it [s]."""
TURNS_S = 3.0
"""Time of a turn between orientations of a robot without a model [s]."""
_SWEPT = 16
_SWEEP = 2.6
"""Largest sweep of a rotary joint to either side [rad]."""
_FAST_S, _SLOWER, _RATE, _LOOK = 10.0, 3, 125.0, 5
"""Length of a motion [s], factor by which it is repeated slower, rate [Hz]; 1 row in 5 is used."""
_HOLDS, _HOLD_S = 20, 30.0
_HOLD_ROWS = 60


@dataclass(frozen=True, eq=False)
class ExperimentRun:
    """Rows that an experiment would record.

    Attributes:
        prepared: the rows, without readings.
        payload: mass [kg] and CoG in sensor axes (3,) [m] of a known load added to the tool.
        again: whether it continues the recording, whose sensor zero then still holds.
    """

    prepared: Prepared
    payload: tuple[float, np.ndarray] | None = None
    again: bool = True


def loaded(prepared: Prepared, payload: tuple[float, np.ndarray], **change: float) -> np.ndarray:
    """Parameters (P,) with a known ``payload``, mass [kg] and CoG (3,) [m], added to the tool;
    ``change`` is added to the tool's own mass or CoG first (``mass``, ``cog.x`` …)."""
    bare = Configuration(prepared.model, np.array(prepared.scene.theta))
    mass = bare.mass + change.get("mass", 0.0)
    cog = bare.cog + [change.get(f"cog.{a}", 0.0) for a in "xyz"]
    total = mass + payload[0]
    return bare.with_load(total, (mass * cog + payload[0] * payload[1]) / total).robot_theta


def posed(
    prepared: Prepared, q: np.ndarray, t: np.ndarray, noise: np.ndarray, *, after: bool
) -> Prepared:
    """Prepared poses (N, J) at times (N,) [s], appended to the recorded ones if ``after``;
    ``noise`` (C,) is a pose's variance over a row's."""
    old = prepared.poses if after else q[:0]
    kept = prepared.fold if after else np.zeros(0, dtype=int)
    when = prepared.scene.t[prepared.scene.held] if after else t[:0]
    every, times = np.concatenate([old, q]), np.concatenate([when, t])
    warm = prepared.scene.warmth
    if warm is not None:
        known = warm[prepared.scene.held] if after else warm[:0]
        warm = np.concatenate([known, np.full(len(q), warm[-1])])  # as warm as at the end
    scene = scenes.of_poses(prepared.model, prepared.scene.theta, every, times, warm)
    n = len(every)
    fold = np.concatenate([kept, np.zeros(len(q), dtype=int)])
    return replace(
        prepared, scene=scene, y=np.zeros((n, len(noise))), count=np.ones(n, dtype=int),
        noise=noise,
        block=np.arange(n), fold=fold, stride=1,
    )  # fmt: skip


def moved(prepared: Prepared, q: np.ndarray, rate: float) -> Prepared:
    """Prepared motion (N, J) sampled at ``rate`` [Hz], without readings."""
    d = np.gradient(q, 1.0 / rate, axis=0)
    jet = Jet(q, d, np.gradient(d, 1.0 / rate, axis=0))
    n = len(q)
    scene = scenes.of_motion(prepared.model, prepared.scene.theta, jet, np.arange(n) / rate, None)
    alone = prepared.leading  # what else was measured, was at rest
    noise = np.ones_like(alone.noise)
    return replace(
        alone, scene=scene, y=np.zeros((n, len(noise))), count=np.ones(n, dtype=int),
        noise=noise,
        block=np.arange(n) * BLOCKS_IN_MOTION // n, fold=np.zeros(n, dtype=int),
        stride=max(1, round(rate / RATES_HZ[1])),
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Action:
    """A proposed recording with its duration and plan.

    Attributes:
        text: imperative sentence for people, without a full stop.
        session: its rows, with those of the recording if it continues that.
        minutes: duration [min].
        plan: plan to run; None where there is nothing to plan.
        variables: variables on which a dependence of the residual would show.
    """

    text: str
    session: ExperimentRun
    minutes: float
    plan: Plan | None
    variables: tuple[str, ...] = ()


def actions(prepared: Prepared, seed: int = 0, sweeps: int | None = None) -> Iterator[Action]:
    """Recordings that a robot can make after ``prepared``; up to ``sweeps`` joints swept singly."""
    at_rest = () if prepared.moving else (_revisit, _hold)
    moving = (_motion,) if prepared.has_wrench else ()  # all other channels are read at rest
    for make in (_poses, _payload, *at_rest, *moving):
        yield from filter(None, [make(prepared, seed)])
    for k in range(len(prepared.robot.joints[:sweeps])):
        yield from filter(None, [_sweep(prepared, k, seed)])


def feasible(robot: Robot, q: np.ndarray) -> np.ndarray:
    """Whether the robot can take each pose (N, J), boolean (N,); if it knows its shape also whether
    it is clear of itself and the table."""
    good = np.ones(len(q), dtype=bool)
    good[list(robot.infeasible(q, robot.parameters.nominal))] = False
    clear = getattr(robot, "clear", None)
    if clear is not None and good.any():
        good[good] = clear(q[good])
    return good


def stay(prepared: Prepared) -> float:
    """Time spent at each pose of a recording [s]."""
    rate = prepared.recording.metadata.rate_hz or 100.0
    rows = _HOLD_ROWS if prepared.moving else float(np.mean(prepared.count))
    return rows / rate


def static_noise(prepared: Prepared) -> np.ndarray:
    """Noise variance of a pose's mean over a row's (C,)."""
    at_rest = np.full_like(prepared.noise, 1.0 / _HOLD_ROWS)
    return at_rest if prepared.moving else prepared.noise


def _visit(
    prepared: Prepared, q: np.ndarray, text: str, variables: tuple[str, ...], dwell: float = 0.0
) -> Action | None:
    """Action that visits poses (N, J) next, with a ``dwell`` [s] (0: the recording's); None if too
    few. ``text`` ({n}: their number) and ``variables`` as in `Action`."""
    robot = prepared.robot
    if robot.joints:
        q = reachable(robot, q)
    if len(q) < 3:
        return None
    both = zip([prepared.poses[-1], *q[:-1]], q, strict=True)
    way = [duration(robot, a, b) if robot.joints else TURNS_S for a, b in both]
    seconds = dwell or stay(prepared)
    begin = 0.0 if prepared.moving else float(prepared.scene.t[-1])
    t = begin + np.cumsum(np.array(way) + seconds) - seconds / 2
    noise = static_noise(prepared)
    rows = posed(prepared, q, t, noise, after=not prepared.moving)
    session = ExperimentRun(rows, again=not prepared.moving)
    plan = Plan.of(robot.name, q) if robot.joints else None
    if plan is not None and dwell:
        plan = replace(plan, dwell=np.full(len(q), dwell))
    minutes = (float(np.sum(way)) + seconds * len(q)) / 60.0
    return Action(text.format(n=len(q)), session, minutes, plan, variables)


def _pool(prepared: Prepared, seed: int) -> np.ndarray:
    robot = prepared.robot
    pool = robot.pool(120, seed) if robot.joints else robot.sample(120, np.random.default_rng(seed))
    return np.asarray(pool[feasible(robot, pool)] if robot.joints else pool)


def _poses(prepared: Prepared, seed: int) -> Action | None:
    text = "record {n} more poses in other orientations"
    return _visit(prepared, _pool(prepared, seed)[:POSES], text, ("orientation", "position"))


def _payload(prepared: Prepared, seed: int) -> Action | None:
    tool = prepared.scene.tool
    weight = float(np.min(prepared.sensor.calibration().range[:3])) / 9.81 - float(tool.mass)
    mass = min(PAYLOAD_KG, 0.5 * weight)
    if mass < 0.05:
        return None
    payload = (mass, 0.5 * np.asarray(tool.cog, dtype=float))
    text = f"fix a second, known payload of +{mass:.2g} kg and record {{n}} poses again"
    action = _visit(prepared, _some(prepared), text, ("load",))
    if action is None:
        return None
    q = _some(prepared) if action.plan is None else action.plan.q
    t = np.linspace(0.0, action.minutes * 60.0, len(q))
    again = posed(prepared, q, t, static_noise(prepared), after=False)
    minutes = action.minutes + MOUNTING_S / 60.0
    return replace(action, session=ExperimentRun(again, payload, False), minutes=minutes)


def _revisit(prepared: Prepared, seed: int) -> Action | None:
    q = _some(prepared)
    first = prepared.poses[:1]
    parts = [np.concatenate([first, q[k : k + 10]]) for k in range(0, len(q), 10)]
    text = "record {n} poses again and return to the first pose after every ten"
    return _visit(prepared, np.concatenate([*parts, first]), text, ("time",))


def _hold(prepared: Prepared, seed: int) -> Action | None:
    q = np.repeat(prepared.poses[:1], _HOLDS, axis=0)
    minutes = _HOLDS * _HOLD_S / 60.0
    text = f"hold the first pose from cold for {minutes:.0f} min and log the temperature"
    variables = ("time", "temperature", "earlier orientations")
    return _visit(prepared, q, text, variables, dwell=_HOLD_S)


def _motion(prepared: Prepared, seed: int) -> Action | None:
    robot = prepared.robot
    if not isinstance(robot, SimulatedRobot):
        return None
    try:
        fast = multisine(robot, _FAST_S, _RATE, seed).q
    except PlanError:
        return None
    t = np.arange(len(fast))
    when = np.arange((len(fast) - 1) * _SLOWER + 1) / _SLOWER
    slow = np.stack([np.interp(when, t, x) for x in fast.T], axis=1)
    width = 2 * _SLOWER + 1  # rounds the corners of the interpolation
    padded = np.pad(slow, ((_SLOWER, _SLOWER), (0, 0)), mode="edge")
    slow = np.stack([np.convolve(x, np.full(width, 1 / width), "valid") for x in padded.T], axis=1)
    q = np.concatenate([fast, slow])
    session = ExperimentRun(moved(prepared, q[::_LOOK], _RATE / _LOOK), None, False)
    text = f"move along one path fast and {_SLOWER} times slower"
    plan = Plan.of(robot.name, q, rate_hz=_RATE)
    return Action(text, session, len(q) / _RATE / 60.0 + 0.1, plan, ("speed", "direction"))


def _sweep(prepared: Prepared, joint: int, seed: int) -> Action | None:
    robot = prepared.robot
    limit = robot.joints[joint]
    low, high = limit.lower, limit.upper
    if limit.unit == "rad":
        low, high = max(low, -_SWEEP), min(high, _SWEEP)
    source = _some(prepared) if prepared.moving else prepared.poses
    if len(source) == 0:
        return None
    place = np.random.default_rng([seed, joint]).permutation(len(source))
    kept: list[np.ndarray] = []
    for k, at in enumerate(np.linspace(low, high, _SWEPT)):
        trial = source[np.roll(place, -k)].copy()
        trial[:, joint] = at
        good = np.flatnonzero(feasible(robot, trial))
        if len(good):
            kept.append(trial[good[0]])
    if len(kept) < 3:
        return None
    variables = (f"joint {joint + 1}", *(("position",) if joint == 0 else ()))
    return _visit(prepared, np.array(kept), f"sweep joint {joint + 1} over {{n}} poses", variables)


def _some(prepared: Prepared) -> np.ndarray:
    """Thirty poses, evenly from the recorded ones, in motion from feasible ones of the robot."""
    q = _pool(prepared, 1) if prepared.moving else prepared.poses
    return q[np.unique(np.linspace(0, len(q) - 1, min(30, len(q))).astype(int))] if len(q) else q
