"""`wrenchbed calibrate`: identify a robot's parameters; the fit as a table in 80 columns."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import tyro
from rich.console import Group
from rich.table import Table
from rich.text import Text

import wrenchbed as wb
from wrenchbed.calibration.fit import IdentifiedValue
from wrenchbed.calibration.fit_words import FitWords, parameter_words
from wrenchbed.calibration.tracker_result import TrackerFit
from wrenchbed.cli import console
from wrenchbed.cli.console import Json
from wrenchbed.data.overwrite_rules import Kind
from wrenchbed.data.recording import TARGET
from wrenchbed.drives.effort_fit import DriveFit
from wrenchbed.errors import ParameterError
from wrenchbed.pages.numbers import HUMAN, percent
from wrenchbed.physics.wrench import CHANNELS

_OF = {"effort": "efforts", "pose": "a tracker's readings", "command": "commands"}
"""Words for the fitted readings other than the wrench, by channel."""


@dataclass(frozen=True)
class DataArguments:
    """Options of `calibrate`: which channels of a recording are fitted, and a recording of touches
    (contacts at known points) to fit together with it."""

    # What is fitted; the wrench, or the joint efforts (tau1 … or i1 …) of a recording without one,
    # or the places of a target (mx my mz), or what position servos were told (q_target1 …). Of
    # efforts, --free takes drive, drive.coulomb, drive.viscous, drive.offset, drive.inertia,
    # drive.constant, tool, link; of a tracker the geometry (a2, dq3, …) and the joints'
    # compliances (compliance.q?); of commands servo, tool.
    channels: Literal["wrench", "effort", "pose", "command"] | None = None
    # Known drive constants of motor currents, one a joint, gear included [N·m/A].
    constants: tuple[float, ...] | None = None
    # Recording of touches (columns px py pz) of the same robot, fitted together.
    touches: Path | None = None
    # With --touches: how far the tip sits from its point, per axis [m]; 5e-5.
    touch_std: float | None = None

    def read(self) -> wb.Touches | None:
        """Read touches (tip on known points) from the file of ``--touches``; None without one."""
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
    report: Path | None = None,
    as_json: Json = False,
) -> None:
    """Identify a robot's parameters: value ± standard uncertainty, and what the data cannot tell.

    Args:
        recording: Parquet file.
        out: Fit to write, JSON.
        truth: JSON {name: value} of a simulated robot, shown beside the estimates.
        report: Page to write, HTML: the fit with correlations and the residual of each pose.
    """
    console.check_out(out, Kind.FIT, recording, given.touches, truth)
    console.check_out(report, Kind.PAGE, recording, given.touches, truth, out)
    known = None if truth is None else console.parameters(truth)
    data = wb.Recording.read(recording)
    channels = given.channels or _channels(data)
    if channels != "wrench":
        others: dict[str, object] = {
            "--touches": given.touches, "--truth": truth, "--report": report,
            "--loss": fit.loss != "linear",
        }  # fmt: skip
        if channels != "pose":
            others = {"--hold": fit.hold, "--prior": fit.prior, **others}
        if refused := [flag for flag, value in others.items() if value]:
            raise ParameterError(f"{refused[0]} is for wrenches: leave it out of {_OF[channels]}")
    if channels != "effort" and given.constants is not None:
        other = ", or --channels effort" if "i1" in data.columns else ""
        raise ParameterError(f"--constants is for joint efforts: leave it out{other}")
    with console.progress(f"calibrate {len(data):,} rows", None):
        result, display = _fitted(channels, data, fit, given, truth, known)
    if out is not None:
        result.write(out)
    if report is not None and isinstance(result, wb.Fit):
        from wrenchbed.reports.fit_page import fit_page

        fit_page(result, data, console.command()).write(report)
    named = (("fit", out), ("page", report))
    written = [f"{what} → {path}" for what, path in named if path is not None]
    console.answer(result.to_json(), as_json, display, *written)


def _channels(data: wb.Recording) -> str:
    """Channels to fit by default, as for ``--channels``: wrench if recorded, else pose, effort,
    command."""
    if data.has_wrench:
        return "wrench"
    if data.only_commanded:
        return "command"
    if data.effort is None and TARGET[0] not in data.columns:
        raise ParameterError(
            f"{data.name}: no calibration without a wrench, a tracker, efforts or commands: run "
            "wrenchbed diagnose, which compares other sensors too"
        )
    return "pose" if data.effort is None else "effort"


def _fitted(
    channels: str, data: wb.Recording, options: wb.Options, given: DataArguments,
    truth: Path | None, known: Mapping[str, float] | None,
) -> tuple[wb.Fit | DriveFit | TrackerFit, Group]:  # fmt: skip
    """Fit ``channels`` (wrench, effort, pose or command) of a recording; return the fit and its
    table. The table of a wrench's fit shows ``known``, the true values in the file ``truth``."""
    if channels == "effort":
        efforts = wb.calibrate_efforts(
            data, options.free, constants=given.constants, force=options.force
        )
        return efforts, drive_fit_table(efforts)
    if channels == "command":
        servos = wb.calibrate_servos(data, options.free, force=options.force)
        return servos, drive_fit_table(servos)
    if channels == "pose":
        places = wb.calibrate_tracker(data, options)
        return places, tracker_fit_table(places)
    result = wb.calibrate(data, options, given.read())
    for name, value in (known or {}).items():
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if name not in result.theta or not number:
            raise ParameterError(f"{truth}: {name!r} = {value!r} is no parameter with a number")
    return result, fit_table(result, known)


