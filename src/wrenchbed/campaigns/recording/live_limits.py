"""Limits of a live robot before it moves: what nobody gave follows from plan, sensor and tool.

Workspace: the box around the sensor's way through the plan, from where the robot is, and
`MARGIN_M` more. Force and torque: half way from what the tool and the present zero of the sensor
add up to, to the end of the sensor's range.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from wrenchbed.campaigns.recording.itinerary import itinerary
from wrenchbed.data.plan import Plan
from wrenchbed.errors import LimitError
from wrenchbed.hardware.drivers.base import Driver
from wrenchbed.physics.wrench import weight
from wrenchbed.robots.motion_limits import Limits, straight

MARGIN_M = 0.05
"""Added to each side of the box around the plan [m]: smaller stops moves that swing around it;
larger lets the arm leave the region that somebody looked at."""
GIVEN = "given"
_HALVES = (("force", "N", slice(0, 3)), ("torque", "N·m", slice(3, 6)))


@dataclass(frozen=True)
class LiveLimits:
    """Limits that are complete.

    Attributes:
        limits: of every motion.
        origin: where ``workspace``, ``force`` and ``torque`` come from, in words.
    """

    limits: Limits
    origin: Mapping[str, str]

    def to_json(self) -> dict[str, Any]:
        """Limits as a recording's metadata state them."""
        limits, box = self.limits, self.limits.workspace
        assert box is not None
        return {
            "workspace": [*map(float, box[0]), *map(float, box[1])], "max_force": limits.force,
            "max_torque": limits.torque, "speed": limits.speed,
            "derived": [name for name, words in self.origin.items() if words != GIVEN],
        }  # fmt: skip


def live_limits(driver: Driver, plan: Plan, *, clear: bool = True) -> LiveLimits:
    """The driver's limits, and those that it lacks worked out for a plan.

    Args:
        driver: connected; it does not move.
        plan: that it will run.
        clear: whether its moves lead around obstacles.

    Raises:
        PlanError: the robot cannot run the plan.
        LimitError: the sensor reads too much at rest for any limit within its range.
    """
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
    """Around the sensor's way through the plan and back to its first pose."""
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
    """Limits of force [N] and torque [N·m] that are missing, and their origin."""
    robot, loads = driver.robot, {}
    theta, gravity = robot.parameters.nominal, np.asarray(robot.gravity)
    tool, q = robot.tool(theta), driver.read().q[None]
    zero = driver.read_wrench().wrench - weight(robot.gravity_seen(q, theta, gravity), tool)[0]
    heavy = float(tool.mass) * float(np.linalg.norm(gravity))
    most = {"force": heavy, "torque": heavy * float(np.linalg.norm(tool.cog))}
    full_scale = driver.full_scale()
    for name, unit, half in _HALVES:
        if not missing[name]:
            continue
        load = most[name] + float(np.linalg.norm(zero[half]))
        end = float(full_scale[half].min())
        if load >= end:
            raise LimitError(
                f"the sensor reads up to {load:.3g} {unit} with the tool in other orientations, "
                f"and its range ends at {end:g} {unit}: set its zero, or give --max-{name}"
            )
        words = f"mean of {load:.3g} {unit} (tool, zero) and {end:g} {unit} (range)"
        loads[name] = (0.5 * (load + end), words)
    return loads
