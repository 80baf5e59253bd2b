"""Few measurements that make the tool accurate: poses under gravity and touches, mixed.

Gravity alone cannot fix where the base stands nor how long the tool is; touches of known points
can, and gravity poses cost no fixture. Both are candidates of one Bayesian I-optimal design
(Chaloner & Verdinelli 1995, doi 10.1214/ss/1177009939): the mean square position error in the
robot's target, given each parameter's tolerance as prior, falls as fast as it can.

That design is linear about the nominal robot; robots are not. A rehearsal of the plan on robots
whose every parameter is wrong within tolerance, with noise and the nonlinear fit, gives the
accuracy that the plan really reaches.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from wrenchbed import registry
from wrenchbed.calibration.accuracy import Goal, tip_jacobian
from wrenchbed.calibration.fit_problem import Problem
from wrenchbed.calibration.observations import Observations
from wrenchbed.calibration.touches import Touches
from wrenchbed.data.plan import Plan
from wrenchbed.data.recording import TOUCH_STD
from wrenchbed.errors import PlanError
from wrenchbed.planning.criteria import Criterion, i_optimality
from wrenchbed.planning.exchange import Pool, exchange
from wrenchbed.robots.base import GoalSets, Robot
from wrenchbed.simulation.closed_form import Model

ROBOTS = 100
_STEP, _TRIES, _THERE = 1e-6, 20, 1e-8
_MOST, _SCREENED, _TURNS, _ROUNDS = 400, 256, 2, 20
SAMPLES = 100
"""Rows that are averaged at one pose under gravity."""


@dataclass(frozen=True, eq=False)
class Measurements:
    """Poses under gravity and touches that are measured, with their noise.

    Attributes:
        gravity: joint values (N, J), each for a mean wrench.
        wrench_std: standard deviation of that (6,) [N, N·m].
        touch: joint values (T, J) near the points to touch.
        points: those (T, 3) in the world [m].
        touch_std: how far a tip sits from its point, per axis [m].
    """

    gravity: np.ndarray
    wrench_std: np.ndarray
    touch: np.ndarray
    points: np.ndarray
    touch_std: float


def simulate_plan(
    model: Model,
    columns: tuple[int, ...],
    measured: Measurements,
    target: np.ndarray,
    seed: int,
    robots: int = ROBOTS,
) -> tuple[np.ndarray, np.ndarray]:
    """Root mean square error in the target (robots,) [m] before and after.

    Args:
        columns: unknown parameters, drawn uniformly within their tolerances.
        target: joint values (G, J).
    """
    results = [_one(model, columns, measured, target, [seed, k]) for k in range(robots)]
    before, after = np.array(results).T
    if not np.isfinite(after).all():
        raise PlanError("a rehearsed robot leaves its workspace within its tolerances")
    return before, after


def _one(
    model: Model,
    columns: tuple[int, ...],
    measured: Measurements,
    target: np.ndarray,
    seed: list[int],
) -> tuple[float, float]:
    rng = np.random.default_rng(seed)
    robot, nominal = model.robot, model.parameters.nominal
    free = list(columns)
    truth = nominal.copy()
    tolerance = model.parameters.tolerance[free]
    truth[free] += rng.uniform(-1.0, 1.0, len(free)) * tolerance
    true = robot.robot_theta(truth)
    exact = model.predict(measured.gravity, truth)
    wrench = exact + rng.standard_normal(exact.shape) * measured.wrench_std
    tips = measured.points + rng.normal(0.0, measured.touch_std, measured.points.shape)
    q = _seated(robot, measured.touch, tips, true)
    rows = np.ones(len(wrench))
    noise = np.diag(np.square(measured.wrench_std))
    data = Observations(measured.gravity, wrench, rows, noise, np.inf, "stated", rows, rows > 0)
    touches = Touches(q, measured.points, measured.touch_std)
    problem = Problem(model, data, nominal, columns, nominal[free], prior=True, touches=touches)

    def whiten(x: np.ndarray) -> np.ndarray:
        std = measured.wrench_std
        return x / (std if x.ndim == 2 else std[:, None])

    fitted = problem.at(problem.solve(whiten, problem.start).x)
    tip = robot.tool_pose(target, true)[1]
    errors = (robot.tool_pose(target, robot.robot_theta(x))[1] - tip for x in (nominal, fitted))
    before, after = (float(np.sqrt((e**2).sum(axis=-1).mean())) for e in errors)
    return before, after


def _seated(robot: Robot, q: np.ndarray, points: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Joint values (T, J) nearest to q (T, J) whose tips are at points (T, 3)."""
    joints = q.shape[1]
    steps = np.vstack([np.zeros(joints), np.eye(joints) * _STEP])
    for _ in range(_TRIES if len(q) else 0):
        around = (q[:, None] + steps).reshape(-1, joints)
        tip = robot.tool_pose(around, theta)[1].reshape(len(q), joints + 1, 3)
        miss = points - tip[:, 0]
        if np.abs(miss).max() < _THERE:
            break
        slope = np.swapaxes(tip[:, 1:] - tip[:, :1], -1, -2) / _STEP
        q = q + (np.linalg.pinv(slope) @ miss[..., None])[..., 0]
    return q


