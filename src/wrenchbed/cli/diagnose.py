"""`wrenchbed diagnose`: where a gap lies, which effect causes it, how far it shrinks.

A diagnosis as people read it in a terminal of 80 columns.
"""

from __future__ import annotations

import shlex
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro
from rich.console import Group
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

import wrenchbed as wb
from wrenchbed.cli import console
from wrenchbed.errors import MissingExtraError, ParameterError, WrenchbedWarning

if TYPE_CHECKING:
    from wrenchbed.diagnosis.diagnose import Findings
    from wrenchbed.diagnosis.explain.reliability import Reliability
    from wrenchbed.diagnosis.gap.result import Diagnosis
    from wrenchbed.diagnosis.next.dry_run import DryRun
    from wrenchbed.reports.figures import Artist


_COLOURS = {"none": "green", "identified": "cyan", "ambiguous": "yellow", "unknown": "magenta"}
_MEANING = {
    "none": "no cause: what is left is below the noise, or normal imperfections",
    "identified": "cause identified",
    "ambiguous": "cause found, with rivals that this data cannot tell apart",
    "unknown": "a gap that no known effect explains",
}


def diagnosis(d: Diagnosis) -> Group:
    """The three answers, then what cannot be told and what to do next."""
    head = Text.assemble(
        ("diagnosis ", "bold"), f"{d.recording}  {d.robot}, {d.seconds:.1f} s",
    )  # fmt: skip
    verdict = Text.assemble((d.verdict, f"bold {_COLOURS[d.verdict]}"), f": {_MEANING[d.verdict]}")
    parts: list[Any] = [head, verdict, ""]
    parts += [Text("where", style="bold"), *(_line(str(w["sentence"])) for w in d.where[:4])]
    if not d.where:
        parts.append(_line("nothing stands out"))
    parts += ["", Text("which", style="bold")]
    parts.append(_causes(d) if d.which else _line("no cause is claimed"))
    parts.append(_line(_probabilities(d)))
    parts += ["", Text("how far", style="bold"), _line(_MEASURE), _gap(d)]
    for title, lines in (("what this data cannot tell", d.cannot_tell), ("note", d.notes)):
        if lines:
            parts += ["", Text(title, style="bold"), *map(_line, lines)]
    if d.next:
        parts += ["", Text("what next", style="bold"), *(_line(str(n["sentence"])) for n in d.next)]
    return Group(*parts)


_MEASURE = "gap on rows that no fit saw; 1: errors as large as the noise of one row"


def isolability(name: str, found: DryRun) -> Group:
    """Which effects a plan could show, from what size on."""
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="dim")
    table.add_column("effect", no_wrap=True)
    table.add_column("shows from", justify="right", no_wrap=True)
    table.add_column("looks the same as")
    for s in sorted(found.showings, key=lambda s: s.smallest or 1e9):
        if s.smallest is None:
            shown = "never"
        else:
            parameter, (value, unit) = next(iter(s.size.items()))
            shown = f"{value:.2g} {unit}" if s.detectable else f"({value:.2g} {unit})"
            shown += f" {parameter}"
        style = "" if s.detectable else "dim"
        table.add_row(Text(s.effect, style=style), Text(shown, style=style), ", ".join(s.rivals))
    parts: list[Any] = [Text(f"what {name} could show", style="bold"), table]
    parts.append(_line("in brackets: only at an implausible size"))
    if found.cannot_tell:
        parts += ["", Text("what it cannot tell", style="bold"), *map(_line, found.cannot_tell)]
    return Group(*parts)


def _line(text: str) -> Padding:
    return Padding(Text(text), (0, 0, 0, 2))


def _causes(d: Diagnosis) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 2), header_style="dim")
    table.add_column("effect")
    table.add_column("p", justify="right", no_wrap=True)
    table.add_column("parameters")
    for cause in d.which:
        name = str(cause["effect"])
        if cause["rivals"]:
            name += "\nor " + ", ".join(cause["rivals"])
        told = "\n".join(_parameter(k, v) for k, v in list(cause["parameters"].items())[:6])
        more = len(cause["parameters"]) - 6
        told += f"\n… {more} more" * (more > 0)
        table.add_row(name, f"{cause['probability']:.2f}", told)
    return table


def _parameter(name: str, told: dict[str, Any]) -> str:
    from wrenchbed.pages.numbers import quantity

    return f"{name} {quantity(name, told)}"


def _probabilities(d: Diagnosis) -> str:
    best = sorted(d.probabilities.items(), key=lambda kv: -kv[1])
    return "leading cause: " + ", ".join(f"{k} {v:.2f}" for k, v in best if v >= 0.005)


