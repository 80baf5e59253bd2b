"""`wrenchbed diagnose`: run a diagnosis, write its files, and print it in 80 columns."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import tyro
from rich.console import Group
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

import wrenchbed as wb
from wrenchbed.cli import console, effort_diagnosis
from wrenchbed.data.outputs import Kind
from wrenchbed.errors import DiagnosisError, MissingExtraError, ParameterError, WrenchbedWarning
from wrenchbed.files import atomic_folder

if TYPE_CHECKING:
    from wrenchbed.diagnosis.diagnose import Findings, Progress
    from wrenchbed.diagnosis.explain.reliability import Reliability
    from wrenchbed.diagnosis.gap.result import Diagnosis
    from wrenchbed.diagnosis.next.dry_run import DryRun
    from wrenchbed.pages.artist import Artist


Made = TypeVar("Made")


@dataclass(frozen=True)
class DryRunOptions:
    """With --dry-run: how the plan would be recorded.

    Attributes:
        samples: Rows a pose.
        rate: Rows a second [Hz].
    """

    samples: int = 60
    rate: float = 100.0


@dataclass(frozen=True)
class LearningOptions:
    """How the probabilities of a wrench's causes are learnt.

    Attributes:
        look_alikes: Learn how often such claims are right from so many simulated robots that do
            what this one did (1 to 5 s each, kept for the next time); 0: use what is known, or
            learn from 100 where nothing is known of such a robot.
        fast: Learn nothing: probabilities are then of other robots.
    """

    look_alikes: int = 0
    fast: bool = False


@dataclass(frozen=True)
class EffortOptions:
    """What is diagnosed: the wrench, or the joint efforts.

    Attributes:
        channels: What is diagnosed; the wrench, the joint efforts (tau1 … or i1 …) of a recording
            without one, or both together.
        drives: Of joint efforts: what calibrate wrote of a healthy recording of this robot, in
            place of the drive values that the recording states.
    """

    channels: Literal["wrench", "effort", "both"] | None = None
    drives: Path | None = None


def diagnose(
    recordings: tyro.conf.Positional[tuple[Path, ...]],
    /,
    out: Path | None = None,
    dry_run: bool = False,
    seed: int = 0,
    as_json: console.Json = False,
    learning: LearningOptions = LearningOptions(),
    rehearsed: DryRunOptions = DryRunOptions(),
    efforts: EffortOptions = EffortOptions(),
) -> None:
    """Say where the sim-to-real gap lies, which effect causes it and how far it shrinks.

    Args:
        recordings: Parquet file, or several of one robot: with a second payload, of another day,
            of a proposed experiment; with --dry-run a plan that has not been recorded yet.
        out: Folder for diagnosis.json, twin.json, report.html, diagnosis.rrd and plans of what to
            do next.
        dry_run: Only say which effects such a recording could show, and which look the same.
        seed: Of the split into folds, each of which is held out once.
        as_json: Print the result as JSON.
        learning: How the probabilities of a wrench's causes are learnt.
        rehearsed: With --dry-run: how the plan would be recorded.
        efforts: What is diagnosed: the wrench, or the joint efforts.
    """
    console.check_seed(seed)
    if not recordings or (len(recordings) > 1 and (dry_run or learning.look_alikes)):
        raise ParameterError(
            "diagnose needs a recording; --dry-run and --look-alikes take just one"
        )
    if dry_run:
        _rehearsed(recordings[0], rehearsed, as_json)
        return
    if out is None:
        raise ParameterError("diagnose needs --out, the folder for its files (or --dry-run)")
    console.check_folder(out, _FILES)
    from wrenchbed.pages.artist import Artist

    data = [wb.Recording.read(path) for path in recordings]
    if effort_diagnosis.asked(data, efforts.channels):
        both = efforts.channels == "both"
        effort_diagnosis.run(data, efforts.drives, out, seed, as_json, wrench=both)
        return
    if efforts.drives is not None:
        raise ParameterError("--drives goes with joint efforts: add --channels effort")
    command = ["diagnose", *recordings, "--out", out, *(["--seed", seed] if seed else [])]
    with Artist() as artist:
        learnt = None
        if not learning.fast and len(data) == 1:
            learnt = _learnt(data[0], learning.look_alikes, seed)
        steps = 7 if len(data) == 1 else 3 * len(data) + 3
        with console.progress("diagnosing", steps, alike=False) as report:
            result = _diagnosed(data, seed, learnt, lambda step: report(1, step))
        for name in result.plans:
            console.check_out(out / name, Kind.PLAN, lock=False)
        with atomic_folder(out) as folder:
            written = _write(result, folder, console.command(*command), artist)
    console.answer(result.diagnosis.to_json(), as_json, None if as_json else diagnosis(result))
    if not as_json:
        console.say(f"{', '.join(written)} → {out}")


_FILES = {
    "diagnosis.json": Kind.DIAGNOSIS, "twin.json": Kind.TWIN, "report.html": Kind.PAGE,
    "diagnosis.rrd": Kind.PICTURE,
}  # fmt: skip


def _write(result: Findings, folder: Path, command: str, artist: Artist) -> list[str]:
    """Write all files of a diagnosis; names of those that could be made, without plans.

    The artist draws the page's figures while rerun's picture is made.
    """
    from wrenchbed.reports.diagnosis_page import page_to_come

    result.write(folder)
    page, picture = "report.html", "diagnosis.rrd"
    coming = _tried(page, lambda: page_to_come(result, command, artist))
    _tried(picture, lambda: _draw(result, folder / picture, command))
    if coming is not None:
        _tried(page, lambda: coming().write(folder / page))
    return [name for name in _FILES if (folder / name).exists()]


def _tried(name: str, make: Callable[[], Made]) -> Made | None:
    """What is made for a file; None, with a warning, where it needs a library that is missing."""
    try:
        return make()
    except MissingExtraError as error:
        warnings.warn(f"no {name}: {error}", WrenchbedWarning, stacklevel=1)
        return None


def _diagnosed(
    data: list[wb.Recording], seed: int, known: Reliability | None, progress: Progress
) -> Findings:
    from wrenchbed.diagnosis.diagnose import diagnose as one
    from wrenchbed.diagnosis.several import diagnose_several as several

    if len(data) == 1:
        return one(data[0], seed=seed, reliability=known, progress=progress)
    return several(data, seed=seed, reliability=known, progress=progress)


_BY_ITSELF = 100
"""Look-alikes of a recording from a robot, or of a kind, that nothing was learnt on; estimate."""


def _learnt(data: wb.Recording, count: int, seed: int) -> Reliability | None:
    """How often claims are right at this design; None where the package knows."""
    from wrenchbed.diagnosis.explain.reliability import of_package

    known = of_package(data)
    if not count and (known is None or not known.elsewhere):
        return None
    from wrenchbed.benchmark.scoring.reliability_at_design import reliability_at_design
    from wrenchbed.diagnosis.prepare.prepare_recording import prepare

    prepare(data)  # refuses what cannot be diagnosed, before anything is learnt
    try:
        with console.progress("look-alikes", count or _BY_ITSELF) as report:
            return reliability_at_design(data, count or _BY_ITSELF, seed=seed, report=report)
    except DiagnosisError as error:
        if count:
            raise
        warnings.warn(f"nothing was learnt: {error}", WrenchbedWarning, stacklevel=2)
        return None


def _draw(result: Findings, path: Path, command: str) -> None:
    from wrenchbed.viewer import diagnosis_view

    diagnosis_view(result, path, command)


def _rehearsed(path: Path, options: DryRunOptions, as_json: bool) -> None:
    from wrenchbed.diagnosis.next.dry_run import dry_run as run

    result = run(wb.Plan.read(path), options.samples, options.rate)
    answer = {
        "plan": str(path),
        "effects": [
            {
                "effect": s.effect,
                "variant": s.variant,
                "smallest": s.smallest,
                "size": {k: {"value": v, "unit": u} for k, (v, u) in s.size.items()},
                "detectable": s.detectable,
                "rivals": list(s.rivals),
            }
            for s in result.showings
        ],
        "cannot_tell": list(result.cannot_tell),
    }
    console.answer(answer, as_json, isolability(path.name, result))


_COLOURS = {
    "none": "green", "identified": "cyan", "ambiguous": "yellow", "partial": "yellow",
    "unknown": "magenta",
}  # fmt: skip


def diagnosis(found: Findings) -> Group:
    """The three answers, then what the data cannot tell and what to do next; as on the page."""
    from wrenchbed.reports import sentences

    d = found.diagnosis
    head = Text.assemble(
        ("diagnosis ", "bold"),
        f"{', '.join((d.recording, *d.others))}  {d.robot}, {d.seconds:.1f} s",
    )  # fmt: skip
    answer = f": {sentences.headline(found)}"
    verdict = Text.assemble((d.verdict, f"bold {_COLOURS[d.verdict]}"), answer)
    parts: list[Any] = [head, verdict, *(_line(f"set aside: {o['sentence']}") for o in d.outliers)]
    parts += ["", Text("where", style="bold"), _line(f"{sentences.place(found)}.")]
    parts += [_line(text) for text in sentences.places(found)]
    parts += ["", Text("which", style="bold")]
    parts.append(_causes(d) if d.which else _line(sentences.without_cause(found)))
    parts.append(_line(_probabilities(d)))
    parts += ["", Text("how far", style="bold"), *_gap(found)]
    told = {r.sentence for r in found.rows}
    notes = [*(r.sentence for r in found.rows), *(n for n in d.notes if n not in told)]
    for title, lines in (("what this data cannot tell", d.cannot_tell), ("note", notes)):
        if lines:
            parts += ["", Text(title, style="bold"), *map(_line, lines)]
    steps = [str(n["sentence"]) for n in d.next] or [sentences.nothing_more(found)]
    parts += ["", Text("what next", style="bold"), *map(_line, steps)]
    return Group(*parts)


def isolability(name: str, result: DryRun) -> Group:
    """Which effects a plan could show, from what size on."""
    from wrenchbed.pages import numbers

    table = Table(box=None, padding=(0, 2, 0, 0), header_style="dim")
    table.add_column("effect", no_wrap=True)
    table.add_column("shows from", justify="right", no_wrap=True)
    table.add_column("looks the same as")
    for s in sorted(result.showings, key=lambda s: s.smallest or 1e9):
        if s.smallest is None:
            cell = "never"
        else:
            parameter, (value, unit) = next(iter(s.size.items()))
            text = numbers.rough(parameter, value, unit)
            cell = f"{text} {parameter}" if s.detectable else f"({text}) {parameter}"
        style = "" if s.detectable else "dim"
        table.add_row(Text(s.effect, style=style), Text(cell, style=style), ", ".join(s.rivals))
    parts: list[Any] = [Text(f"what {name} could show", style="bold"), table]
    parts.append(_line("in brackets: only at an implausible size"))
    if result.cannot_tell:
        parts += ["", Text("what it cannot tell", style="bold"), *map(_line, result.cannot_tell)]
    return Group(*parts)


def _line(text: str) -> Padding:
    return Padding(Text(text), (0, 0, 0, 2))


def _causes(d: Diagnosis) -> Table:
    from wrenchbed.pages import numbers

    table = Table(box=None, padding=(0, 2, 0, 2), header_style="dim")
    table.add_column("effect")
    table.add_column("probability", justify="right", no_wrap=True)
    table.add_column("parameters")
    for cause in d.which:
        name = str(cause["effect"])
        if cause["rivals"]:
            name += "\nor " + ", ".join(cause["rivals"])
        text = "\n".join(_parameter(cause, k, v) for k, v in list(cause["parameters"].items())[:6])
        more = len(cause["parameters"]) - 6
        text += f"\n… {more} more" * (more > 0)
        table.add_row(name, numbers.chance(float(cause["probability"])), text)
    return table


def _parameter(cause: Mapping[str, Any], name: str, text: dict[str, Any]) -> str:
    from wrenchbed.diagnosis.prepare.configuration import STATED
    from wrenchbed.pages.numbers import quantity

    return f"{name} {quantity(name, text, signed=cause['effect'] in STATED)}"


def _probabilities(d: Diagnosis) -> str:
    from wrenchbed.reports.tables import candidates

    leading = ", ".join(f"{c['key']} {c['p']}" for c in candidates(d.probabilities))
    return f"leading cause: {leading}; at least 90 % together: {', '.join(d.set90)}"


_MEASURE = (
    "gap: mean square of measured minus simulated in units of the noise of one row, minus that "
    "noise; calibrated: bias, mass and CoG fitted"
)


def _gap(found: Findings) -> list[Any]:
    from wrenchbed.pages import numbers
    from wrenchbed.reports import sentences, tables

    g, far = found.diagnosis.gap, sentences.distance(found)
    table = Table(box=None, padding=(0, 2, 0, 2), show_header=False)
    table.add_column(no_wrap=True)
    table.add_column(justify="right", no_wrap=True)
    for label, value, kind in tables.gaps(found):
        if kind != "box":
            table.add_row(label, numbers.gap(value))
    table.add_row("held-out rows", f"{g.rows:,}")
    text, extra = f"{far['figure']}. {far['text']}", sentences.black_box(g)
    told = text if extra in text else f"{text} {extra}"
    return [_line(told.removeprefix(". ")), table, _line(_MEASURE)]
