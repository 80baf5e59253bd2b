"""The report of a recording held against simulators."""

from collections.abc import Mapping, Sequence
from pathlib import Path, PurePath
from typing import Any

import numpy as np

from wrenchbed.data.recording import Recording
from wrenchbed.errors import ParameterError
from wrenchbed.files import checked
from wrenchbed.pages import ReportPage, numbers
from wrenchbed.pages.chart import Axis, Chart, Panel, Role, Series, thinned
from wrenchbed.pages.draw import draw
from wrenchbed.pages.provenance import provenance
from wrenchbed.physics.wrench import CHANNELS, UNITS
from wrenchbed.reports import figures
from wrenchbed.reports.agreement import AGREES, Agreement, agreement, best
from wrenchbed.twin.comparison import (
    Simulator,
    bins,
    noise_of,
    order_of,
    robot_of,
    simulators,
)


def report(
    recording: Recording,
    against: Sequence[str | Path] = (),
    out: str | Path = "report.html",
    command: str = "",
) -> None:
    """Write one HTML page about a recording, what simulators say of it, and fits.

    Args:
        recording: what was measured.
        against: fit.json and twin.json files whose simulators are compared with it.
        out: page to write.
        command: that made the page, to be printed on it.

    Raises:
        ParameterError: a file is neither, or of another robot.
        MissingExtraError: matplotlib or jinja2 is not installed.
    """
    recording_page(recording, against, command).write(out)


def recording_page(recording: Recording, files: Sequence[str | Path], command: str) -> ReportPage:
    """The page of a recording and of some fit.json and twin.json files.

    Raises:
        ParameterError: a file is neither, or of another robot.
        MissingExtraError: matplotlib or jinja2 is not installed.
    """
    known = simulators(recording, files)
    noise = noise_of(recording)
    judged = [agreement(recording, s, noise) for s in known]
    fits = [s for s in known if s.fit]
    drawn = [draw(chart) for chart in _charts(recording, known, noise)]
    nearest = best(judged)
    context = {
        "verdict": "none" if nearest.agrees else "unknown",
        "badge": "✓ agrees" if nearest.agrees else "✗ differs",
        "kind": "Recording",
        "name": PurePath(recording.name).name,
        "robot": recording.metadata.robot,
        "headline": nearest.headline,
        "what": _what(recording),
        "best": {"figure": nearest.worst, "text": nearest.text},
        "simulators": [
            {
                "name": a.name,
                "ratio": a.worst,
                "rms": [
                    (f"{x:.3g}", f"{r:.3g}", c in a.differing)
                    for c, x, r in zip(CHANNELS, a.rms, a.ratios, strict=True)
                ],
            }
            for a in judged
        ],
        "channels": CHANNELS,
        "noise": [f"{x:.3g}" for x in noise],
        "tool": _tool(fits[-1].name, fits[-1].fit) if fits else [],
        "heat": drawn[0],
        "series": drawn[1:],
        "next": _next(nearest, bool(fits), PurePath(recording.name).name),
        "data": _data(recording) + provenance([recording.name]),
        "command": command,
    }
    return ReportPage(context, "recording", drawn)


def _charts(recording: Recording, known: Sequence[Simulator], noise: np.ndarray) -> list[Chart]:
    """Residuals as a map, then readings and their residual, and the joints, over time."""
    order, unit = order_of(recording)
    groups = bins(order, figures.BINS)
    residuals = {s.name: np.asarray((recording.wrench - s.reading) / noise) for s in known}
    poses = unit == "pose"
    charts = [
        figures.heat(
            residuals, groups, figures.ranges(order, groups), "pose" if poses else "time [s]",
            "over the poses in order" if poses else "over time", "poses" if poses else "rows",
        )
    ]  # fmt: skip
    caption = "On the left measured and simulated, on the right their difference."
    for title, first in (("Forces", 0), ("Torques", 3)):
        panels = []
        for k in range(first, first + 3):
            readings = {"measured": recording.wrench[:, k]}
            readings |= {s.name: s.reading[:, k] for s in known}
            differences = {name: residual[:, k] for name, residual in residuals.items()}
            panels.append((Axis(CHANNELS[k], UNITS[k]), readings))
            panels.append((Axis(f"{CHANNELS[k]}, residual", "noise"), differences))
        charts.append(_over_time(recording, f"{title} over time", panels, caption))
    if recording.joints:
        joints = robot_of(recording).joints
        units = [("°", 180.0 / np.pi) if j.unit == "rad" else ("mm", 1e3) for j in joints]
        q = [
            (Axis(name, unit), {"": factor * recording.q[:, k]})
            for k, (name, (unit, factor)) in enumerate(zip(recording.joints, units, strict=True))
        ]
        charts.append(_over_time(recording, "Joints over time", q))
    return charts


