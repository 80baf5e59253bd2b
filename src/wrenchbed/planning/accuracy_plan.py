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
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from wrenchbed import registry
from wrenchbed.calibration.fit_problem import Problem
from wrenchbed.calibration.observations import Observations
from wrenchbed.calibration.position_error import Goal, tip_jacobian
from wrenchbed.calibration.touch_points import Touches
from wrenchbed.data.plan import Plan
from wrenchbed.data.recording import TOUCH_STD
from wrenchbed.errors import PlanError
from wrenchbed.planning.criteria import Criterion, InverseTrace
from wrenchbed.planning.exchange import Pool, exchange
from wrenchbed.robots.base import GoalSets, Robot
from wrenchbed.simulation.closed_form import Model

ROBOTS = 100
"""Number of random robots on which a plan is rehearsed."""
SAMPLES = 100
"""Rows that are averaged at one pose under gravity."""
_STEP, _TRIES, _THERE = 1e-6, 20, 1e-8
_MOST, _SCREENED, _TURNS, _ROUNDS = 400, 256, 2, 20
_LEAST_POSES = 6
"""Fewest poses under gravity, which calibrate the sensor itself: the parameters of its load and
zero are ten, a pose reads six numbers."""
Chosen = tuple[list[int], list[int]]
"""Indices of the chosen gravity poses and of the chosen touches in their two pools."""


@dataclass(frozen=True, eq=False)
class Mix:
    """Plan of poses under gravity and touches of known points, with its accuracy in simulation.

    Attributes:
        gravity, touches: plans; either may have 0 rows.
        rms: root mean square position error in the target [m], over the simulated robots.
        assured: position error [m] that ``share`` of the simulated robots stay below.
        before: rms without any measurement [m].
    """

    gravity: Plan
    touches: Plan
    rms: float
    assured: float
    before: float
    share: ClassVar[float] = 0.99

    def __len__(self) -> int:
        return len(self.gravity) + len(self.touches)


