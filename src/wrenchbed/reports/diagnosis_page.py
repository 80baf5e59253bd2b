"""The report of a diagnosis, of a wrench or of joint efforts, as one HTML page."""

import shlex
from collections.abc import Mapping
from pathlib import PurePath
from typing import Any

from wrenchbed import registry
from wrenchbed.data.recording import Recording
from wrenchbed.diagnosis.diagnose import Findings
from wrenchbed.diagnosis.efforts.diagnose_efforts import EffortFindings
from wrenchbed.pages import ReportPage, numbers
from wrenchbed.pages.chart import Chart
from wrenchbed.pages.document import Facts, provenance
from wrenchbed.pages.draw import Drawn, draw
from wrenchbed.reports import cause_charts, figures
from wrenchbed.reports.answer import BADGES, Answer
from wrenchbed.reports.claim import joints_or
from wrenchbed.reports.compared_readings import HeldOutReadings, along
from wrenchbed.reports.effort_answer import EffortAnswer, effort_charts, effort_map
from wrenchbed.reports.robot_scene import effort_scene, wrench_scene
from wrenchbed.reports.wrench_answer import WrenchAnswer


def recording_facts(recording: Recording, name: str, observed: str = "") -> list[tuple[str, str]]:
    """(label, text) of each fact on a recording that is called ``name``; ``observed`` is text on
    what its rows were made into, such as poses."""
    stated = recording.metadata
    rate = "" if stated.rate_hz is None else f" at {stated.rate_hz:g} Hz"
    rows = f"{observed}{len(recording):,} rows{rate}, source: {stated.source or 'not stated'}"
    return [("recording", name), ("sensor", stated.sensor.model or "not stated"), ("data", rows)]


def diagnosis_page(findings: Findings, command: str = "") -> ReportPage:
    """The HTML page of a diagnosis of a wrench; ``command`` is the command line that made it,
    stated without options if empty. A `MissingExtraError` without matplotlib."""
    registry.require("matplotlib", "report")
    words, readings = WrenchAnswer(findings), HeldOutReadings(findings)
    scene, p = wrench_scene(readings), readings.prepared
    of = readings.names, readings.residuals, readings.ids
    heat = figures.residual_map(*of, along(p), p.observed)
    more = {
        "robot": None if scene is None else draw(scene),
        "heat": draw(heat),
        "noise": p.noise_source,
        "observed": p.observed,
        "rows": words.row_sentences,
        "next": words.d.next,
        "record": f"wrenchbed record --robot {shlex.quote(words.d.robot)} --driver DRIVER --plan ",
        "notes": words.notes[len(words.row_sentences) :],
    }
    return _page(words, command, _data(findings), _of_causes(words, readings), more)


def effort_page(findings: EffortFindings, command: str = "") -> ReportPage:
    """The HTML page of a diagnosis of joint efforts; ``command`` is the command line that made it,
    stated without options if empty. A `MissingExtraError` without matplotlib."""
    registry.require("matplotlib", "report")
    words, charts = EffortAnswer(findings), effort_charts(findings)
    names = [words.d.recording]
    data = [("recording", names[0]), ("robot", words.d.robot)]
    data += provenance(names, seed=findings.seed)
    more = {
        "what": f"the {words.channels} of ",
        "robot": draw(effort_scene(findings)),
        "heat": draw(effort_map(findings)),
        "noise": "from what all effects together leave, at least what a healthy day's fit left",
    }
    return _page(words, command, data, charts, more)


def _page(
    words: Answer, command: str, data: Facts, charts: list[Chart], more: Mapping[str, Any]
) -> ReportPage:
    """HTML page of an answer: ``data``: (label, text) facts on its origin; ``charts`` show the
    causes, ``more`` are template values of one kind of page alone, figures among them."""
    d, comparisons = words.d, [draw(chart) for chart in charts]
    recordings = (d.recording, *d.others)
    context = {
        "d": d,
        "verdict": d.verdict,
        "name": ", ".join(PurePath(r).name for r in recordings),
        "badge": BADGES[d.verdict],
        "words": words,
        "gap": numbers.gap,
        "comparisons": comparisons,
        "notes": words.notes,
        "data": [*data, ("duration of the diagnosis", f"{d.seconds:.1f} s")],
        "command": command or f"wrenchbed diagnose {shlex.join(recordings)} --out DIR",
    }
    besides = (value for value in more.values() if isinstance(value, Drawn))
    return ReportPage(context | dict(more), "diagnosis.html", [*besides, *comparisons])


def _of_causes(words: WrenchAnswer, e: HeldOutReadings) -> list[Chart]:
    """Charts of each cause in their order, or of the residual if no cause is claimed."""
    charts: list[Chart | None] = []
    alike = {w["effect"] for w in words.d.which if joints_or(w)[1:]}
    for k, cause in enumerate(e.causes()):
        if cause.name not in alike:  # a chart over one joint, of several that explain it
            charts.append(cause_charts.own_chart(e, cause, f"cause-{k}"))
        charts.append(figures.of_cause(e, cause, f"effect-{k}"))
    for k, entry in enumerate(words.d.which):
        charts.append(cause_charts.curve_chart(entry, f"curve-{k}"))
        if entry["effect"] in words.row_effects:
            charts.append(cause_charts.scatter(e, entry, f"rows-{k}"))
    if words.d.verdict in ("unknown", "partial"):
        charts.append(cause_charts.everywhere(e, "everywhere"))
    return [chart for chart in charts if chart is not None]


def _data(findings: Findings) -> list[tuple[str, str]]:
    """(label, text) of each fact on the diagnosed recordings, and of the page's origin."""
    names = (findings.diagnosis.recording, *findings.diagnosis.others)
    every = [findings.analysis.prepared, *(a.prepared for a in findings.analysis.others)]
    facts = [("robot", f"{findings.diagnosis.robot}: {every[0].robot.title}")]
    for name, p in zip(names, every, strict=True):
        facts += recording_facts(p.recording, name, f"{len(p.y):,} {p.observed}, ")
        facts.append(("noise of a row", p.noise_source))
    return [*facts, *provenance(names, seed=findings.seed)]
