"""Moves of a run and limits of a live robot: all is checked before the first move.

Limits that nobody gave are derived from plan, sensor and tool. Workspace: the box around the path
of the sensor through the plan, from where the robot is, plus `MARGIN_M`. Force and torque: half way
between what tool and present zero of the sensor add up to, and the end of the sensor's range.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from wrenchbed.data.plan import Plan
from wrenchbed.errors import LimitError, PlanError
from wrenchbed.hardware.drivers.base import Driver
from wrenchbed.physics.wrench import weight
from wrenchbed.planning.collisions import clearance
from wrenchbed.robots.base import Robot, SimulatedRobot
from wrenchbed.robots.checked_moves import Limits, duration, entered, straight

MARGIN_M = 0.05
"""Added to each side of the box around the plan [m]: smaller stops moves that swing around it;
larger lets the arm leave the region that somebody looked at."""
GIVEN = "given"
_HALVES = (("force", "N", slice(0, 3)), ("torque", "N·m", slice(3, 6)))


@dataclass(frozen=True, eq=False)
class Leg:
    """Straight joint-space moves from one pose of a plan to the next one visited.

    Attributes:
        row: number of the target pose's row in the plan.
        via: joint values (J,) to go through in straight lines; the last are the target pose's.
        seconds: duration of all its moves at the driver's speed.
    """

    row: int
    via: tuple[np.ndarray, ...]
    seconds: float


def check(driver: Driver, plan: Plan, rate: float, *, clear: bool) -> None:
    """Raise a `PlanError`, which names the row, if the robot cannot run a plan at ``rate`` [Hz],
    with ``clear`` also if a row of a motion touches something; move nothing."""
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
    start = entered(robot, straight(driver.position(), plan.q[0]))
    robot.check(start, robot.parameters.nominal, f"{plan.name}: move to row 0")
    if clear and isinstance(robot, SimulatedRobot):
        for row, q in enumerate(plan.q):
            what = clearance(robot).hit(q)
            if what:
                raise PlanError(f"{plan.name}: row {row}: {what}")


def itinerary(
    robot: Robot, plan: Plan, start: np.ndarray, limits: Limits, rows: Sequence[int], *, clear: bool
) -> tuple[Leg, ...]:
    """Plan moves that visit rows of a static plan in this order, from ``start`` (J,) on.

    If ``clear`` they touch neither the robot itself nor its surroundings: a straight move that is
    blocked is replaced by one around the obstacle. A `PlanError`, which names the row, if a pose or
    every path to it is out of reach or blocked.
    """
    among = clearance(robot) if clear and isinstance(robot, SimulatedRobot) else None
    legs, here = [], np.asarray(start, dtype=float)
    for row in rows:
        where = f"{plan.name}: row {row}"
        q = plan.q[row]
        via = [q] if among is None else among.path(here, q, where)
        seconds = 0.0
        for end in via:
            path = entered(robot, straight(here, end))
            if bad := robot.infeasible(path, robot.parameters.nominal):
                why = next(iter(bad.values()))
                raise PlanError(f"{where}: on the straight way to this pose {why}")
            limits.check_path(robot, path, f"{where}: on the way to this pose")
            seconds += duration(robot, here, end, limits.speed)
            here = end
        legs.append(Leg(row, tuple(via), seconds))
    return tuple(legs)


@dataclass(frozen=True)
class LiveLimits:
    """Limits of every motion of a live robot, none missing; ``workspace``, ``force`` and ``torque``
    each with a text on its origin (given, or derived from what)."""

    limits: Limits
    origin: Mapping[str, str]

    def to_json(self) -> dict[str, Any]:
        """Limits as JSON, in the form of a recording's metadata."""
        limits, box = self.limits, self.limits.workspace
        assert box is not None
        return {
            "workspace": [*map(float, box[0]), *map(float, box[1])], "max_force": limits.force,
            "max_torque": limits.torque, "speed": limits.speed,
            "derived": [name for name, words in self.origin.items() if words != GIVEN],
        }  # fmt: skip


def live_limits(driver: Driver, plan: Plan, *, clear: bool = True) -> LiveLimits:
    """Return the limits of a connected driver; those not given are derived for a plan, without
    motion. If ``clear``, moves lead around obstacles. A `PlanError` if the robot cannot run the
    plan, a `LimitError` if the sensor reads too much at rest for any limit within its range."""
    limits, origin = driver.limits, dict.fromkeys(("workspace", "force", "torque"), GIVEN)
    if limits.workspace is None:
        limits = replace(limits, workspace=_box(driver, plan, clear))
        origin["workspace"] = f"plan and {MARGIN_M:g} m around"
    missing = {name: getattr(limits, name) is None for name, _, _ in _HALVES}
    if any(missing.values()):
        for name, (value, words) in _loads(driver, missing).items():
            limits = replace(limits, **{name: value})  # type: ignore[arg-type]
            origin[name] = words
    return LiveLimits(limits, origin)


def _box(
    driver: Driver, plan: Plan, clear: bool
) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Lower and upper corner [m] of the box around the sensor's path through the plan and back to
    its first pose, with `MARGIN_M` on all sides; with ``clear`` the path leads around obstacles."""
    robot, here = driver.robot, driver.read().q
    rows = [*range(len(plan)), 0] if plan.mode == "static" else [0]
    legs = itinerary(robot, plan, here, driver.limits, rows, clear=clear)
    way = [] if plan.mode == "static" else [plan.q]
    for end in (q for leg in legs for q in leg.via):
        way.append(straight(here, end))
        here = end
    _, at = robot.sensor_pose(np.concatenate(way), robot.parameters.nominal)
    lower, upper = at.min(axis=0) - MARGIN_M, at.max(axis=0) + MARGIN_M
    return (
        (float(lower[0]), float(lower[1]), float(lower[2])),
        (float(upper[0]), float(upper[1]), float(upper[2])),
    )


def _loads(driver: Driver, missing: Mapping[str, bool]) -> dict[str, tuple[float, str]]:
    """``force`` [N] and ``torque`` [N·m], where ``missing``: their derived limits, each with a text
    on its origin."""
    robot, loads = driver.robot, {}
    theta, gravity = robot.parameters.nominal, np.asarray(robot.gravity)
    tool, q = robot.tool(theta), driver.read().q[None]
    zero = driver.read_wrench().wrench - weight(robot.gravity_seen(q, theta, gravity), tool)[0]
    heavy = float(tool.mass) * float(np.linalg.norm(gravity))
    most = {"force": heavy, "torque": heavy * float(np.linalg.norm(tool.cog))}
    for name, unit, half in _HALVES:
        if not missing[name]:
            continue
        load = most[name] + float(np.linalg.norm(zero[half]))
        end = float(driver.full_scale()[half].min())
        if load >= end:
            raise LimitError(
                f"the sensor reads up to {load:.3g} {unit} with the tool in other orientations, "
                f"and its range ends at {end:g} {unit}: set its zero, or give --max-{name}"
            )
        words = f"mean of {load:.3g} {unit} (tool, zero) and {end:g} {unit} (range)"
        loads[name] = (0.5 * (load + end), words)
    return loads
