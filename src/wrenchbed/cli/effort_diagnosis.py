"""`wrenchbed diagnose` of joint efforts: run it, write its files, and print it in 80 columns."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Group
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from wrenchbed.cli import console
from wrenchbed.data.outputs import Kind
from wrenchbed.errors import MissingExtraError, ParameterError, WrenchbedWarning
from wrenchbed.files import atomic_folder

if TYPE_CHECKING:
    import wrenchbed as wb
    from wrenchbed.diagnosis.efforts.diagnose_efforts import EffortFindings

FILES = {
    "diagnosis.json": Kind.DIAGNOSIS, "twin.json": Kind.TWIN, "drives.json": Kind.DRIVES,
    "report.html": Kind.PAGE,
}  # fmt: skip
_COLOURS = {
    "none": "green", "identified": "cyan", "ambiguous": "yellow", "partial": "yellow",
    "unknown": "magenta",
}  # fmt: skip


def asked(data: list[wb.Recording], channels: str | None) -> bool:
    """Whether joint efforts are diagnosed: where they are asked for, or there is no wrench."""
    return channels in ("effort", "both") or (
        channels is None and len(data) == 1 and not data[0].has_wrench
        and data[0].effort is not None
    )  # fmt: skip


def run(
    data: list[wb.Recording], drives: Path | None, out: Path, seed: int, as_json: bool, *,
    wrench: bool,
) -> None:  # fmt: skip
    """Diagnose one recording's joint efforts, and its wrench too; write and print the answers.

    Raises:
        ParameterError: there are several recordings.
    """
    from wrenchbed.diagnosis.efforts.diagnose_efforts import STEPS, diagnose_efforts

    if len(data) != 1:
        raise ParameterError("diagnose of joint efforts takes one recording")
    console.check_folder(out, FILES)
    words: list[object] = ["diagnose", data[0].name, "--channels", "both" if wrench else "effort"]
    words += ["--drives", drives] if drives is not None else []
    words += ["--seed", seed] if seed else []
    with console.progress("diagnosing", STEPS, alike=False) as report:
        found = diagnose_efforts(
            data[0],
            drives=drives,
            seed=seed,
            wrench=wrench,
            progress=lambda step: report(1, step),
        )
    with atomic_folder(out) as folder:
        found.write(folder)
        written = ["diagnosis.json", "twin.json", "drives.json"]
        try:
            _report(found, folder / "report.html", console.command(*words, "--out", out))
            written.append("report.html")
        except MissingExtraError as error:
            warnings.warn(f"no report.html: {error}", WrenchbedWarning, stacklevel=1)
    console.answer(found.diagnosis.to_json(), as_json, None if as_json else told(found))
    if not as_json:
        console.say(f"{', '.join(written)} → {out}")


def _report(found: EffortFindings, path: Path, command: str) -> None:
    from wrenchbed.reports.effort_page import effort_page

    effort_page(found, command).write(path)


def told(found: EffortFindings) -> Group:
    """The three answers, then what the data cannot tell and what to do next; as on the page."""
    from wrenchbed.reports import effort_sentences as sentences
    from wrenchbed.reports.tables import candidates

    d = found.diagnosis
    head = Text.assemble(
        ("diagnosis ", "bold"),
        f"{d.recording}  {d.robot}, {sentences.channels(found)}, {d.seconds:.1f} s",
    )
    verdict = Text.assemble(
        (d.verdict, f"bold {_COLOURS[d.verdict]}"), f": {sentences.headline(found)}"
    )
    parts: list[Any] = [head, verdict, "", Text("where", style="bold")]
    parts += [_line(f"{sentences.place(found)}."), *(_line(str(w["sentence"])) for w in d.where)]
    parts += ["", Text("which", style="bold")]
    parts.append(_causes(found) if d.which else _line(sentences.without_cause(found)))
    leading = ", ".join(f"{c['key']} {c['p']}" for c in candidates(d.probabilities))
    parts.append(_line(f"leading cause: {leading}; at least 90 % together: {', '.join(d.set90)}"))
    parts += ["", Text("how far", style="bold"), _line(sentences.distance(found)), _gaps(found),
              _line(sentences.MEASURE)]  # fmt: skip
    for title, lines in (("what this data cannot tell", d.cannot_tell), ("note", d.notes)):
        if lines:
            parts += ["", Text(title, style="bold"), *map(_line, lines)]
    parts += ["", Text("what next", style="bold"), *map(_line, sentences.steps(found))]
    return Group(*parts)


def _line(text: str) -> Padding:
    return Padding(Text(text), (0, 0, 0, 2))


def _causes(found: EffortFindings) -> Table:
    from wrenchbed.pages import numbers
    from wrenchbed.reports import effort_sentences as sentences

    table = Table(box=None, padding=(0, 2, 0, 2), header_style="dim")
    table.add_column("effect")
    table.add_column("probability", justify="right", no_wrap=True)
    table.add_column("parameters")
    for cause in found.diagnosis.which:
        name = "\nor ".join([str(cause["effect"]), *map(str, cause["rivals"])])
        text = "\n".join(sentences.parameter(k, v) for k, v in cause["parameters"].items())
        table.add_row(name, numbers.chance(float(cause["probability"])), text)
    return table


def _gaps(found: EffortFindings) -> Table:
    from wrenchbed.pages import numbers
    from wrenchbed.reports import effort_sentences as sentences

    table = Table(box=None, padding=(0, 2, 0, 2), show_header=False)
    table.add_column(no_wrap=True)
    table.add_column(justify="right", no_wrap=True)
    for label, value, kind in sentences.gaps(found.diagnosis):
        if kind != "box":
            table.add_row(label, numbers.gap(value))
    table.add_row("held-out rows", f"{found.diagnosis.gap.rows:,}")
    return table
