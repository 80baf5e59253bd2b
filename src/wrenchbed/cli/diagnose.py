"""`wrenchbed diagnose`: run a diagnosis, write its files, and print it in 80 columns."""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import tyro
from rich.console import Group
from rich.table import Table
from rich.text import Text

import wrenchbed as wb
from wrenchbed.cli import console
from wrenchbed.data.overwrite_rules import Kind
from wrenchbed.errors import MissingExtraError, ParameterError, WrenchbedWarning
from wrenchbed.files import atomic_folder

if TYPE_CHECKING:
    from wrenchbed.diagnosis.diagnose import Findings
    from wrenchbed.diagnosis.explain.reliability import Reliability
    from wrenchbed.diagnosis.next.dry_run import DryRun
    from wrenchbed.diagnosis.prepare.prepared import Material
    from wrenchbed.reports.answer import Answer

_PAGE, _PICTURE, _DRIVES = "report.html", "diagnosis.rrd", "drives.json"
_FILES = {
    "diagnosis.json": Kind.DIAGNOSIS, "twin.json": Kind.TWIN, _PAGE: Kind.PAGE,
    _PICTURE: Kind.PICTURE,
}  # fmt: skip
"""Files that a diagnosis writes, with their kinds; of joint efforts drives.json and no picture."""
_MATERIAL = re.compile(r"(\d*\.?\d+(?:e-?\d+)?)(N|N[·.*]?m|mm)")
"""A number and its unit, as in ``0.2N``, ``0.01N·m`` or ``0.1mm``."""
_MOST_SIZES = 7
"""Most parameters of a cause that are printed."""
_COLOURS = {
    "none": "green", "identified": "cyan", "ambiguous": "yellow", "partial": "yellow",
    "unknown": "magenta",
}  # fmt: skip


@dataclass(frozen=True)
class DryRunOptions:
    """Options of `diagnose --dry-run`: how the plan would be recorded."""

    samples: int = 60  # Rows a pose.
    rate: float = 100.0  # Rows a second [Hz].


@dataclass(frozen=True)
class EffortOptions:
    """Options of `diagnose`: which channels are diagnosed, and with which known drive values."""

    # What is diagnosed; the wrench, the joint efforts (tau1 … or i1 …) of a recording without one,
    # or both together. Of a recording that holds nothing else, the commands (q_target1 …).
    channels: Literal["wrench", "effort", "both"] | None = None
    # Of joint efforts: what calibrate wrote of a healthy recording of this robot, in place of the
    # drive values that the recording states.
    drives: Path | None = None
    # The residual that counts as a gap of 1, as 0.2N,0.01N·m,0.1mm (force of a slide, torque of
    # a hinge, a tracker's place); one row's noise of what is left out.
    material: str | None = None
    # No effect: nothing has to be learnt first any more. Scripts may still give it.
    fast: bool = False


