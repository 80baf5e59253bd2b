"""A diagnosis as one sees it: the robot painted by blame, and the residual before and after."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from wrenchbed import registry
from wrenchbed.diagnosis.diagnose import Findings
from wrenchbed.plan import Plan
from wrenchbed.report import numbers, words
from wrenchbed.report.evidence import Evidence
from wrenchbed.robots.base import SimulatedRobot
from wrenchbed.simulation import Simulation
from wrenchbed.viewer import heatmap, layout
from wrenchbed.viewer.blame import blame, painted, part_of
from wrenchbed.viewer.colours import NEXT, ghost
from wrenchbed.viewer.motion import Motion, motion
from wrenchbed.viewer.robot import log_pose, log_shapes, log_world
from wrenchbed.viewer.stream import Canvas, to_file
from wrenchbed.viewer.words import bar, log_words, readable

STAGE = "simulator"
"""Timeline whose steps are the simulators: as configured, calibrated, with the effects."""
MOST_NEXT = 5


def diagnosis_view(found: Findings, path: str | Path) -> None:
    """Write the view of a diagnosis.

    Raises:
        MissingExtraError: rerun is not installed.
    """
    told = found.diagnosis.to_json()
    robot = found.analysis.prepared.model.robot
    jointed = isinstance(robot, SimulatedRobot) and found.analysis.prepared.scene.jointed
    left = [layout.scene(robot.name, "robot, painted by blame")] if jointed else []
    blueprint = layout.page(
        [*left, layout.heat("residual / noise: move the slider")],
        [
            layout.document("/report", "answers"),
            layout.bars("/residual/gap", "gap of fx, fy, fz, tx, ty, tz"),
        ],
        [2.0, 1.0] if jointed else [1.0],
        timeline=STAGE,
    )
    with to_file(path, blueprint) as canvas:
        shares = blame(told)
        if jointed:
            assert isinstance(robot, SimulatedRobot)
            _log_robot(canvas, robot, found, shares)
        _log_stages(canvas, found)
        log_words(canvas, "report", answers(found, shares if jointed else {}))


def answers(found: Findings, shares: Mapping[str, float]) -> str:
    """The three answers and the ranked causes, in Markdown."""
    d = found.diagnosis
    rows = [f"# {words.headline(found)}", "", f"**{words.place(found)}**", ""]
    rows += [f"- {sentence}" for sentence in words.places(found)]
    rows += ["", "| candidate | probability | |", "|---|---|---|"]
    ranked = sorted(d.probabilities.items(), key=lambda item: -item[1])
    rows += [f"| {n} | {p:.2f} | {bar(p)} |" for n, p in ranked if p >= words.LARGE_P]
    gap = d.gap
    rows += ["", "| simulator | gap on sealed rows |", "|---|---|"]
    stages = (("as configured", gap.configured), ("calibrated", gap.calibrated),
              ("with the effects", gap.with_effects))  # fmt: skip
    rows += [f"| {name} | {numbers.gap(value)} |" for name, value in stages if value is not None]
    if shares:
        painted_parts = ", ".join(f"{part} {share:.2f}" for part, share in shares.items())
        rows += ["", f"Painted: {painted_parts}. Darker is more to blame, grey not at all."]
    if d.next:
        rows += ["", "**Next:**", *(f"- {step['sentence']}" for step in d.next)]
    if shares and _proposed(found) is not None:
        rows += ["", f"Teal: up to {MOST_NEXT} of the poses that were proposed."]
    return "\n".join(rows)


def _log_robot(
    canvas: Canvas, robot: SimulatedRobot, found: Findings, shares: Mapping[str, float]
) -> None:
    log_world(canvas)
    simulation = Simulation(robot, robot.parameters.nominal)
    model = simulation.model
    log_shapes(canvas, "world/real", model, painted(model, robot, shares))
    home = motion(simulation, robot.home[None])
    log_pose(canvas, "world/real", home)
    _log_label(canvas, model, robot, home, shares)
    plan = _proposed(found)
    if plan is not None:
        chosen = np.unique(np.linspace(0, len(plan) - 1, MOST_NEXT).astype(int))
        ahead = motion(simulation, plan.q[chosen])
        moving = [n for n in ahead.names if n != "world"]
        for k in range(len(chosen)):
            root = f"world/next/{k + 1}"
            log_shapes(canvas, root, model, ghost(NEXT), only=moving)
            log_pose(canvas, root, ahead, k)


def _proposed(found: Findings) -> Plan | None:
    """Poses that would tell more, if any."""
    plan = next(iter(found.plans.values()), None)
    return plan if plan is not None and plan.mode == "static" else None


def _log_label(
    canvas: Canvas, model: Any, robot: SimulatedRobot, home: Motion, shares: Mapping[str, float]
) -> None:
    """Names of the blamed parts where they are."""
    rr = registry.require("rerun", "view")
    parts = part_of(model, robot, shown_world=True)
    places, texts = [], []
    for part, share in sorted(shares.items(), key=lambda item: -item[1]):
        own = [g for g, names in parts.items() if part in names]
        bodies = [model.body(int(model.geom_bodyid[g])).name for g in own]
        known = [home.names.index(b) for b in bodies if b in home.names]
        if known:
            places.append(home.position[0, known[0]])
        else:
            places.append(np.array([0.0, 0.0, -0.05 - 0.08 * len(places)]))
        texts.append(f"{part} {share:.2f}")
    if places:
        shown = rr.Points3D(
            places,
            labels=[readable(x) for x in texts],
            radii=0.004,
            colors=(255, 255, 255),
            show_labels=True,
        )
        canvas.once("world/blame", shown)


def _log_stages(canvas: Canvas, found: Findings) -> None:
    """The residual of each simulator, on one slider."""
    rr = registry.require("rerun", "view")
    evidence = Evidence(found)
    p = evidence.prepared
    order = p.scene.t[p.scene.held] if p.moving else np.arange(len(p.y)) * 1.0
    canvas.once(
        "residual/map/labels", heatmap.labels(heatmap.ticks(order, "s" if p.moving else "pose"))
    )
    readings = evidence.stages()
    for k, (name, reading) in enumerate(readings.items()):
        white = (p.y - reading) / evidence.std
        shown = {
            "residual/map/cells": heatmap.cells(heatmap.binned(white, order)),
            "residual/map/name": heatmap.title(name),
            "residual/gap": rr.BarChart(np.mean(white**2, axis=0)),
        }
        canvas.step(STAGE, k, shown)