@dataclass(frozen=True, eq=False)
class MixOptions:
    """Options and costs of a mix of measurements.

    Attributes:
        share: of the robots that shall reach the accuracy.
        least_poses: under gravity, at least; they calibrate the sensor itself.
        touch_cost: what a touch costs, in poses under gravity.
        pool: gravity poses to choose from.
        points: known positions to touch (K, 3) [m]; the robot's default if None.
        touch_std: how far a tip sits from its point, per axis [m].

    Raises:
        PlanError: a number makes no sense.
    """

    share: float = 0.99
    least_poses: int = 6
    touch_cost: float = 1.0
    pool: int = 4000
    points: np.ndarray | None = None
    touch_std: float = TOUCH_STD

    def __post_init__(self) -> None:
        if not (0 < self.share < 1 and self.touch_cost > 0 and self.touch_std > 0):
            raise PlanError(
                f"touch cost {self.touch_cost} and touch std {self.touch_std} m must be above 0, "
                f"share {self.share} between 0 and 1"
            )
        if not 0 <= self.least_poses <= self.pool or self.pool < 1:
            raise PlanError(f"{self.least_poses} poses cannot be chosen from a pool of {self.pool}")


@dataclass(frozen=True, eq=False)
class Mix:
    """A plan in two parts.

    Attributes:
        gravity, touches: plans; either may have 0 rows.
        rms: root mean square position error in the target [m], over the rehearsed robots.
        assured: what it stays below for the wanted share of them [m].
        before: rms without any measurement [m].
        share: of the rehearsed robots that the plan is for.
        course: (measurements, error [m] assured by the linear design) as the plan grew.
    """

    gravity: Plan
    touches: Plan
    rms: float
    assured: float
    before: float
    share: float
    course: tuple[tuple[int, float], ...]

    def __len__(self) -> int:
        return len(self.gravity) + len(self.touches)


@dataclass(frozen=True, eq=False)
class _Task:
    model: Model
    columns: tuple[int, ...]
    sets: GoalSets
    wrench_std: np.ndarray
    touch_std: float
    gravity: Pool
    touch: Pool
    goal: Goal
    scale: np.ndarray
    share: float
    criterion: Criterion

    def information(self, still: list[int], touch: list[int]) -> np.ndarray:
        seen = self.gravity.information(still) + self.touch.information(touch)
        return np.eye(len(self.scale)) + seen

    def covariance(self, still: list[int], touch: list[int]) -> np.ndarray:
        return np.linalg.inv(self.information(still, touch)) * np.outer(self.scale, self.scale)

    def assured(self, still: list[int], touch: list[int]) -> float:
        return self.goal.quantile(self.covariance(still, touch), self.share)

    def best(self, pool: Pool, information: np.ndarray, used: list[int]) -> tuple[int, float]:
        """The candidate that helps most, and the criterion with it."""
        slope = pool.slopes(self.criterion.gradient(information))
        slope[used] = -np.inf
        some = np.argsort(-slope)[:_SCREENED]
        value = self.criterion.changed(information, pool.blocks[some], 1.0)
        return int(some[np.argmax(value)]), float(value.max())


