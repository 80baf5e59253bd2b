"""The moves of a run: every row and every move between poses is checked before the first one."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrenchbed.data.plan import Plan
from wrenchbed.errors import PlanError
from wrenchbed.hardware.drivers.base import Driver
from wrenchbed.planning.clearance import clearance
from wrenchbed.robots.base import Robot, SimulatedRobot
from wrenchbed.robots.motion_limits import Limits, duration, straight


@dataclass(frozen=True, eq=False)
class Leg:
    """Moves that reach a pose.

    Attributes:
        row: of the plan.
        via: joint values (J,) to go through in straight lines; the last are the pose's own.
        seconds: of all its moves at the driver's speed.
    """

    row: int
    via: tuple[np.ndarray, ...]
    seconds: float


def check(driver: Driver, plan: Plan, rate: float, *, clear: bool) -> None:
    """Refuse a plan that the robot cannot run, before it moves.

    Raises:
        PlanError: names the row.
    """
    robot = driver.robot
    if plan.robot != robot.name:
        raise PlanError(f"{plan.name}: the plan is for robot {plan.robot!r}, not {robot.name!r}")
    if plan.points is not None and type(driver)._touch is Driver._touch:
        raise PlanError(
            f"{plan.name}: holds touches, and driver {driver.name!r} cannot touch points: "
            "run this plan with 'sim'"
        )
    if rate > driver.top_rate:
        raise PlanError(
            f"{plan.name}: rate {rate:g} Hz: driver {driver.name!r} tells {driver.top_rate:g} "
            "states a second at most: give a lower rate"
        )
    driver.limits.check_path(robot, plan.q, plan.name)
    if plan.mode == "static":
        return
    driver.limits.check_motion(robot, plan.q, rate, plan.name)
    start = straight(driver.position(), plan.q[0])
    robot.check(start, robot.parameters.nominal, f"{plan.name}: move to row 0")
    if clear and isinstance(robot, SimulatedRobot):
        for row, q in enumerate(plan.q):
            what = clearance(robot).hit(q)
            if what:
                raise PlanError(f"{plan.name}: row {row}: {what}")


def itinerary(
    robot: Robot,
    plan: Plan,
    start: np.ndarray,
    limits: Limits,
    rows: Sequence[int],
    *,
    clear: bool,
) -> tuple[Leg, ...]:
    """Moves that visit some rows of a plan in order, from joint values (J,) on.

    Args:
        robot: of the plan.
        plan: static.
        start: where the robot is.
        limits: joint speed and workspace.
        rows: of the plan, in the order of the visit.
        clear: whether moves must not touch the robot itself or its surroundings; then a blocked
            straight move is replaced by one around the obstacle.

    Raises:
        PlanError: a pose or every path to it is out of reach or blocked; names the row.
    """
    among = clearance(robot) if clear and isinstance(robot, SimulatedRobot) else None
    legs, here = [], np.asarray(start, dtype=float)
    for row in rows:
        where = f"{plan.name}: row {row}"
        q = plan.q[row]
        via = [q] if among is None else among.way(here, q, where)
        seconds = 0.0
        for end in via:
            _check(robot, limits, here, end, where)
            seconds += duration(robot, here, end, limits.speed)
            here = end
        legs.append(Leg(row, tuple(via), seconds))
    return tuple(legs)


def _check(robot: Robot, limits: Limits, start: np.ndarray, end: np.ndarray, where: str) -> None:
    path = straight(start, end)
    bad = robot.infeasible(path, robot.parameters.nominal)
    if bad:
        raise PlanError(f"{where}: on the straight way to this pose {next(iter(bad.values()))}")
    limits.check_path(robot, path, f"{where}: on the way to this pose")
