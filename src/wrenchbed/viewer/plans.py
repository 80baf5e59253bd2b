"""The view of a plan before any robot moves: its poses, the way through them, what to expect."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rerun as rr

from wrenchbed import registry
from wrenchbed.campaigns.moves import Leg, itinerary
from wrenchbed.data.plan import Plan
from wrenchbed.errors import ParameterError, PlanError
from wrenchbed.robots.base import SimulatedRobot
from wrenchbed.robots.checked_moves import Limits, duration, minimum_jerk
from wrenchbed.simulation.closed_form import Model
from wrenchbed.simulation.mujoco_wrench import Simulation
from wrenchbed.simulation.triangle_meshes import motion
from wrenchbed.viewer import rerun_canvas
from wrenchbed.viewer.elements import SIMULATED, log_arrows, log_channels, log_joints, scale_for
from wrenchbed.viewer.rerun_canvas import ROW, TIME, log_words, to_file
from wrenchbed.viewer.robot import FRAMES_HZ, frames, log_robot

STAY_S = 1.0
"""Time shown at a pose whose plan leaves the duration of the rest to the recorder [s]."""
WAY = (13, 148, 136)
"""Teal: the path of the sensor."""
_DOT_M, _LINE_M = 0.008, 0.0015


def plan_view(plan: Plan, path: str | Path) -> None:
    """Write a plan as a picture for the viewer rerun (``.rrd``). Poses are reached from home as a
    recording run would; for a plan that cannot be run the poses are shown one after the other, with
    the reason. A `ParameterError` if the robot has no model, a `MissingExtraError` without
    rerun."""
    robot = registry.load("robots", plan.robot)
    if not isinstance(robot, SimulatedRobot):
        raise ParameterError(f"{plan.name}: robot {plan.robot!r} has no model to show")
    axis, q, at, blocked = _course(robot, plan)
    model = Model.of(robot)
    expected = model.predict(q, model.parameters.nominal)
    shown = frames(q, at if axis == TIME else None)
    simulation = Simulation(robot, robot.parameters.nominal)
    seen, scale = motion(simulation, q[shown]), scale_for(expected)
    tabs = [
        rerun_canvas.channels("expected at rest", (axis, at)),
        rerun_canvas.curves("/joints", "joints [°, mm]", window=(axis, at)),
        rerun_canvas.document("/report", "about"),
    ]
    page = rerun_canvas.page(rerun_canvas.scene(robot.name), tabs, axis)
    with to_file(path, page, axis) as canvas:
        log_robot(canvas, robot, at[shown], seen)
        log_arrows(canvas, "simulated", at[shown], expected[shown], seen, scale, SIMULATED)
        log_channels(canvas, "wrench", at, {"nominal robot and tool": expected}, [SIMULATED])
        log_joints(canvas, at, q, robot.joints)
        canvas.once("world/way", rr.LineStrips3D([seen.sensor], colors=WAY, radii=_LINE_M))
        if plan.mode == "static":
            rests = motion(simulation, plan.q).sensor
            canvas.once("world/poses", rr.Points3D(rests, colors=WAY, radii=_DOT_M))
        if plan.points is not None:
            touches = rr.Points3D(plan.points, colors=SIMULATED, radii=_DOT_M)
            canvas.once("world/touches", touches)
        log_words(canvas, "report", _words(plan, at, blocked, scale.sentence))


def _course(robot: SimulatedRobot, plan: Plan) -> tuple[str, np.ndarray, np.ndarray, str]:
    """Timeline's name, joint values (K, J), times [s] or rows (K,) of a plan; why it cannot run, or
    ""."""
    if plan.mode == "dynamic":
        assert plan.rate_hz is not None  # `Plan` holds it
        return TIME, plan.q, np.arange(len(plan)) / plan.rate_hz, ""
    limits = Limits()
    try:
        legs = itinerary(robot, plan, robot.home, limits, range(len(plan)), clear=True)
    except PlanError as error:
        return ROW, plan.q, np.arange(float(len(plan))), str(error)
    return TIME, *along(robot, legs, plan.dwell, limits.speed), ""


def along(
    robot: SimulatedRobot, legs: Sequence[Leg], dwell: np.ndarray, speed: float
) -> tuple[np.ndarray, np.ndarray]:
    """Joint values (K, J), times (K,) [s] of a recording run from home along ``legs``: moves at a
    fraction ``speed`` of top speed, a stay at each pose (``dwell`` by row of the plan [s]; `STAY_S`
    where it is 0)."""
    here, now = np.asarray(robot.home, dtype=float), 0.0
    q, at = [here], [now]
    for leg in legs:
        for end in leg.via:
            seconds = duration(robot, here, end, speed)
            steps = np.linspace(0.0, 1.0, 1 + max(1, round(seconds * FRAMES_HZ)))[1:]
            q += [*(here + minimum_jerk(steps[:-1])[:, None] * (end - here)), end]
            at += list(now + seconds * steps)
            here, now = end, now + seconds
        now += float(dwell[leg.row]) or STAY_S
        q.append(here)
        at.append(now)
    return np.array(q), np.array(at)


def _words(plan: Plan, at: np.ndarray, blocked: str, scale: str) -> str:
    kind = "a motion" if plan.mode == "dynamic" else f"{len(plan)} poses"
    if plan.points is not None:
        kind = f"{len(plan)} touches of known points"
    rows = [f"# {plan.name}", "", f"Robot **{plan.robot}**, {kind}."]
    if blocked:
        rows += ["", f"**It cannot be run**: {blocked}. Poses are shown in turn, without a way."]
    elif plan.mode == "static":
        rows += ["", f"The way from home takes {at[-1]:.0f} s with {STAY_S:g} s at each pose; "
                 "it is within reach and touches nothing that the model holds."]  # fmt: skip
    else:
        rows += ["", f"It lasts {at[-1]:.0f} s at {plan.rate_hz:g} Hz."]
    rows += [
        "", "Teal is the sensor's way and where it rests. Arrows and curves are what nominal "
        f"parameters and the model's own tool weigh at rest: {scale}.",
    ]  # fmt: skip
    return "\n".join(rows)