def reach(
    robot: Robot,
    accuracy: float,
    options: MixOptions | None = None,
    *,
    seed: int = 0,
    progress: Callable[[int], None] = lambda _: None,
    **changes: Any,
) -> Mix:
    """Plan few measurements after which the rms error in the target is below ``accuracy``.

    Greedy growth, exchange with one fewer as long as that suffices, then one more as long as a
    rehearsal of the nonlinear fit asks for it: a local optimum, not a proven minimum. Every
    candidate parameter of the robot and the sensor's bias are unknown within tolerance.

    Args:
        robot: with a tool tip and a target workspace.
        accuracy: wanted [m].
        options: what to choose from.
        seed: of the pool and the rehearsed robots.
        progress: called with the number of measurements as the plan grows.
        changes: fields of the options, by name.

    Raises:
        PlanError: a number makes no sense, or `_MOST` measurements are not enough.
        NotFoundError: the robot has no tool tip or target workspace.
    """
    o = replace(options or MixOptions(), **changes)
    if not accuracy > 0:
        raise PlanError(f"accuracy {accuracy} m must be above 0")
    task = _task(robot, robot.goal_sets(o.pool, o.points, seed), o.touch_std, o.share)
    _check_possible(task, accuracy)
    still: list[int] = []
    touch: list[int] = []
    while len(still) < o.least_poses:
        still.append(task.best(task.gravity, task.information(still, touch), still)[0])
    course = [(len(still), task.assured(still, touch))]
    while course[-1][1] > accuracy:
        if len(still) + len(touch) == _MOST:
            raise PlanError(
                f"{_MOST} measurements reach {1e3 * course[-1][1]:.3g} mm, not "
                f"{1e3 * accuracy:.3g} mm: touch more precisely, or other points"
            )
        _grow(task, still, touch, o.touch_cost)
        course.append((len(still) + len(touch), task.assured(still, touch)))
        progress(course[-1][0])
    still, touch = _pruned(task, still, touch, accuracy, o.least_poses)
    for _ in range(_ROUNDS):
        before, after = _rehearsed(task, still, touch, seed)
        progress(len(still) + len(touch))
        if np.quantile(after, o.share) <= accuracy:
            return _mix(robot, task, (still, touch), before, after, tuple(course))
        _grow(task, still, touch, o.touch_cost)
        still, touch = _exchanged(task, still, touch)
    raise PlanError(
        f"{len(still) + len(touch)} measurements still leave "
        f"{1e3 * np.quantile(after, o.share):.3g} mm when rehearsed, "
        f"not {1e3 * accuracy:.3g} mm: touch more precisely"
    )


def _rehearsed(
    task: _Task, still: list[int], touch: list[int], seed: int
) -> tuple[np.ndarray, np.ndarray]:
    measured = Measurements(
        task.sets.gravity[still],
        task.wrench_std,
        task.sets.touch[touch],
        task.sets.points[touch],
        task.touch_std,
    )
    return simulate_plan(task.model, task.columns, measured, task.sets.target, seed)


def _check_possible(task: _Task, accuracy: float) -> None:
    best = task.assured(list(range(len(task.gravity))), list(range(len(task.touch))))
    if best > accuracy:
        raise PlanError(
            f"all {len(task.gravity)} poses and {len(task.touch)} touches together reach "
            f"{1e3 * best:.3g} mm, not {1e3 * accuracy:.3g} mm: touch more precisely or elsewhere"
        )


