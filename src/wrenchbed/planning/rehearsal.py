"""A plan simulated in closed form on robots whose every parameter is wrong within tolerance.

The design of a mix is linear about the nominal robot; robots are not. The simulation has noise and
the full nonlinear fit, and gives the accuracy that the plan really reaches.
"""

from dataclasses import dataclass

import numpy as np

from wrenchbed.calibration.observations import Observations
from wrenchbed.calibration.problem import Problem
from wrenchbed.calibration.touches import Touches
from wrenchbed.errors import PlanError
from wrenchbed.robots.base import Robot
from wrenchbed.simulation.closed_form import Model

ROBOTS = 100
_STEP, _TRIES, _THERE = 1e-6, 20, 1e-8


@dataclass(frozen=True, eq=False)
class Measurements:
    """What is measured: poses under gravity and touches, and how well.

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
    data = Observations(measured.gravity, wrench, rows, noise, np.inf, "stated", rows, 0)
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