def diagnose(
    recordings: tyro.conf.Positional[tuple[Path, ...]],
    /,
    out: Path | None = None,
    dry_run: bool = False,
    seed: int = 0,
    as_json: console.Json = False,
    look_alikes: int = 0,
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
        seed: Seed of the split into folds, each of which is held out once.
        look_alikes: Number of simulated robots with known causes that repeat this recording, to
            measure how often such claims are right (1 to 5 s each).
        rehearsed: With --dry-run: how the plan would be recorded.
        efforts: What is diagnosed: the wrench, or the joint efforts.
    """
    console.check_seed(seed)
    if not recordings or (len(recordings) > 1 and (dry_run or look_alikes)):
        raise ParameterError(
            "diagnose needs a recording; --dry-run and --look-alikes take just one"
        )
    if dry_run:
        _rehearsed(recordings[0], rehearsed, as_json)
        return
    if out is None:
        raise ParameterError("diagnose needs --out, the folder for its files (or --dry-run)")
    console.check_folder(out, _FILES)
    data = [wb.Recording.read(path) for path in recordings]
    if efforts.channels == "effort" and data[0].metadata.mode == "static":
        data = [recording.without_wrench() for recording in data]
    if _of_efforts(data, efforts.channels):
        written, answer = _diagnose_efforts(data, efforts, seed, out)
    elif efforts.drives is not None:
        raise ParameterError("--drives goes with joint efforts of a motion: add --channels effort")
    else:
        written, answer = _diagnose_wrench(data, look_alikes, seed, out, efforts.material)
    files = f"{', '.join(written)} → {out}"
    console.answer(answer.d.to_json(), as_json, answer_display(answer), files)


def _of_efforts(data: list[wb.Recording], channels: str | None) -> bool:
    """Whether to diagnose joint efforts: if option ``channels`` is effort or both, or is not given
    and a single recording has no wrench. Torques at rest belong to the diagnosis of the wrench."""
    if all(r.metadata.mode == "static" and r.effort == "tau" for r in data):
        return False
    held = data[0].effort is not None or data[0].only_commanded
    alone = len(data) == 1 and not data[0].has_wrench and held
    return channels in ("effort", "both") or (channels is None and alone)


def _diagnose_efforts(
    data: list[wb.Recording], efforts: EffortOptions, seed: int, out: Path
) -> tuple[list[str], Answer]:
    """Diagnose the joint efforts of a recording, with its wrench if ``efforts.channels`` is both;
    return the names of the files written to folder ``out``, and the answer to print. ``seed``
    splits rows into folds."""
    from wrenchbed.diagnosis.efforts.diagnose_efforts import STEPS, diagnose_efforts
    from wrenchbed.reports.diagnosis_page import effort_page
    from wrenchbed.reports.effort_answer import EffortAnswer

    if len(data) != 1:
        raise ParameterError("diagnose of joint efforts takes one recording")
    console.check_out(out / _DRIVES, Kind.DRIVES, lock=False)
    counts = None if efforts.material is None else material_of(efforts.material)
    with console.progress("diagnosing", STEPS, alike=False) as report:
        findings = diagnose_efforts(
            data[0], drives=efforts.drives, seed=seed, wrench=efforts.channels == "both",
            material=counts, progress=lambda step: report(1, step),
        )  # fmt: skip
    with atomic_folder(out) as folder:
        findings.write(folder)
        _tried(_PAGE, lambda: effort_page(findings, console.command()).write(folder / _PAGE))
        return _names(folder), EffortAnswer(findings)


def _diagnose_wrench(
    data: list[wb.Recording], look_alikes: int, seed: int, out: Path, material: str | None
) -> tuple[list[str], Answer]:  # fmt: skip
    """Diagnose the wrench, or a tracker's readings; return the names of the files written to
    ``out``, and the answer to print. ``look_alikes``: number of simulated robots that measure
    reliability; ``material``: text of the residuals that count as a gap of 1."""
    from wrenchbed.diagnosis.diagnose import diagnose as one
    from wrenchbed.diagnosis.several import diagnose_several as several
    from wrenchbed.reports.diagnosis_page import diagnosis_page
    from wrenchbed.reports.wrench_answer import WrenchAnswer

    counts = None if material is None else material_of(material)
    learnt = _learnt(data[0], look_alikes, seed) if look_alikes and data[0].has_wrench else None
    steps = 7 if len(data) == 1 else 3 * len(data) + 3
    with console.progress("diagnosing", steps, alike=False) as report:
        step = partial(report, 1)
        if len(data) == 1:
            findings = one(data[0], seed=seed, reliability=learnt, material=counts, progress=step)
        else:
            findings = several(data, seed=seed, reliability=learnt, material=counts, progress=step)
    for name in findings.plans:
        console.check_out(out / name, Kind.PLAN, lock=False)
    with atomic_folder(out) as folder:
        findings.write(folder)
        _tried(_PAGE, lambda: diagnosis_page(findings, console.command()).write(folder / _PAGE))
        if data[0].has_wrench:
            _tried(_PICTURE, lambda: _draw(findings, folder / _PICTURE))
        return _names(folder), WrenchAnswer(findings)


def material_of(text: str) -> Material:
    """Parse the residuals that count as a gap of 1 each, such as ``0.2N,0.01N·m,0.1mm``; a
    `ParameterError` unless they are a force, a torque and a length above 0, each once."""
    from wrenchbed.diagnosis.prepare.prepared import Material

    parts = text.replace(" ", "").split(",")
    matches = [m for m in map(_MATERIAL.fullmatch, parts) if m]
    sizes = {"N·m" if m[2][0] + m[2][-1] == "Nm" else m[2]: float(m[1]) for m in matches}
    if not len(sizes) == len(parts) or not all(0.0 < x < math.inf for x in sizes.values()):
        raise ParameterError(
            f"--material {text!r}: give sizes above 0 of a force, a torque or a place, as "
            "0.2N,0.01N·m,0.1mm"
        )
    place = 1e-3 * sizes["mm"] if "mm" in sizes else None
    return Material(sizes.get("N"), sizes.get("N·m"), place)


def _names(folder: Path) -> list[str]:
    """Names of the files in a folder that a diagnosis may write."""
    made = ("diagnosis.json", "twin.json", _DRIVES, _PAGE, _PICTURE)
    return [name for name in made if (folder / name).exists()]


def _draw(findings: Findings, path: Path) -> None:
    from wrenchbed.viewer.diagnoses import diagnosis_view

    diagnosis_view(findings, path, console.command())


def _tried(name: str, write: Callable[[], object]) -> None:
    """Call ``write``, which makes the file ``name``; warn if a library for it is missing."""
    try:
        write()
    except MissingExtraError as error:
        warnings.warn(f"no {name}: {error}", WrenchbedWarning, stacklevel=1)


def _learnt(data: wb.Recording, count: int, seed: int) -> Reliability:
    """Measure on ``count`` simulated robots that repeat a recording how often diagnoses are
    right."""
    from wrenchbed.benchmark.scoring.learn_reliability import reliability_at_design
    from wrenchbed.diagnosis.prepare.prepare_recording import prepare

    prepare(data)  # refuses what cannot be diagnosed, before anything is learnt
    with console.progress("look-alikes", count) as report:
        return reliability_at_design(data, count, seed=seed, report=report)


def _rehearsed(path: Path, options: DryRunOptions, as_json: bool) -> None:
    from wrenchbed.diagnosis.next.dry_run import dry_run as run

    result = run(wb.Plan.read(path), options.samples, options.rate)
    answer = {
        "plan": str(path),
        "effects": [
            asdict(s) | {"size": {k: {"value": v, "unit": u} for k, (v, u) in s.size.items()}}
            for s in result.showings
        ],
        "blind": [spot.to_json() for spot in result.blind],
    }
    console.answer(answer, as_json, isolability(path.name, result))


def answer_display(a: Answer) -> Group:
    """Displays of a diagnosis: where the gap lies, causes, how far it shrinks, next steps."""
    d = a.d
    head = Text.assemble(("diagnosis ", "bold"), a.about)
    verdict = Text.assemble((d.verdict, f"bold {_COLOURS[d.verdict]}"), f": {a.headline}")
    causes = _causes(a) if a.causes else a.no_cause
    gaps = console.table("|", ">", indent=2)
    for label, value in a.bars:
        gaps.add_row(label, value)
    gaps.add_row("held-out rows", f"{d.gap.rows:,}")
    aside = [f"set aside: {o['sentence']}" for o in d.outliers]
    return Group(
        head, verdict, *console.section("", aside)[2:],
        *console.section("where", [f"{a.place}.", *a.where]),
        *console.section("which", [causes, a.leading]),
        *console.section("detected, below what counts", a.minor),
        *console.section("how far", [a.distance, gaps, a.measure]),
        *console.section("what this data cannot tell", d.cannot_tell),
        *console.section("what this data could not have shown", a.blind),
        *console.section("note", a.notes),
        *console.section("what next", a.steps),
    )  # fmt: skip


def _causes(a: Answer) -> Table:
    shown = console.table("effect", ">probability", "parameters", indent=2)
    for c in a.causes:
        words = [text for _, text in c.choices] + [f"{x.key} {x.value}" for x in c.sizes]
        more = len(words) - _MOST_SIZES
        text = "\n".join(words[:_MOST_SIZES]) + f"\n… {more} more" * (more > 0)
        rivals = ", ".join(name for name, _ in c.rivals)
        shown.add_row(c.name + (f"\nor {rivals}" if rivals else ""), c.probability, text)
    return shown


def isolability(name: str, result: DryRun) -> Group:
    """Displays of a dry run: effects that the plan ``name`` could show, least detectable sizes."""
    from wrenchbed.diagnosis.next.blind import sentences
    from wrenchbed.pages import numbers

    shown = console.table("|effect", ">shows from", "looks the same as")
    for s in sorted(result.showings, key=lambda s: s.smallest or 1e9):
        cell = "never"
        if s.smallest is not None:
            parameter, (value, unit) = next(iter(s.size.items()))
            text = numbers.rough(parameter, value, unit)
            cell = f"{text} {parameter}" if s.detectable else f"({text}) {parameter}"
        style = "" if s.detectable else "dim"
        shown.add_row(Text(s.effect, style=style), Text(cell, style=style), ", ".join(s.rivals))
    return Group(
        *console.section(
            f"what {name} could show", [shown, "in brackets: only at an implausible size"]
        )[1:],
        *console.section("what it could not show", sentences(result.blind)),
    )
