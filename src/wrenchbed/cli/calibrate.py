"""`wrenchbed calibrate`: identify a robot's parameters; the fit as a table in 80 columns."""

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro
from rich.console import Group
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

import wrenchbed as wb
from wrenchbed.calibration.fit import IdentifiedValue
from wrenchbed.cli import console
from wrenchbed.cli.console import Json
from wrenchbed.data.outputs import Kind
from wrenchbed.errors import ParameterError
from wrenchbed.pages.numbers import HUMAN, decimals
from wrenchbed.physics.wrench import CHANNELS


@dataclass(frozen=True)
class TouchArguments:
    """Contacts of the tool's tip with known points.

    Attributes:
        touches: Recording of touches (columns px py pz) of the same robot, fitted together.
        touch_std: With --touches: how far the tip sits from its point, per axis [m]; 5e-5.
    """

    touches: Path | None = None
    touch_std: float | None = None

    def read(self) -> wb.Touches | None:
        """The touches, if any."""
        if self.touches is None:
            if self.touch_std is not None:
                raise ParameterError("--touch-std goes with --touches")
            return None
        std = {} if self.touch_std is None else {"std": self.touch_std}
        return wb.Touches.of(wb.Recording.read(self.touches), **std)


def calibrate(
    recording: tyro.conf.Positional[Path],
    /,
    fit: wb.Options,
    contact: TouchArguments,
    out: Path | None = None,
    truth: Path | None = None,
    rrd: Path | None = None,
    as_json: Json = False,
) -> None:
    """Identify a robot's parameters: value ± standard uncertainty, and what the data cannot tell.

    Args:
        recording: Parquet file.
        out: Fit to write, JSON.
        truth: JSON {name: value} of a simulated robot, shown beside the estimates.
        rrd: Picture to write: the target workspace coloured by position error before and after
            where the robot has one and the fit bounds it, else the recording with the fit.
        as_json: Print the result as JSON.
    """
    console.check_out(out, Kind.FIT, recording, contact.touches, truth)
    console.check_out(rrd, Kind.PICTURE, recording, contact.touches, truth, out)
    known = None if truth is None else console.parameters(truth)
    data = wb.Recording.read(recording)
    with console.progress(f"calibrate {len(data):,} rows", None):
        result = wb.calibrate(data, fit, contact.read())
    for name, value in (known or {}).items():
        if (
            name not in result.theta
            or isinstance(value, bool)
            or not isinstance(value, int | float)
        ):
            raise ParameterError(f"{truth}: {name!r} = {value!r} is no parameter with a number")
    if out is not None:
        result.write(out)
    if rrd is not None:
        _draw(result, data, rrd)
    console.answer(result.to_json(), as_json, fit_table(result, known))
    if out is not None and not as_json:
        console.say(f"fit → {out}")


def _draw(result: wb.Fit, data: wb.Recording, rrd: Path) -> None:
    from wrenchbed.viewer import calibration_view, recording_view

    if result.target_rms is not None:
        calibration_view(result, rrd)
        return
    with tempfile.TemporaryDirectory(prefix="wrenchbed-") as folder:
        result.write(Path(folder) / "fit.json")
        recording_view(data, rrd, [Path(folder) / "fit.json"])


def fit_table(result: wb.Fit, truth: Mapping[str, float] | None = None) -> Group:
    """A calibration: parameters, residuals, what the data cannot tell, and its status.

    With the true values of a simulated robot, each true value is printed beside its estimate.
    """
    rows = f"{result.rows} rows"
    amount = rows if result.rows == result.poses else f"{result.poses} poses, {rows}"
    head = Text.assemble(
        ("calibration ", "bold"), f"{result.recording}  {result.robot}, {amount}",
    )  # fmt: skip
    parts: list[Any] = [head, "", _parameters(result, truth), "", _residuals(result), ""]
    sections = [("what this data cannot tell", _limits(result))]
    if result.touches is not None:
        seats = result.touches
        text = (
            f"{seats.count} with {1e3 * seats.std:g} mm per axis; the least fitting, number "
            f"{seats.worst}, lies {seats.distance:.1f} σ from where all else puts it"
        )
        sections.append(("touches", [text]))
    if result.target_rms is not None:
        text = f"{1e3 * result.target_rms:.3g} mm rms expected in the robot's target workspace"
        sections.append(("position of the tool", [text]))
    sections.append(("status", [result.status]))
    for title, lines in sections:
        if lines:
            parts += [Text(title, style="bold"), *(Padding(Text(x), (0, 0, 0, 2)) for x in lines)]
            parts += [""] * (title != "status")
    return Group(*parts)


def _parameters(result: wb.Fit, truth: Mapping[str, float] | None) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="dim")
    table.add_column("parameter", no_wrap=True)
    for name in ("value", "± std", "start"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    if truth is not None:
        table.add_column("truth", justify="right", no_wrap=True)
        table.add_column("off by", justify="right", no_wrap=True)
    for p in result.identified:
        unit, factor = HUMAN.get(p.unit, (p.unit, 1.0))
        cells = [p.name, *_numbers(p, factor), unit]
        if truth is not None:
            true = truth.get(p.name, p.nominal)
            error = f"{(p.value - true) / p.std:+.1f} σ" if p.std else ""
            cells += [f"{true * factor:.7g}", error]
        table.add_row(*cells)
    return table


def _numbers(p: IdentifiedValue, factor: float) -> tuple[str, str, str]:
    """Value, uncertainty and initial value with as many decimals as the uncertainty deserves."""
    initial = p.nominal * factor
    start = f"{initial:.4g}" if abs(initial) > 1e-12 else "0"
    if p.std is None:
        return f"{p.value * factor:.4f}", "in sum only", start
    std = p.std * factor
    return f"{p.value * factor:.{decimals(std)}f}", f"{std:.2g}", start


def _residuals(result: wb.Fit) -> Table:
    table = Table(box=None, padding=(0, 1, 0, 0), header_style="dim")
    table.add_column("per channel [N, N·m]", no_wrap=True)
    for channel in CHANNELS:
        table.add_column(channel, justify="right", no_wrap=True, min_width=7)
    noise = result.noise
    table.add_row("residual rms", *map(_short, result.residual_rms))
    table.add_row(f"one row, {noise.source}", *map(_short, noise.row))
    table.add_row("effective rows", *(f"{w:.0f}" for w in noise.effective))
    return table


def _short(x: float) -> str:
    return f"{x:.4f}" if x >= 1e-3 else f"{x:.1e}" if x > 0 else "0"


def _limits(result: wb.Fit) -> list[str]:
    """What the data cannot identify; empty if it identifies everything."""
    o = result.observability
    no_effect = [f"no effect on any reading: {', '.join(o.no_effect)}"] * bool(o.no_effect)
    lines = no_effect + [r.sentence for r in o.redundancies]
    return [f"rank {o.rank} of {len(o.names)} parameters", *lines] if lines else []
