"""The picture of a diagnosis: parts coloured by their probability, and the answers in words."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import mujoco

from wrenchbed.diagnosis.diagnose import Findings
from wrenchbed.diagnosis.gap.result import named_by
from wrenchbed.pages import numbers
from wrenchbed.pages.document import markdown, provenance
from wrenchbed.reports.claim import Claim, joints, joints_or
from wrenchbed.reports.wrench_answer import WrenchAnswer
from wrenchbed.robots.base import Robot, SimulatedRobot
from wrenchbed.simulation.simulation import Simulation
from wrenchbed.viewer import stream
from wrenchbed.viewer.elements import heat
from wrenchbed.viewer.robot import log_pose, log_shapes, log_world, motion
from wrenchbed.viewer.stream import Canvas, log_words, to_file


def blame(diagnosis: Mapping[str, Any]) -> dict[str, float]:
    """Posterior share (0 … 1) of each part, from a diagnosis as the contract has it.

    Joints that a cause names have their own part, ``joint 2``. Rivals share what their class has.
    """
    shares: dict[str, float] = {}
    known = diagnosis["probabilities"]
    for cause in diagnosis["which"]:
        names = named_by(cause)
        weights = [max(float(known.get(n, 0.0)), 1e-9) for n in names]
        for name, weight in zip(names, weights, strict=True):
            share = float(cause["probability"]) * weight / sum(weights)
            part = str(name).split(".")[0]
            blamed = joints(cause) if part in ("joint", "link") and name == names[0] else []
            if len(blamed) > 1 and joints_or(cause):
                share /= len(blamed)  # one of them
            for place in [f"{part} {k}" for k in blamed] or [part]:
                shares[place] = min(1.0, shares.get(place, 0.0) + share)
    return shares


def painted(
    model: mujoco.MjModel, robot: Robot, shares: Mapping[str, float]
) -> dict[int, tuple[int, ...]]:
    """Colour of each geom of the robot by its number: that of its part with the largest share."""
    return {
        g: tuple(int(c) for c in heat(max(shares.get(n, 0.0) for n in names)))
        for g, names in part_of(model, robot, "environment" in shares).items()
    }


def part_of(model: mujoco.MjModel, robot: Robot, shown_world: bool) -> dict[int, Sequence[str]]:
    """Names of the parts that each geom of the robot shows, by its number; with ``shown_world``
    also bench and floor.

    A geom without a name belongs to the named one before it in the same body.
    """
    carried, tool = _carriers(model, robot), int(model.body("tool").id)
    bodies = {model.geom(g).name: int(b) for g, b in enumerate(model.geom_bodyid)}
    sensor = bodies.get("sensor", tool)
    parts: dict[int, Sequence[str]] = {}
    name, before = "", -1
    for g, body in enumerate(map(int, model.geom_bodyid)):
        name = model.geom(g).name or (name if body == before else "")
        before = body
        if body == 0:
            parts |= {g: ("environment",)} if shown_world else {}
        elif body not in (sensor, tool):
            parts[g] = carried[body]
        elif name.startswith("sensor_cable"):
            parts[g] = ("cable",)
        elif name == "sensor_rim":
            parts[g] = ("mount", "sensor")
        else:
            parts[g] = ("sensor",) if body != tool or name.startswith("sensor") else ("tool",)
    return parts


def _carriers(model: mujoco.MjModel, robot: Robot) -> dict[int, Sequence[str]]:
    """For each body the parts that it shows: its joint and link if an actuated joint moves it, else
    its link."""
    number = {int(model.joint(j.name).bodyid[0]): k for k, j in enumerate(robot.joints, start=1)}
    parts: dict[int, Sequence[str]] = {}
    for b in range(1, model.nbody):
        if b in number:
            parts[b] = (f"joint {number[b]}", "joint", f"link {number[b]}", "link")
        else:
            parts[b] = ("link",) if int(model.body_parentid[b]) in parts else ("base",)
    return parts


def diagnosis_view(findings: Findings, path: str | Path, command: str = "") -> None:
    """Write the view of a diagnosis, with the command that made it.

    Raises:
        MissingExtraError: rerun is not installed.
    """
    robot = findings.analysis.prepared.model.robot
    jointed = isinstance(robot, SimulatedRobot) and findings.analysis.prepared.scene.jointed
    scene = stream.scene(robot.name, "robot, painted by blame") if jointed else None
    words = [stream.document("/report", "answers")]
    with to_file(path, stream.page(scene, words, timeline=None)) as canvas:
        shares = blame(findings.diagnosis.to_json()) if jointed else {}
        if jointed and isinstance(robot, SimulatedRobot):
            _log_robot(canvas, robot, shares)
        log_words(canvas, "report", answers(findings, shares, command))


def answers(findings: Findings, shares: Mapping[str, float], command: str = "") -> str:
    """The three answers in Markdown, in the words of the page, which has the tables."""
    d, words = findings.diagnosis, WrenchAnswer(findings)
    rows = [f"# {d.verdict}: {words.headline}", ""]
    rows += [f"- set aside: {sentence}" for sentence in words.aside]
    rows += ["", f"**{words.place}**", "", *(f"- {sentence}" for sentence in words.where)]
    rows += ["", *(_claimed(c) for c in words.causes)] if words.causes else ["", words.no_cause]
    rows += ["", words.leading, "", words.distance, ""]
    rows += [f"- {name} {gap}" for name, gap in words.bars]
    if shares:
        colours = ", ".join(f"{part} {numbers.chance(p)}" for part, p in shares.items())
        rows += ["", f"Painted by probability: {colours}. Grey: not named."]
    for title, lines in (
        ("Detected, below what counts", words.minor),
        ("What this recording cannot tell", d.cannot_tell),
        ("What to do next", words.steps),
        ("Notes", d.notes),
    ):
        rows += ["", f"**{title}**", "", *(f"- {line}" for line in lines)] if lines else []
    names = (d.recording, *d.others)
    return "\n".join([*rows, *markdown(provenance(names, command, findings.seed))])


def _claimed(c: Claim) -> str:
    """Markdown of a cause: its probability and all its parameters."""
    sizes = (f"{size.name} {size.value}" for size in c.sizes)
    return f"- {c.names} {c.probability}: {', '.join([text for _, text in c.choices] + [*sizes])}"


def _log_robot(canvas: Canvas, robot: SimulatedRobot, shares: Mapping[str, float]) -> None:
    """Log the robot at home, coloured by the parts' shares."""
    log_world(canvas)
    simulation = Simulation(robot, robot.parameters.nominal)
    model = simulation.model
    log_shapes(canvas, "world/real", model, painted(model, robot, shares))
    log_pose(canvas, "world/real", motion(simulation, robot.home[None]))
