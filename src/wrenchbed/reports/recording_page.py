"""The report of a recording held against simulators."""

from collections.abc import Mapping, Sequence
from pathlib import Path, PurePath
from typing import Any

import numpy as np

from wrenchbed.data.recording import Recording
from wrenchbed.errors import ParameterError
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


def _white(recording: Recording, s: Simulator, noise: np.ndarray) -> np.ndarray:
    return np.asarray((recording.wrench - s.reading) / noise)


def _heat(recording: Recording, known: Sequence[Simulator], noise: np.ndarray) -> Chart:
    order, unit = order_of(recording)
    groups = bins(order, figures.BINS)
    residuals = {s.name: _white(recording, s, noise) for s in known}
    poses = unit == "pose"
    return figures.heat(
        residuals, groups, figures.ranges(order, groups), "pose" if poses else "time [s]",
        "over the poses in order" if poses else "over time", "poses" if poses else "rows",
    )  # fmt: skip


def _charts(recording: Recording, known: Sequence[Simulator], noise: np.ndarray) -> list[Chart]:
    """Residuals as a map, then readings and their residual, and the joints, over time."""
    t = recording.t - recording.t[0]
    told = [_heat(recording, known, noise)]
    for part, first in (("Forces", 0), ("Torques", 3)):
        told.append(_over_time(recording, known, noise, t, part, first))
    if recording.joints:
        turns = [j.unit == "rad" for j in robot_of(recording).joints]
        panels, note = [], ""
        for k, joint in enumerate(recording.joints):
            y = recording.q[:, k]
            series, note = thinned(
                [Series("", "line", t, np.rad2deg(y) if turns[k] else 1e3 * y, ids=_rows(t))],
            )  # fmt: skip
            y_axis = Axis(joint, "°" if turns[k] else "mm")
            panels.append(Panel(Axis("time", "s"), y_axis, series, height=0.7))
        told.append(
            Chart("joints", "Joints over time", tuple(panels), 2, shared=True, note=note)
        )  # fmt: skip
    return told


def _over_time(
    recording: Recording, known: Sequence[Simulator], noise: np.ndarray, t: np.ndarray, part: str,
    first: int,
) -> Chart:  # fmt: skip
    """Three channels measured and simulated, each with its residual beside."""
    roles: tuple[Role, ...] = ("before", "after", "box", "rest")
    panels, note = [], ""
    for k in range(first, first + 3):
        channel, unit, y = CHANNELS[k], UNITS[k], recording.wrench[:, k]
        readings = [Series("measured", "line", t, y, ids=_rows(t))]
        left = []
        for s, role in zip(known, roles, strict=False):
            readings.append(
                Series(s.name, "line", t, s.reading[:, k], role=role, dashed=True, ids=_rows(t))
            )
            rest = (y - s.reading[:, k]) / noise[k]
            left.append(Series(s.name, "line", t, rest, role=role, ids=_rows(t)))
        for series, axis, zero in (
            (readings, Axis(channel, unit), False),
            (left, Axis(f"{channel}, residual", "noise"), True),
        ):
            kept, note = thinned(series)
            panels.append(Panel(Axis("time", "s"), axis, kept, zero=zero, height=0.9))
    caption = "On the left measured and simulated, on the right their difference."
    return Chart(part.lower(), f"{part} over time", tuple(panels), 2, True, caption, note)


def _rows(t: np.ndarray) -> np.ndarray:
    return np.arange(1, len(t) + 1)


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
        mass, cog = float(fit["tool"]["mass"]), [1e3 * float(x) for x in fit["tool"]["cog"]]
    except (LookupError, TypeError, ValueError) as cause:
        raise ParameterError(
            f"{name}: field 'tool' is not as `calibrate` writes it; calibrate again"
        ) from cause
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