@dataclass(frozen=True, eq=False)
class _Task:
    """Design problem of `reach`: candidate poses and touches of points, unknown parameters, target.

    Attributes:
        columns: indices of the unknown parameters (K,).
        wrench_std: standard deviation of a pose's mean wrench (6,) [N, N·m].
        touch_std: standard deviation of the tip's position at a touched point, per axis [m].
        pools: candidate poses, then touches: Jacobians of readings over noise, per ``scale``.
        scale: tolerances of the unknown parameters (K,).
    """

    model: Model
    columns: tuple[int, ...]
    sets: GoalSets
    wrench_std: np.ndarray
    touch_std: float
    pools: tuple[Pool, Pool]
    goal: Goal
    scale: np.ndarray
    criterion: Criterion

    def information(self, chosen: Chosen) -> np.ndarray:
        """Information matrix (K, K), per tolerances, of priors and measurements ``chosen``."""
        seen = [pool.information(some) for pool, some in zip(self.pools, chosen, strict=True)]
        return np.eye(len(self.scale)) + (seen[0] + seen[1])

    def assured(self, chosen: Chosen) -> float:
        """Position error [m] below which `Mix.share` of robots stay when calibrated on poses and
        touches of known points at indices ``chosen``."""
        covariance = np.linalg.inv(self.information(chosen)) * np.outer(self.scale, self.scale)
        return self.goal.quantile(covariance, Mix.share)

    def best(self, kind: int, information: np.ndarray, used: list[int]) -> tuple[int, float]:
        """Find the unused candidate of a kind (0 pose, 1 touch of a point) whose information raises
        the criterion most: its index, and the criterion with it added to ``information`` (K, K)."""
        pool = self.pools[kind]
        slope = pool.slopes(self.criterion.gradient(information))
        slope[used] = -np.inf
        some = np.argsort(-slope)[:_SCREENED]
        value = self.criterion.changed(information, pool.blocks[some], 1.0)
        return int(some[np.argmax(value)]), float(value.max())

    def grow(self, chosen: Chosen) -> None:
        """Add to ``chosen`` (indices of poses, of touches of points) the candidate that lowers the
        error most."""
        information = self.information(chosen)
        (pose, with_pose), (touch, with_touch) = (
            self.best(kind, information, chosen[kind]) for kind in (0, 1)
        )
        kind = int(with_touch >= with_pose)
        chosen[kind].append((pose, touch)[kind])

    def pruned(self, chosen: Chosen, accuracy: float) -> Chosen:
        """Drop touches of points, then poses, from those ``chosen`` (indices) while the others
        reach ``accuracy`` [m]; return what is kept."""
        for kind, least in ((1, 0), (0, _LEAST_POSES)):
            while len(chosen[kind]) > least:
                blocks = self.pools[kind].blocks[chosen[kind]]
                without = self.criterion.changed(self.information(chosen), blocks, -1.0)
                fewer = (list(chosen[0]), list(chosen[1]))
                del fewer[kind][int(np.argmax(without))]
                trial = self.exchanged(fewer)
                if self.assured(trial) > accuracy:
                    break
                chosen = trial
        return chosen

    def exchanged(self, chosen: Chosen) -> Chosen:
        """Improve ``chosen`` by swapping poses for other poses, touches of points for others."""
        for kind in (1, 0) * _TURNS:
            if not chosen[kind]:
                continue
            others: Chosen = (chosen[0], []) if kind else ([], chosen[1])
            done = exchange(
                self.pools[kind], self.criterion, len(chosen[kind]), start=chosen[kind],
                prior=self.information(others),
            )  # fmt: skip
            new = [int(i) for i in done.chosen]
            chosen = (chosen[0], new) if kind else (new, chosen[1])
        return chosen

    def rehearse(self, chosen: Chosen, seed: int) -> tuple[np.ndarray, np.ndarray]:
        """Simulate `ROBOTS` random robots that run the plan: rms tool errors (`ROBOTS`,) [m] in the
        target before and after calibration; a `PlanError` if one leaves its workspace."""
        results = [self._one(chosen, np.random.default_rng([seed, k])) for k in range(ROBOTS)]
        before, after = np.array(results).T
        if not np.isfinite(after).all():
            raise PlanError("a rehearsed robot leaves its workspace within its tolerances")
        return before, after

    def _one(self, chosen: Chosen, rng: np.random.Generator) -> tuple[float, float]:
        """Draw one robot within tolerances and calibrate it: rms tool error [m] of the nominal
        model and of the fitted one."""
        robot, nominal, free = self.model.robot, self.model.parameters.nominal, list(self.columns)
        truth, std, touch_std = nominal.copy(), self.wrench_std, self.touch_std
        truth[free] += rng.uniform(-1.0, 1.0, len(free)) * self.scale
        true, target = robot.robot_theta(truth), self.sets.target
        gravity, points = self.sets.gravity[chosen[0]], self.sets.points[chosen[1]]
        exact = self.model.predict(gravity, truth)
        wrench = exact + rng.standard_normal(exact.shape) * std
        tips = points + rng.normal(0.0, touch_std, points.shape)
        touches = Touches(_seated(robot, self.sets.touch[chosen[1]], tips, true), points, touch_std)
        rows, noise = np.ones(len(wrench)), np.diag(np.square(std))
        data = Observations(gravity, wrench, rows, noise, np.inf, "stated", rows, rows > 0)
        problem = Problem(
            self.model, data, nominal, self.columns, nominal[free], prior=True, touches=touches
        )

        def whiten(x: np.ndarray) -> np.ndarray:
            return x / (std if x.ndim == 2 else std[:, None])

        fitted = problem.at(problem.solve(whiten, problem.start).x)
        tip = robot.tool_pose(target, true)[1]
        errors = (robot.tool_pose(target, robot.robot_theta(x))[1] - tip for x in (nominal, fitted))
        before, after = (float(np.sqrt((e**2).sum(axis=-1).mean())) for e in errors)
        return before, after