def _over_time(
    recording: Recording, title: str, panels: Sequence[tuple[Axis, Mapping[str, np.ndarray]]],
    caption: str = "",
) -> Chart:  # fmt: skip
    """Curves (N,) by name, two panels beside each other; simulators are dashed."""
    t, rows = recording.t - recording.t[0], np.arange(1, len(recording) + 1)
    simulated: tuple[Role, ...] = ("before", "after", "box", "rest")
    drawn, note = [], ""
    for axis, curves in panels:
        measured = [name for name in curves if name in ("", "measured")]
        roles = dict(zip([n for n in curves if n not in measured], simulated, strict=False))
        series = [
            Series(
                name, "line", t, y, role=roles.get(name, "measured"), ids=rows,
                dashed=bool(measured) and name in roles,
            )
            for name, y in curves.items()
        ]  # fmt: skip
        kept, note = thinned(series)
        drawn.append(Panel(Axis("time", "s"), axis, kept, zero=not measured, height=0.9))
    return Chart(title.split()[0].lower(), title, tuple(drawn), 2, True, caption, note)


def _what(recording: Recording) -> dict[str, str]:
    at_rest, (order, unit) = recording.metadata.mode == "static", order_of(recording)
    span = float(recording.t[-1] - recording.t[0])
    figure = f"{len(np.unique(order))} poses at rest" if unit == "pose" else f"{span:.0f} s"
    figure += "" if unit == "pose" else " at rest" if at_rest else " of motion"
    source = recording.metadata.source or "an unstated source"
    return {"figure": figure, "text": f"{len(recording):,} rows in {span:,.0f} s, from {source}."}


def _tool(name: str, fit: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Label and text of a fit's tool.

    Raises:
        ParameterError: the field is not as `calibrate` writes it.
    """
    try:
        values = [fit["tool"]["mass"], *fit["tool"]["cog"]]
    except (LookupError, TypeError):
        values = []
    if len(values) != 4 or not all(map(checked.is_number, values)):
        raise ParameterError(
            f"{name}: field 'tool' is not as `calibrate` writes it; calibrate again"
        )
    mass, cog = values[0], [1e3 * x for x in values[1:]]
    words = f"({', '.join(f'{x:.4g}' for x in cog)}) mm"
    return [("mass", numbers.minus(f"{mass:.4g} kg")), ("centre of gravity", numbers.minus(words))]


def _next(nearest: Agreement, fitted: bool, name: str) -> list[str]:
    if nearest.agrees:
        return [
            f"Use this simulator: no channel's residual reaches {AGREES:g} times its noise.",
            f"wrenchbed diagnose {name} --out found tests for effects below the noise of a row.",
        ]
    if not fitted:
        return [f"wrenchbed calibrate {name} --out fit.json fits mass, centre of gravity and bias."]
    return [f"wrenchbed diagnose {name} --out found locates the residual and names its cause."]


def _data(recording: Recording) -> list[tuple[str, str]]:
    stated = recording.metadata
    rate = "" if stated.rate_hz is None else f" at {stated.rate_hz:g} Hz"
    mass = "not stated" if stated.tool.mass is None else f"{stated.tool.mass:.4g} kg"
    return [
        ("recording", recording.name),
        ("sensor", stated.sensor.model or "not stated"),
        ("stated tool", mass),
        ("rows", f"{len(recording):,}{rate}"),
    ]
