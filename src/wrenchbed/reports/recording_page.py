"""The report of a recording and simulators: how far they agree, channel by channel."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath

import numpy as np

from wrenchbed.data.recording import Recording
from wrenchbed.pages import ReportPage, numbers
from wrenchbed.pages.chart import Axis, Chart, Kind, Panel, Role, Series, thinned
from wrenchbed.pages.document import provenance
from wrenchbed.pages.draw import draw
from wrenchbed.physics.wrench import CHANNELS, UNITS
from wrenchbed.reports.compared_readings import joint_axis
from wrenchbed.reports.diagnosis_page import recording_facts
from wrenchbed.twin.simulator_predictions import (
    Simulator,
    modelled,
    noise_of,
    order_of,
    robot_of,
    simulators,
)

AGREES, NEAR = 1.25, 3.0
"""Rms residual of a channel [noise of one row] up to which simulator and measurement agree, or
differ slightly. 1.25 is a gap of 0.56: normal imperfections add up to 0.5 (docs/contracts.md)."""
_SIMULATED: tuple[Role, ...] = ("before", "after", "box")
"""Colour roles of the first, second and third simulator."""


@dataclass(frozen=True, eq=False)
class Agreement:
    """Residuals of one simulator on a recording, as words and numbers.

    Attributes:
        name: name of the simulator.
        ratios: rms of the residual of each channel (6,) over its noise of one row.
        rms: rms of the residual of each channel (6,) [N, N·m].
    """

    name: str
    ratios: np.ndarray
    rms: np.ndarray

    @property
    def overall(self) -> float:
        """Rms of ``ratios``: residual over all channels in units of noise."""
        return float(np.sqrt(np.mean(self.ratios**2)))

    @property
    def differing(self) -> list[str]:
        """Names of the channels with residuals above `AGREES` × noise, the worst first."""
        order = np.argsort(-self.ratios, kind="stable")
        return [CHANNELS[k] for k in order if not self.ratios[k] < AGREES]

    @property
    def worst(self) -> str:
        """Text of the channel with the largest residual: ``tz 1.87 × noise``."""
        k = int(np.argmax(self.ratios))
        return f"{CHANNELS[k]} {self.ratios[k]:.2f} × noise"

    @property
    def headline(self) -> str:
        """Sentence on whether the simulator agrees with the recording."""
        if not self.differing:
            return f"Simulator {self.name} agrees with the recording in every channel."
        much = "slightly" if self.ratios.max() < NEAR else "much"
        where = ", ".join(self.differing)
        return f"The best simulator, {self.name}, differs {much} from the recording in {where}."

    @property
    def text(self) -> str:
        """Sentences on the largest residual of a channel and on that of all channels."""
        overall = f"All channels: {self.overall:.2f} × noise. A channel agrees below {AGREES:g} ×."
        return f"Largest residual of a channel: {self.worst}, rms. {overall}"


def agreements(
    recording: Recording, simulators: Sequence[Simulator], noise: np.ndarray
) -> list[Agreement]:
    """Agreement of each simulator with a recording whose rows have noise (6,) [N, N·m]."""
    residuals = [np.nanmean((recording.wrench - s.reading) ** 2, axis=0) for s in simulators]
    return [
        Agreement(s.name, np.sqrt(r) / noise, np.sqrt(r))
        for s, r in zip(simulators, residuals, strict=True)
    ]


def report(
    recording: Recording,
    against: Sequence[str | Path] = (),
    out: str | Path = "report.html",
    command: str = "",
) -> None:
    """Write one HTML page ``out`` about a recording and what simulators predict for it, of the
    fit.json and twin.json files ``against``; it prints ``command``, the line that made it. A
    `ParameterError` if a file is neither, or of another robot; a `MissingExtraError` without
    matplotlib or jinja2."""
    recording_page(recording, against, command).write(out)


def recording_page(recording: Recording, files: Sequence[str | Path], command: str) -> ReportPage:
    """HTML page of a recording and simulators (``files``: fit.json, twin.json); without a model,
    readings alone."""
    known = simulators(recording, files) if files or modelled(recording) else []
    noise, name = noise_of(recording), PurePath(recording.name).name
    judged = agreements(recording, known, noise)
    nearest = min(judged, key=lambda a: a.overall, default=None)
    fits = [s for s in known if s.fitted]
    stated = recording.metadata.sensor.noise_std
    source = "as stated" if stated else "from how neighbouring rows differ"
    drawn = [draw(chart) for chart in _charts(recording, known, noise, nearest, source)]
    differs = nearest is not None and bool(nearest.differing)
    order, unit = order_of(recording)
    context = {
        "verdict": "unknown" if differs else "none" if nearest else "identified",
        "badge": "✗ differs" if differs else "✓ agrees" if nearest else "○ readings alone",
        "name": name,
        "best": nearest,
        "rows": len(recording),
        "poses": len(np.unique(order)) if unit == "pose" else 0,
        "seconds": float(recording.t[-1] - recording.t[0]),
        "stated": recording.metadata,
        "simulators": judged,
        "channels": dict(zip(CHANNELS, UNITS, strict=True)),
        "noise": noise,
        "noise_source": source,
        "tool": robot_of(recording).tool(fits[-1].theta) if fits else None,
        "agrees_below": AGREES,
        "each": [d for d in drawn if d.chart.name in CHANNELS],
        "joints": next((d for d in drawn if d.chart.name == "joints"), None),
        "data": [*recording_facts(recording, recording.name), *provenance([recording.name])],
        "command": command,
    }
    return ReportPage(context, "recording.html", drawn)


class _Over:
    """The x axis of a recording's charts: poses, with the means of their rows, or rows of a motion.

    Attributes:
        axis: axis with its label and unit.
        x: number of each pose, or time of each row [s] (M,).
        ids: numbers of the observations (M,).
        groups: row indices of each pose; None in a motion, where each row is drawn.
        kind: how values are drawn: lines of a motion, points at rest.
    """

    def __init__(self, recording: Recording) -> None:
        order, unit = order_of(recording)
        self.axis, self.x = Axis("time", "s"), recording.t - recording.t[0]
        self.ids = np.arange(1, len(self.x) + 1)
        self.kind: Kind = "line" if recording.metadata.mode == "dynamic" else "points"
        self.groups: list[np.ndarray] | None = None
        if unit == "pose":
            poses = np.unique(order)
            self.axis, self.x = Axis("number of the pose"), poses.astype(float)
            self.ids, self.kind = poses.astype(int), "points"
            self.groups = [np.flatnonzero(order == pose) for pose in poses]

    def means(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
        """Means (M,) of y (N,) over each pose, and std of its rows (M,); y and None in a motion."""
        if self.groups is None:
            return y, None
        each = [y[g] for g in self.groups]
        return np.array([np.nanmean(v) for v in each]), np.array([np.nanstd(v) for v in each])


def _charts(
    recording: Recording, known: Sequence[Simulator], noise: np.ndarray,
    nearest: Agreement | None, source: str,
) -> list[Chart]:  # fmt: skip
    """Charts of each channel above residuals of simulators ``known``, over ``noise`` (6,) of a row
    [N, N·m] of a ``source``, and of the joints; captions compare with ``nearest``."""
    over, measured, charts = _Over(recording), recording.wrench, list[Chart]()
    residuals = {s.name: np.asarray((measured - s.reading) / noise) for s in known}
    for k, channel in enumerate(CHANNELS):
        readings = {"measured": measured[:, k]} | {s.name: s.reading[:, k] for s in known}
        panels = [_panel(over, Axis(channel, UNITS[k]), readings, 1.15)]
        if known:
            rows = {name: residual[:, k] for name, residual in residuals.items()}
            panels.append(_panel(over, Axis("residual", "noise"), rows, 0.8))
        means, noisy = over.means(measured[:, k])[0], f"{noise[k]:.2g} {UNITS[k]}"
        caption = _sentence(means, k, f"{noisy}, {source}", nearest)
        charts.append(Chart(channel, channel, tuple(panels), 1, True, caption))
    if modelled(recording):
        joints = enumerate(robot_of(recording).joints, start=1)
        axes = [joint_axis(joint, k) for k, joint in joints]
        panels = [
            _panel(over, axis, {"": f * recording.q[:, k]}, 0.9) for k, (axis, f) in enumerate(axes)
        ]
        charts.append(Chart("joints", "Joints", tuple(panels), 2, True))
    return charts


def _panel(over: _Over, axis: Axis, curves: Mapping[str, np.ndarray], height: float) -> Panel:
    """Panel, ``height`` × usual, of curves, name → rows (N,): poses' means ± std of rows, or
    lines."""
    simulated = [name for name in curves if name not in ("", "measured")]
    roles = dict(zip(simulated, _SIMULATED, strict=False))
    beside = len(simulated) < len(curves)
    series = []
    for name, rows in curves.items():
        y, std = over.means(rows)
        ring = beside and name in roles
        series.append(
            Series(name, over.kind, over.x, y, None if ring else std,
                   roles.get(name, "measured"), "ring" if ring else "dot", ring, over.ids)
        )  # fmt: skip
    kept, _ = thinned(series)
    return Panel(over.axis, axis, kept, zero=not beside, height=height)


def _sentence(means: np.ndarray, k: int, noise: str, nearest: Agreement | None) -> str:
    """Caption of channel k: range of its ``means`` (M,), ``noise``, residual of ``nearest``."""
    unit, low, high = UNITS[k], float(np.nanmin(means)), float(np.nanmax(means))
    text = f"{low:.3g} … {high:.3g} {unit}; noise of a row {noise}."
    if nearest is not None:
        ratio, rms = nearest.ratios[k], nearest.rms[k]
        much = "slightly" if ratio < NEAR else "much"
        verb = "agrees with" if ratio < AGREES else f"differs {much} from"
        text += f" It {verb} {nearest.name}: residual {ratio:.2f} × noise ({rms:.2g} {unit}), rms."
    return numbers.minus(text)