def tracker_fit_table(fit: TrackerFit) -> Group:
    """Table of a fit to a laser tracker's readings: parameters, errors, unknowns, status."""
    rows = f"{fit.poses} poses, {fit.rows} rows"
    head = Text.assemble(("places of a target ", "bold"), f"{fit.recording}  {fit.robot}, {rows}")
    errors = console.table("|rms distance", ">mm", space=1)
    for label, size in fit.errors:
        errors.add_row(label, f"{1e3 * size:.3g}")
    parts: list[Any] = [head, "", _parameters(fit.identified), "", errors]
    parts += console.section("what this data cannot tell", fit.cannot_tell)
    return Group(*parts, *console.section("status", [fit.status]))


def fit_table(result: wb.Fit, truth: Mapping[str, float] | None = None) -> Group:
    """Table of a calibration: parameters, residuals, what the data cannot tell, status.

    With the true values of a simulated robot, each true value is printed beside its estimate.
    """
    words = FitWords(result)
    head = Text.assemble(("calibration ", "bold"), f"{result.recording}  {words.data}")
    channels = (f">{channel:>8}" for channel in CHANNELS)
    residuals = console.table("|per channel [N, N·m]", *channels, space=1)
    for label, values in words.residuals:
        residuals.add_row(label, *values)
    parts: list[Any] = [head, "", _parameters(result.identified, truth), "", residuals]
    for title, lines in words.sections:
        parts += console.section(title, lines)
    return Group(*parts)


def _parameters(
    values: Sequence[IdentifiedValue], truth: Mapping[str, float] | None = None
) -> Table:
    beside = [">truth", ">off by"] if truth is not None else []
    table = console.table("|parameter", ">value", ">± std", ">start", "|unit", *beside)
    for p in values:
        shown = parameter_words(p)
        cells = [shown.name, shown.value, shown.std, shown.start, shown.unit]
        if truth is not None:
            _, factor = HUMAN.get(p.unit, (p.unit, 1.0))
            true = truth.get(p.name, p.nominal)
            error = f"{(p.value - true) / p.std:+.1f} σ" if p.std else ""
            cells += [f"{true * factor:.7g}", error]
        table.add_row(*cells)
    return table


def drive_fit_table(fit: DriveFit) -> Group:
    """Table of a fit of drives or servos: parameters, each joint's rms residual, status."""
    head = Text.assemble(
        (f"joint {fit.word}s ", "bold"), f"{fit.recording}  {fit.robot}, {fit.about}"
    )  # fmt: skip
    parts: list[Any] = [head, "", _parameters(fit.identified), "", _errors(fit)]
    parts += console.section("what this data cannot tell", fit.cannot_tell)
    title = "refuted by the data" if fit.refuted else "status"
    return Group(*parts, *console.section(title, [fit.refuted or fit.status]))


def _errors(fit: DriveFit) -> Table:
    units = [e.unit for e in fit.joints]
    alike = len(set(units)) == 1
    band = "" if fit.cutoff is None else " in the band"
    head = f"|rms{band}{f' [{units[0]}]' * alike}"
    table = console.table(head, *(f">{e.joint}" for e in fit.joints))
    if not alike:
        table.add_row("unit", *units, style="dim")
    table.add_row(f"{fit.word} itself", *(f"{e.measured:.3g}" for e in fit.joints))
    if all(e.nominal is not None for e in fit.joints):
        table.add_row("left by the nominal robot", *(f"{e.nominal:.3g}" for e in fit.joints))
    table.add_row("left by the fit", *(f"{e.left:.3g}" for e in fit.joints))
    table.add_row("on held-out rows", *(f"{e.held_out:.3g}" for e in fit.joints))
    shares = (f"{percent(e.explained)} %" for e in fit.joints)
    table.add_row("explained, held out", *shares)
    return table
