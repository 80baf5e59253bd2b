"""`wrenchbed calibrate`: identify a robot's parameters; the fit as a table in 80 columns."""

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import tyro
from rich.console import Group
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

import wrenchbed as wb
from wrenchbed.calibration.fit_words import FitWords, fit_words
from wrenchbed.cli import console
from wrenchbed.cli.console import Json
from wrenchbed.cli.drive_fit import drive_fit_table
from wrenchbed.data.outputs import Kind
from wrenchbed.errors import ParameterError
from wrenchbed.pages.numbers import HUMAN
from wrenchbed.physics.wrench import CHANNELS


@dataclass(frozen=True)
class DataArguments:
    """What is fitted: the wrench, with touches of known points, or the joint efforts.

    Attributes:
        channels: What is fitted; the wrench, or the joint efforts (tau1 … or i1 …) of a recording
            without one. Of efforts, --free takes drive, drive.coulomb, drive.viscous, drive.offset,
            drive.inertia, drive.constant, tool, link.
        constants: Known drive constants of motor currents, one a joint, gear included [N·m/A].
        touches: Recording of touches (columns px py pz) of the same robot, fitted together.
        touch_std: With --touches: how far the tip sits from its point, per axis [m]; 5e-5.
    """

    channels: Literal["wrench", "effort"] | None = None
    constants: tuple[float, ...] | None = None
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
    given: DataArguments,
    out: Path | None = None,
    truth: Path | None = None,
    rrd: Path | None = None,
    report: Path | None = None,
    as_json: Json = False,
) -> None:
    """Identify a robot's parameters: value ± standard uncertainty, and what the data cannot tell.

    Args:
        recording: Parquet file.
        out: Fit to write, JSON.
        truth: JSON {name: value} of a simulated robot, shown beside the estimates.
        rrd: Picture to write: the recording with the fit.
        report: Page to write, HTML: the fit with correlations and the residual of each pose.
        as_json: Print the result as JSON.
    """
    console.check_out(out, Kind.FIT, recording, given.touches, truth)
    console.check_out(rrd, Kind.PICTURE, recording, given.touches, truth, out)
    console.check_out(report, Kind.PAGE, recording, given.touches, truth, out, rrd)
    known = None if truth is None else console.parameters(truth)
    data = wb.Recording.read(recording)
    if given.channels == "effort" or (given.channels is None and not data.has_wrench):
        others = {"--hold": fit.hold, "--prior": fit.prior, "--touches": given.touches,
                 "--truth": truth, "--rrd": rrd, "--report": report,
                 "--loss": fit.loss != "linear"}  # fmt: skip
        if refused := [flag for flag, value in others.items() if value]:
            raise ParameterError(f"{refused[0]} is for wrenches: leave it out, efforts have none")
        _efforts(data, fit, given.constants, out, as_json)
        return
    if given.constants is not None:
        raise ParameterError("--constants is for joint efforts: leave it out, or --channels effort")
    with console.progress(f"calibrate {len(data):,} rows", None):
        result = wb.calibrate(data, fit, given.read())
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
    if report is not None:
        _page(result, data, report, _command(recording, fit, given, out, report))
    console.answer(result.to_json(), as_json, fit_table(result, known))
    for what, path in (("fit", out), ("page", report)):
        if path is not None and not as_json:
            console.say(f"{what} → {path}")


def _efforts(
    data: wb.Recording,
    options: wb.Options,
    constants: tuple[float, ...] | None,
    out: Path | None,
    as_json: bool,
) -> None:
    with console.progress(f"calibrate {len(data):,} rows", None):
        result = wb.calibrate_efforts(data, options.free, constants=constants, force=options.force)
    if out is not None:
        result.write(out)
    console.answer(result.to_json(), as_json, drive_fit_table(result))
    if out is not None and not as_json:
        console.say(f"fit → {out}")


def _command(
    recording: Path, fit: wb.Options, given: DataArguments, out: Path | None, report: Path
) -> str:
    """The line that makes a page again."""
    words: list[object] = ["calibrate", recording]
    for flag, names in (("--free", fit.free), ("--hold", fit.hold)):
        words += [flag, *names] if names else []
    words += ["--prior"] * fit.prior + ["--force"] * fit.force
    words += ["--loss", fit.loss] if fit.loss != "linear" else []
    words += ["--touches", given.touches] if given.touches is not None else []
    words += ["--touch-std", given.touch_std] if given.touch_std is not None else []
    words += ["--out", out] if out is not None else []
    return console.command(*words, "--report", report)


def _page(result: wb.Fit, data: wb.Recording, path: Path, command: str) -> None:
    from wrenchbed.reports.fit_page import fit_page

    fit_page(result, data, command).write(path)


def _draw(result: wb.Fit, data: wb.Recording, rrd: Path) -> None:
    from wrenchbed.viewer.recordings import recording_view

    with tempfile.TemporaryDirectory(prefix="wrenchbed-") as folder:
        result.write(Path(folder) / "fit.json")
        recording_view(data, rrd, [Path(folder) / "fit.json"])


def fit_table(result: wb.Fit, truth: Mapping[str, float] | None = None) -> Group:
    """A calibration: parameters, residuals, what the data cannot tell, and its status.

    With the true values of a simulated robot, each true value is printed beside its estimate.
    """
    words = fit_words(result)
    head = Text.assemble(("calibration ", "bold"), f"{result.recording}  {words.data}")
    parts: list[Any] = [head, "", _parameters(result, words, truth), "", _residuals(words), ""]
    for title, lines in words.sections:
        parts += [Text(title, style="bold"), *(Padding(Text(x), (0, 0, 0, 2)) for x in lines)]
        parts += [""] * (title != "status")
    return Group(*parts)


def _parameters(result: wb.Fit, words: FitWords, truth: Mapping[str, float] | None) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="dim")
    table.add_column("parameter", no_wrap=True)
    for name in ("value", "± std", "start"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    if truth is not None:
        table.add_column("truth", justify="right", no_wrap=True)
        table.add_column("off by", justify="right", no_wrap=True)
    for p, told in zip(result.identified, words.parameters, strict=True):
        cells = [told.name, told.value, told.std, told.start, told.unit]
        if truth is not None:
            _, factor = HUMAN.get(p.unit, (p.unit, 1.0))
            true = truth.get(p.name, p.nominal)
            error = f"{(p.value - true) / p.std:+.1f} σ" if p.std else ""
            cells += [f"{true * factor:.7g}", error]
        table.add_row(*cells)
    return table


def _residuals(words: FitWords) -> Table:
    table = Table(box=None, padding=(0, 1, 0, 0), header_style="dim")
    table.add_column("per channel [N, N·m]", no_wrap=True)
    for channel in CHANNELS:
        table.add_column(channel, justify="right", no_wrap=True, min_width=8)
    for label, values in words.residuals:
        table.add_row(label, *values)
    return table