def _seated(robot: Robot, q: np.ndarray, points: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Joint values (T, J), near q (T, J), that put the tool tip of a robot theta at points (T, 3)
    [m]."""
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


def reach(
    robot: Robot,
    accuracy: float,
    *,
    pool: int = 4000,
    points: np.ndarray | None = None,
    touch_std: float = TOUCH_STD,
    seed: int = 0,
    progress: Callable[[int], None] = lambda _: None,
) -> Mix:
    """Plan few measurements that bring the rms tool error in the target below ``accuracy`` [m].

    Measurements are poses under gravity and touches of known points. Greedy growth, exchange with
    one fewer as long as that suffices, then one more as long as a simulation of the nonlinear fit
    asks for it: a local optimum, not a proven minimum. Every candidate parameter of the robot and
    the sensor's bias are unknown within tolerance.

    Args:
        pool: number of candidate poses under gravity.
        points: known positions to touch (K, 3) [m]; the robot's default if None.
        touch_std: standard deviation of the tip's position at a point, per axis [m].
        progress: called with the number of measurements as the plan grows.

    Raises:
        PlanError: a number is out of its range, or `_MOST` measurements are not enough.
        NotFoundError: the robot has no tool tip or target workspace.
    """
    if not (accuracy > 0 and touch_std > 0):
        raise PlanError(f"accuracy {accuracy} m and touch std {touch_std} m must be above 0")
    if pool < _LEAST_POSES:
        raise PlanError(f"{_LEAST_POSES} poses cannot be chosen from a pool of {pool}")
    task = _task(robot, robot.goal_sets(pool, points, seed), touch_std)
    wanted, remedy = f"not {1e3 * accuracy:.3g} mm: touch more precisely", "or other points"
    every: Chosen = (list(range(len(task.pools[0]))), list(range(len(task.pools[1]))))
    best = task.assured(every)
    if best > accuracy:
        raise PlanError(
            f"all {len(every[0])} poses and {len(every[1])} touches together reach "
            f"{1e3 * best:.3g} mm, {wanted}, {remedy}"
        )
    chosen: Chosen = ([], [])
    while len(chosen[0]) < _LEAST_POSES:
        chosen[0].append(task.best(0, task.information(chosen), chosen[0])[0])
    while (assured := task.assured(chosen)) > accuracy:
        if (count := len(chosen[0]) + len(chosen[1])) == _MOST:
            reached = f"{_MOST} measurements reach {1e3 * assured:.3g} mm"
            raise PlanError(f"{reached}, {wanted}, {remedy}")
        task.grow(chosen)
        progress(count + 1)
    chosen = task.pruned(chosen, accuracy)
    for _ in range(_ROUNDS):
        before, after = task.rehearse(chosen, seed)
        assured = float(np.quantile(after, Mix.share))
        progress(len(chosen[0]) + len(chosen[1]))
        if assured <= accuracy:
            still, touch = chosen
            return Mix(
                gravity=Plan.of(robot.name, task.sets.gravity[still]),
                touches=Plan.of(robot.name, task.sets.touch[touch], points=task.sets.points[touch]),
                rms=float(np.sqrt(np.mean(after**2))),
                assured=assured,
                before=float(np.sqrt(np.mean(before**2))),
            )
        task.grow(chosen)
        chosen = task.exchanged(chosen)
    raise PlanError(
        f"{len(chosen[0]) + len(chosen[1])} measurements still leave {1e3 * assured:.3g} mm when "
        f"rehearsed, {wanted}"
    )


def _task(robot: Robot, sets: GoalSets, touch_std: float) -> _Task:
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
    criterion = InverseTrace(goal.weight * np.outer(scale, scale))
    pools = Pool(gravity * scale), Pool(touch * scale)
    return _Task(model, columns, sets, std, touch_std, pools, goal, scale, criterion)
