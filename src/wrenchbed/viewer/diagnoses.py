"""The picture of a diagnosis: parts coloured by their probability, and the answers in words."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from wrenchbed.diagnosis.diagnose import Findings
from wrenchbed.pages import numbers
from wrenchbed.pages.document import markdown, provenance
from wrenchbed.reports.compared_readings import HeldOutReadings
from wrenchbed.reports.robot_scene import blame, wrench_scene
from wrenchbed.reports.wrench_answer import WrenchAnswer
from wrenchbed.viewer import rerun_canvas
from wrenchbed.viewer.elements import ROLES, log_curves
from wrenchbed.viewer.rerun_canvas import ROW, log_words, to_file
from wrenchbed.viewer.robot import log_scene


def diagnosis_view(findings: Findings, path: str | Path, command: str = "") -> None:
    """Write a diagnosis as a picture for the viewer rerun (``.rrd``); ``command``, the command line
    that made it, is stated in it."""
    readings, view, axis = HeldOutReadings(findings), None, None
    scene, shares = wrench_scene(readings), dict[str, float]()
    if scene is not None:
        shares, axis = blame(findings.diagnosis.to_json()), ROW
        places = scene.frames[..., 3].reshape(-1, 3)
        view = rerun_canvas.blamed(findings.diagnosis.robot, readings.ids, places)
    page = rerun_canvas.page(view, [rerun_canvas.document("/report", "answers")], axis)
    with to_file(path, page, ROW) as canvas:
        if scene is not None:
            log_scene(canvas, scene)
            rms = {n: np.sqrt((x**2).mean(axis=1)) for n, x in readings.residuals.items()}
            y, colours = np.stack([*rms.values()], axis=1), (ROLES["before"], ROLES["after"])
            log_curves(canvas, "residual", readings.ids, y, list(rms), colours)
        log_words(canvas, "report", answers(findings, shares, command))


def answers(findings: Findings, shares: Mapping[str, float], command: str = "") -> str:
    """Markdown of a diagnosis; ``shares``: part of the robot → probability that it is to blame."""
    d, words = findings.diagnosis, WrenchAnswer(findings)
    rows = [f"# {d.verdict}: {words.headline}", ""]
    rows += [f"- set aside: {o['sentence']}" for o in d.outliers]
    rows += ["", f"**{words.place}**", "", *(f"- {sentence}" for sentence in words.where)]
    rows += ["", *([] if words.causes else [words.no_cause])]
    for c in words.causes:
        texts = [text for _, text in c.choices] + [f"{size.name} {size.value}" for size in c.sizes]
        rows.append(f"- {c.names} {c.probability}: {', '.join(texts)}")
    bars = (f"- {name} {gap}" for name, gap in words.bars)
    rows += ["", words.leading, "", words.distance, "", *bars]
    if shares:
        colours = ", ".join(f"{part} {numbers.chance(p)}" for part, p in shares.items())
        rows += ["", f"Painted by probability: {colours}. Grey: not named."]
    for title, lines in (
        ("Detected, below what counts", words.minor),
        ("What this recording cannot tell", d.cannot_tell),
        ("What to do next", words.steps),
        ("What this recording could not have shown", words.blind),
        ("Notes", words.notes),
    ):
        rows += ["", f"**{title}**", "", *(f"- {line}" for line in lines)] if lines else []
    origin = provenance((d.recording, *d.others), command, findings.seed)
    return "\n".join([*rows, *markdown(origin)])
