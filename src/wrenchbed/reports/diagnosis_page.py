"""The report of a diagnosis as one HTML page that needs nothing else."""

import shlex
from pathlib import PurePath

from wrenchbed import registry
from wrenchbed.diagnosis.diagnose import Findings
from wrenchbed.diagnosis.prepare.prepared import Prepared
from wrenchbed.pages import ReportPage, numbers
from wrenchbed.pages.chart import Chart
from wrenchbed.pages.draw import draw
from wrenchbed.pages.provenance import provenance
from wrenchbed.reports import cause_charts, figures, sentences, tables
from wrenchbed.reports.answer import BADGES, of_wrench
from wrenchbed.reports.simulators import Evidence


def diagnosis_page(findings: Findings, command: str = "") -> ReportPage:
    """The page of a diagnosis.

    Args:
        findings: from ``diagnose``.
        command: that made it; stated without options if not given.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    registry.require("matplotlib", "report")
    d, prepared, rows = (
        findings.diagnosis,
        findings.analysis.prepared,
        sentences.row_effects(findings),
    )
    evidence, words = Evidence(findings), of_wrench(findings)
    before, after = evidence.channels()
    drawn = {
        "heat": draw(figures.residual_map(evidence)),
        "gaps": draw(figures.gaps(words.gaps)),
        "channels": draw(figures.channels(before, after, evidence.first)),
    }
    compared = [draw(chart) for chart in _of_causes(findings, evidence)]
    row_sentences = [r.sentence for r in findings.rows]
    recorded = shlex.join([d.recording, *d.others])
    context = {
        "d": d,
        "verdict": d.verdict,
        "name": ", ".join(PurePath(r).name for r in (d.recording, *d.others)),
        "badge": BADGES[d.verdict],
        "words": words,
        "subsystems": tables.subsystems(findings),
        "seen": sentences.seen(findings),
        "observed": prepared.observed,
        "between_rows": bool(rows) and all(w["effect"] in rows for w in d.which),
        **drawn,
        "places": tables.places(findings),
        "shared": tables.shared(findings),
        "unseen": tables.invisible(findings),
        "explanations": tables.explanations(findings),
        "comparisons": compared,
        "rows": row_sentences,
        "next": tables.steps(d.next),
        "record": f"wrenchbed record --robot {shlex.quote(d.robot)} --driver DRIVER --plan ",
        "notes": [n for n in d.notes if n not in row_sentences],
        "data": _data(findings),
        "command": command or f"wrenchbed diagnose {recorded} --out DIR",
    }
    return ReportPage(context, "diagnosis", [*drawn.values(), *compared])


def _of_causes(findings: Findings, e: Evidence) -> list[Chart]:
    """What shows each cause, or what nothing explains, in the order of the causes."""
    charts: list[Chart | None] = []
    for k, own in enumerate(e.claims()):
        charts.append(cause_charts.own_chart(e, own, f"cause-{k}"))
        charts += figures.of_claim(e, own, f"effect-{k}")
    for k, entry in enumerate(findings.diagnosis.which):
        charts.append(cause_charts.curve_chart(entry, f"curve-{k}"))
        if entry["effect"] in sentences.row_effects(findings):
            charts.append(cause_charts.scatter(e, entry, f"rows-{k}"))
    charts += figures.unexplained(e)
    if findings.diagnosis.verdict in ("unknown", "partial"):
        charts.append(cause_charts.everywhere(e, "everywhere"))
    return [chart for chart in charts if chart is not None]


def _data(findings: Findings) -> list[tuple[str, str]]:
    """What was diagnosed, by what."""
    every = (findings.analysis, *findings.analysis.others)
    names = (findings.diagnosis.recording, *findings.diagnosis.others)
    robot = findings.analysis.prepared.robot
    return [
        ("robot", f"{findings.diagnosis.robot}: {robot.title}"),
        *(line for n, a in zip(names, every, strict=True) for line in _recorded(n, a.prepared)),
        *provenance(names, seed=findings.seed),
        ("duration of the diagnosis", f"{findings.diagnosis.seconds:.1f} s"),
    ]


def _recorded(name: str, p: Prepared) -> list[tuple[str, str]]:
    """What one recording states and holds."""
    stated = p.recording.metadata
    tool = []
    if stated.tool.mass is not None:
        tool.append(f"{stated.tool.mass:.4g} kg")
    if stated.tool.cog is not None:
        cog = ", ".join(f"{1e3 * x:.4g}" for x in stated.tool.cog)
        tool.append(numbers.minus(f"centre of gravity ({cog}) mm"))
    rate = "" if stated.rate_hz is None else f" at {stated.rate_hz:g} Hz"
    return [
        ("recording", name),
        ("sensor", stated.sensor.model or "not stated"),
        ("stated tool", ", ".join(tool) or "not stated"),
        (
            "data",
            f"{len(p.y):,} {p.observed}, {len(p.recording):,} rows{rate}, "
            f"source: {stated.source or 'not stated'}",
        ),
        ("noise of a row", p.noise_source),
    ]