def _grow(task: _Task, still: list[int], touch: list[int], touch_cost: float) -> None:
    """Add whatever lowers the logarithm of the mean square error most for its cost."""
    information = task.information(still, touch)
    now = float(task.criterion.values(information))
    pose, with_pose = task.best(task.gravity, information, still)
    seat, with_touch = task.best(task.touch, information, touch)
    if np.log(with_touch / now) / touch_cost >= np.log(with_pose / now):
        touch.append(seat)
    else:
        still.append(pose)


def _pruned(
    task: _Task, still: list[int], touch: list[int], accuracy: float, least: int
) -> tuple[list[int], list[int]]:
    """Fewer touches, then fewer poses, as long as the rest, exchanged, assures the accuracy."""
    while touch:
        trial = _exchanged(task, still, _without_least(task, task.touch, still, touch, touch))
        if task.assured(*trial) > accuracy:
            break
        still, touch = trial
    while len(still) > least:
        trial = _exchanged(task, _without_least(task, task.gravity, still, touch, still), touch)
        if task.assured(*trial) > accuracy:
            break
        still, touch = trial
    return still, touch


def _without_least(
    task: _Task, pool: Pool, still: list[int], touch: list[int], kind: list[int]
) -> list[int]:
    """Measurements of one kind without the one whose loss costs least."""
    without = task.criterion.changed(task.information(still, touch), pool.blocks[kind], -1.0)
    return [m for k, m in enumerate(kind) if k != int(np.argmax(without))]


def _exchanged(task: _Task, still: list[int], touch: list[int]) -> tuple[list[int], list[int]]:
    """Measurements with as many of each kind, exchanged in turns."""
    for _ in range(_TURNS):
        if touch:
            base = task.information(still, [])
            done = exchange(task.touch, task.criterion, len(touch), start=touch, prior=base)
            touch = [int(i) for i in done.chosen]
        if still:
            base = task.information([], touch)
            done = exchange(task.gravity, task.criterion, len(still), start=still, prior=base)
            still = [int(i) for i in done.chosen]
    return still, touch


def _task(robot: Robot, sets: GoalSets, touch_std: float, share: float) -> _Task:
    model = Model.of(robot)
    theta = model.parameters.nominal
    columns = model.parameters.select([*robot.candidates, "sensor.bias"])
    scale = model.parameters.tolerance[list(columns)]
    noise = registry.load("sensors", robot.sensor).noise
    slow = np.square(noise.flicker) * np.log(noise.f_high / noise.f_low)
    std = np.sqrt(np.square(noise.white) / SAMPLES + slow)
    gravity = model.jacobian(sets.gravity, theta, columns) / std[:, None]
    touch = tip_jacobian(robot, sets.touch, theta, columns) / touch_std
    goal = Goal(tip_jacobian(robot, sets.target, theta, columns))
    criterion = i_optimality(goal.weight * np.outer(scale, scale))
    pools = Pool(gravity * scale), Pool(touch * scale)
    return _Task(model, columns, sets, std, touch_std, *pools, goal, scale, share, criterion)


def _mix(
    robot: Robot,
    task: _Task,
    chosen: tuple[list[int], list[int]],
    before: np.ndarray,
    after: np.ndarray,
    course: tuple[tuple[int, float], ...],
) -> Mix:
    sets, (still, touch) = task.sets, chosen
    return Mix(
        gravity=Plan.of(robot.name, sets.gravity[still]),
        touches=Plan.of(robot.name, sets.touch[touch], points=sets.points[touch]),
        rms=float(np.sqrt(np.mean(after**2))),
        assured=float(np.quantile(after, task.share)),
        before=float(np.sqrt(np.mean(before**2))),
        share=task.share,
        course=course,
    )