def _gap(d: Diagnosis) -> Table:
    g = d.gap
    table = Table(box=None, padding=(0, 2, 0, 2), show_header=False)
    table.add_column(no_wrap=True)
    table.add_column(justify="right", no_wrap=True)
    for text, value in (
        ("simulator as configured", g.configured),
        ("calibrated: bias, mass, CoG", g.calibrated),
        ("with the effects", g.with_effects),
        ("noise alone", g.floor),
    ):
        if value is not None:
            table.add_row(text, f"{value:.3g}")
    if g.closed is not None and g.interval is not None:
        low, high = g.interval
        table.add_row("closed", f"{100 * g.closed:.1f} % ({100 * low:.1f} … {100 * high:.1f})")
    if g.black_box is not None:
        told = f"{100 * g.black_box:.1f} %" if g.black_box > 0.0 else "nothing"
        table.add_row("a black box closes", told)
    table.add_row("sealed rows", f"{g.rows}")
    return table


def diagnose(
    recording: tyro.conf.Positional[Path],
    /,
    out: Path | None = None,
    dry_run: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    samples: int = 60,
    rate: float = 100.0,
    look_alikes: int = 0,
    seed: int = 0,
    as_json: console.Json = False,
) -> None:
    """Say where the sim-to-real gap lies, which effect causes it and how far it shrinks.

    Args:
        recording: Parquet file; with --dry-run a plan that has not been recorded yet.
        out: Folder for diagnosis.json, twin.json, report.html, diagnosis.rrd and plans of what to
            do next.
        dry_run: Only say which effects such a recording could show, and which look the same.
        samples: With --dry-run: rows a pose.
        rate: With --dry-run: rows a second [Hz].
        look_alikes: Learn how often such claims are right from so many simulated robots that do
            what this one did (some 5 s each, kept for the next time); 0: use what is known.
        seed: Of the split into fitted and sealed blocks.
        as_json: Print the result as JSON.
    """
    console.check_seed(seed)
    if dry_run:
        _rehearsed(recording, samples, rate, as_json)
        return
    if out is None:
        raise ParameterError("diagnose needs --out, the folder for its files (or --dry-run)")
    if out.exists() and not out.is_dir():
        raise ParameterError(f"{out}: is a file; give a folder")
    from wrenchbed.diagnosis.diagnose import diagnose as run
    from wrenchbed.reports.figures import Artist

    data = wb.Recording.read(recording)
    learnt = _learnt(data, look_alikes, seed) if look_alikes else None
    with Artist() as artist:
        with console.progress("diagnosing", 7) as tell:
            found = run(data, seed=seed, reliability=learnt, progress=lambda step: tell(1, step))
        found.diagnosis.write(out)
        for name, plan in found.plans.items():
            plan.write(out / name)
        written = ["diagnosis.json", "twin.json"]
        if _reported(found, recording, out, seed, artist):
            written.append("report.html")
        if _pictured(found, out):
            written.append("diagnosis.rrd")
    told = found.diagnosis.to_json()
    console.answer(told, as_json, diagnosis(found.diagnosis))
    if not as_json:
        text = f"{', '.join(written)} → {out}"
        console.OUT.print(text, soft_wrap=True, markup=False, highlight=False)


def _learnt(data: wb.Recording, count: int, seed: int) -> Reliability:
    from wrenchbed.benchmark.scoring.reliability_at_design import reliability_at_design

    with console.progress("look-alikes", count) as report:
        return reliability_at_design(data, count, seed=seed, report=report)


def _reported(found: Findings, recording: Path, out: Path, seed: int, artist: Artist) -> bool:
    """Write report.html; without the libraries that draw it a warning names the extra."""
    from wrenchbed.reports import diagnosis_page

    command = ["wrenchbed", "diagnose", str(recording), "--out", str(out)]
    if seed:
        command += ["--seed", str(seed)]
    try:
        diagnosis_page(found, shlex.join(command), artist).write(out / "report.html")
    except MissingExtraError as error:
        warnings.warn(f"no report.html: {error}", WrenchbedWarning, stacklevel=2)
        return False
    return True


def _pictured(found: Findings, out: Path) -> bool:
    """Write diagnosis.rrd; without rerun a warning names the extra."""
    try:
        from wrenchbed.viewer import diagnosis_view

        diagnosis_view(found, out / "diagnosis.rrd")
    except MissingExtraError as error:
        warnings.warn(f"no diagnosis.rrd: {error}", WrenchbedWarning, stacklevel=2)
        return False
    return True


def _rehearsed(path: Path, samples: int, rate: float, as_json: bool) -> None:
    from wrenchbed.diagnosis.next.dry_run import dry_run as run

    found = run(wb.Plan.read(path), samples, rate)
    told = {
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
            for s in found.showings
        ],
        "cannot_tell": list(found.cannot_tell),
    }
    console.answer(told, as_json, isolability(path.name, found))
