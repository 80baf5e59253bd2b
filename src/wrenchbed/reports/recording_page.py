"""The report of a recording held against simulators: do these agree with it, channel by channel?"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath

import numpy as np

from wrenchbed.data.recording import Recording
from wrenchbed.pages import ReportPage, numbers
from wrenchbed.pages.chart import Axis, Chart, Panel, Role, Series, thinned
from wrenchbed.pages.document import provenance
from wrenchbed.pages.draw import draw
from wrenchbed.physics.wrench import CHANNELS, UNITS
from wrenchbed.reports import figures
from wrenchbed.reports.diagnosis_page import recording_facts
from wrenchbed.reports.simulators import joint_axis
from wrenchbed.robots.base import SimulatedRobot
from wrenchbed.twin.comparison import Simulator, noise_of, order_of, robot_of, simulators

AGREES, NEAR = 1.25, 3.0
"""Residuals of a channel [noise of one row, rms] up to which simulator and measurement agree, or
differ slightly. 1.25 is a gap of 0.56: normal imperfections add up to 0.5 (the contracts)."""
_SIMULATED: tuple[Role, ...] = ("before", "after", "box")
"""Colours of simulators, in their order."""


@dataclass(frozen=True, eq=False)
class Agreement:
    """How far one simulator is from a recording.

    Attributes:
        name: of the simulator.
        ratios: rms of the residual of each channel (6,) in units of its noise of one row.
        rms: of the residual of each channel (6,) [N, N·m].
    """

    name: str
    ratios: np.ndarray
    rms: np.ndarray

    @property
    def overall(self) -> float:
        """Rms over all channels in units of noise."""
        return float(np.sqrt(np.mean(self.ratios**2)))

    @property
    def differing(self) -> list[str]:
        """Channels that differ, the worst first; none where the simulator agrees."""
        order = np.argsort(-self.ratios, kind="stable")
        return [CHANNELS[k] for k in order if not self.ratios[k] < AGREES]

    @property
    def worst(self) -> str:
        """Text of the largest residual: ``tz 1.87 × noise``."""
        k = int(np.argmax(self.ratios))
        return f"{CHANNELS[k]} {self.ratios[k]:.3g} × noise"

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
        """The figures behind an agreement, as text."""
        worst = f"Largest residual of a channel: {self.worst}, rms."
        overall = f"All channels: {self.overall:.3g} × noise."
        return numbers.minus(f"{worst} {overall} A channel agrees below {AGREES:g} × noise.")


def agreements(
    recording: Recording, simulators: Sequence[Simulator], noise: np.ndarray
) -> list[Agreement]:
    """Agreement of each simulator with a recording whose noise of one row is (6,) [N, N·m]."""
    residuals = [np.nanmean((recording.wrench - s.reading) ** 2, axis=0) for s in simulators]
    return [
        Agreement(s.name, np.sqrt(r) / noise, np.sqrt(r))
        for s, r in zip(simulators, residuals, strict=True)
    ]


def best(of_all: Sequence[Agreement]) -> Agreement:
    """The agreement with the least residual."""
    return min(of_all, key=lambda a: a.overall)


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
    """The page that `report` writes."""
    known, noise = simulators(recording, files), noise_of(recording)
    judged = agreements(recording, known, noise)
    nearest, name = best(judged), PurePath(recording.name).name
    fits = [s for s in known if s.fitted]
    drawn = [draw(chart) for chart in _charts(recording, known, noise)]
    context = {
        "verdict": "unknown" if nearest.differing else "none",
        "badge": "✗ differs" if nearest.differing else "✓ agrees",
        "name": name,
        "robot": recording.metadata.robot,
        "best": nearest,
        "what": _what(recording),
        "simulators": judged,
        "channels": CHANNELS,
        "noise": noise,
        "tool": _tool(robot_of(recording), fits[-1]) if fits else [],
        "heat": drawn[0],
        "series": drawn[1:],
        "next": _next(nearest, bool(fits), name),
        "data": [*recording_facts(recording, recording.name), *provenance([recording.name])],
        "command": command,
    }
    return ReportPage(context, "recording", drawn)


def _charts(recording: Recording, known: Sequence[Simulator], noise: np.ndarray) -> list[Chart]:
    """Residuals as a map, then readings and their residual, and the joints, over time."""
    order, unit = order_of(recording)
    poses, measured = unit == "pose", recording.wrench
    residuals = {s.name: np.asarray((measured - s.reading) / noise) for s in known}
    axis = Axis("pose") if poses else Axis("time", "s")
    charts = [figures.heat(residuals, CHANNELS, order, axis, "poses" if poses else "rows")]
    caption = "On the left measured and simulated, on the right their difference."
    for title, first in (("Forces", 0), ("Torques", 3)):
        panels = []
        for k in range(first, first + 3):
            readings = {"measured": measured[:, k]} | {s.name: s.reading[:, k] for s in known}
            panels.append((Axis(CHANNELS[k], UNITS[k]), readings))
            differences = {name: residual[:, k] for name, residual in residuals.items()}
            panels.append((Axis(f"{CHANNELS[k]}, residual", "noise"), differences))
        charts.append(_over_time(recording, f"{title} over time", panels, caption))
    joints = [joint_axis(joint, k) for k, joint in enumerate(robot_of(recording).joints, start=1)]
    q = [(axis, {"": f * recording.q[:, k]}) for k, (axis, f) in enumerate(joints)]
    return [*charts, _over_time(recording, "Joints over time", q)]


def _over_time(
    recording: Recording, title: str, panels: Sequence[tuple[Axis, Mapping[str, np.ndarray]]],
    caption: str = "",
) -> Chart:  # fmt: skip
    """Curves (N,) by name, two panels beside each other; simulators are dashed beside measured."""
    t, rows = recording.t - recording.t[0], np.arange(1, len(recording) + 1)
    drawn, note = [], ""
    for axis, curves in panels:
        simulated = [name for name in curves if name not in ("", "measured")]
        roles = dict(zip(simulated, _SIMULATED, strict=False))
        dashed = len(simulated) < len(curves)
        series = [
            Series(name, "line", t, y, role=roles.get(name, "measured"),
                   dashed=dashed and name in roles, ids=rows)
            for name, y in curves.items()
        ]  # fmt: skip
        kept, note = thinned(series)
        drawn.append(Panel(Axis("time", "s"), axis, kept, zero=not dashed, height=0.9))
    return Chart(title.split()[0].lower(), title, tuple(drawn), 2, True, caption, note)


def _what(recording: Recording) -> dict[str, str]:
    at_rest, (order, unit) = recording.metadata.mode == "static", order_of(recording)
    span = float(recording.t[-1] - recording.t[0])
    figure = f"{span:.0f} s {'at rest' if at_rest else 'of motion'}"
    if unit == "pose":
        figure = f"{len(np.unique(order))} poses at rest"
    source = recording.metadata.source or "an unstated source"
    return {"figure": figure, "text": f"{len(recording):,} rows in {span:,.0f} s, from {source}."}


def _tool(robot: SimulatedRobot, fitted: Simulator) -> list[tuple[str, str]]:
    """Label and text of a fit's tool."""
    tool = robot.tool(fitted.theta)
    place = ", ".join(f"{1e3 * float(x):.4g}" for x in tool.cog)
    return [
        ("mass", numbers.minus(f"{float(tool.mass):.4g} kg")),
        ("centre of gravity", numbers.minus(f"({place}) mm")),
    ]


def _next(nearest: Agreement, fitted: bool, name: str) -> list[str]:
    diagnose = f"wrenchbed diagnose {name} --out found"
    if not nearest.differing:
        return [
            f"Use this simulator: no channel's residual reaches {AGREES:g} times its noise.",
            f"{diagnose} tests for effects below the noise of a row.",
        ]
    if not fitted:
        return [f"wrenchbed calibrate {name} --out fit.json fits mass, centre of gravity and bias."]
    return [f"{diagnose} locates the residual and names its cause."]
