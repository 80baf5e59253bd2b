"""The picture of a diagnosis: parts coloured by their probability, and the answers in words."""

from collections.abc import Mapping
from pathlib import Path

from wrenchbed.diagnosis.diagnose import Findings
from wrenchbed.pages import numbers
from wrenchbed.pages.document import markdown, provenance
from wrenchbed.reports.claim import Claim
from wrenchbed.reports.robot_scene import blame, painted
from wrenchbed.reports.wrench_answer import WrenchAnswer
from wrenchbed.robots.base import SimulatedRobot
from wrenchbed.simulation.shapes import motion
from wrenchbed.simulation.simulation import Simulation
from wrenchbed.viewer import stream
from wrenchbed.viewer.robot import log_pose, log_shapes, log_world
from wrenchbed.viewer.stream import log_words, to_file


def diagnosis_view(findings: Findings, path: str | Path, command: str = "") -> None:
    """Write the view of a diagnosis, with the command that made it; a `MissingExtraError` if rerun
    is not installed."""
    robot = findings.analysis.prepared.model.robot
    jointed = isinstance(robot, SimulatedRobot) and findings.analysis.prepared.scene.jointed
    scene = stream.scene(robot.name, "robot, painted by blame") if jointed else None
    words = [stream.document("/report", "answers")]
    with to_file(path, stream.page(scene, words, timeline=None)) as canvas:
        shares = blame(findings.diagnosis.to_json()) if jointed else {}
        if jointed and isinstance(robot, SimulatedRobot):
            log_world(canvas)
            simulation = Simulation(robot, robot.parameters.nominal)
            log_shapes(canvas, "world/real", simulation.model, painted(simulation, shares))
            log_pose(canvas, "world/real", motion(simulation, robot.home[None]))
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
