"""The report of a diagnosis as one HTML page that needs nothing else."""

import shlex
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any

from wrenchbed import registry
from wrenchbed.diagnosis.diagnose import Findings
from wrenchbed.diagnosis.prepare.prepared import Prepared
from wrenchbed.pages import Drawn, numbers, rendered, write_page
from wrenchbed.pages.artist import AtOnce, Draws
from wrenchbed.pages.chart import Chart
from wrenchbed.pages.provenance import provenance
from wrenchbed.reports import cause_charts, figures, residual_charts, sentences, tables
from wrenchbed.reports.claim import claim
from wrenchbed.reports.robot_chart import robot_chart
from wrenchbed.reports.simulators import Evidence

_BADGES = {"none": "✓", "identified": "●", "ambiguous": "◐", "partial": "◔", "unknown": "?"}
"""Shapes beside the colour of a verdict."""


@dataclass(frozen=True)
class ReportPage:
    """A report, ready to be written.

    Attributes:
        context: what the template shows, by name; ``verdict`` chooses its colour.
        template: which kind of report it is.
        figures: that answer on the page.
    """

    context: Mapping[str, Any]
    template: str = "diagnosis"
    figures: Sequence[Drawn] = ()

    def html(self) -> str:
        """One self-contained page with the figures inside.

        Raises:
            MissingExtraError: jinja2 is not installed.
        """
        return rendered(self.template, self.context, self.figures)

    def write(self, path: str | Path) -> None:
        """Write the page."""
        write_page(path, self.template, self.context, self.figures)


def diagnosis_page(found: Findings, command: str = "", artist: Draws | None = None) -> ReportPage:
    """The page of a diagnosis.

    Args:
        found: from ``diagnose``.
        command: that made it; told without options if not given.
        artist: draws the figures beside; drawn here if None.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    return page_to_come(found, command, artist)()


def page_to_come(
    found: Findings, command: str = "", artist: Draws | None = None
) -> Callable[[], ReportPage]:
    """`diagnosis_page` whose figures are begun; called, it waits for them and returns the page."""
    registry.require("matplotlib", "report")
    evidence = Evidence(found)
    before, after = evidence.channels()
    map_of_residuals = evidence.heat()
    draw = (artist or AtOnce()).draw
    coming = {
        "heat": draw(figures.heat(map_of_residuals, found.analysis.prepared.observed)),
        "gaps": draw(figures.gaps(tables.gaps(found))),
        "channels": draw(figures.channels(before, after, evidence.first)),
    }
    robot = robot_chart(found, evidence)
    if robot is not None:
        coming["robot"] = draw(robot)
    comparisons = [draw(chart) for chart in _of_causes(found, evidence)]
    return lambda: _page(found, command, evidence, coming, comparisons)


def _page(
    found: Findings, command: str, evidence: Evidence, coming: Mapping[str, "Future[Drawn]"],
    comparisons: Sequence["Future[Drawn]"],
) -> ReportPage:  # fmt: skip
    """The page with its figures as they come."""
    d, prepared, rows = found.diagnosis, found.analysis.prepared, sentences.row_effects(found)
    drawn = {name: figure.result() for name, figure in coming.items()}
    compared = [figure.result() for figure in comparisons]
    told = {r.sentence for r in found.rows}
    recorded = shlex.join([d.recording, *d.others])
    return ReportPage(
        {
            "d": d,
            "verdict": d.verdict,
            "name": ", ".join(PurePath(r).name for r in (d.recording, *d.others)),
            "badge": _BADGES[d.verdict],
            "headline": sentences.headline(found),
            "place": sentences.place(found),
            "where": sentences.places(found),
            "subsystems": tables.subsystems(found),
            "causes": [claim(w) for w in d.which],
            "no_cause": sentences.without_cause(found),
            "how_far": sentences.distance(found),
            "black_box": sentences.black_box(d.gap),
            "seen": sentences.seen(found),
            "observed": prepared.observed,
            "between_rows": bool(rows) and all(w["effect"] in rows for w in d.which),
            "bars": [
                (label, numbers.gap(value), kind) for label, value, kind in tables.gaps(found)
            ],
            **drawn,
            "places": tables.places(found),
            "shared": tables.shared(found),
            "unseen": tables.invisible(found),
            "candidates": tables.candidates(d.probabilities),
            "explanations": tables.explanations(found),
            "table": tables.causes(found),
            "comparisons": compared,
            "rows": [r.sentence for r in found.rows],
            "next": tables.steps(d.next),
            "nothing_more": sentences.nothing_more(found),
            "record": f"wrenchbed record --robot {shlex.quote(d.robot)} --driver DRIVER --plan ",
            "notes": [n for n in d.notes if n not in told],
            "data": _data(found),
            "command": command or f"wrenchbed diagnose {recorded} --out DIR",
        },
        figures=[*drawn.values(), *compared],
    )


def _of_causes(found: Findings, e: Evidence) -> list[Chart]:
    """What shows each cause, or what nothing explains, in the order of the causes."""
    told: list[Chart | None] = []
    for k, own in enumerate(e.claims()):
        told.append(cause_charts.own_chart(e, own, f"cause-{k}"))
        told += [figures.comparison(c, f"effect-{k}-{c.channel}") for c in e.of_claim(own)]
    for k, entry in enumerate(found.diagnosis.which):
        told.append(cause_charts.curve_chart(entry, f"curve-{k}"))
        if entry["rivals"]:
            told.append(residual_charts.rivals(e, entry, f"rivals-{k}"))
        if entry["effect"] in sentences.row_effects(found):
            told.append(residual_charts.scatter(e, entry, f"rows-{k}"))
    told += [figures.comparison(c, f"left-{c.channel}") for c in e.unexplained()]
    if found.diagnosis.verdict in ("unknown", "partial"):
        told.append(residual_charts.everywhere(e, "everywhere"))
    return [chart for chart in told if chart is not None]


def _data(found: Findings) -> list[tuple[str, str]]:
    """What was diagnosed, by what."""
    every = (found.analysis, *found.analysis.others)
    names = (found.diagnosis.recording, *found.diagnosis.others)
    robot = found.analysis.prepared.robot
    return [
        ("robot", f"{found.diagnosis.robot}: {robot.title}"),
        *(line for n, a in zip(names, every, strict=True) for line in _recorded(n, a.prepared)),
        *provenance(names, seed=found.seed),
        ("duration of the diagnosis", f"{found.diagnosis.seconds:.1f} s"),
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
