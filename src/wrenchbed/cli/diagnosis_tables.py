"""A diagnosis as people read it in a terminal of 80 columns."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rich.console import Group
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    from wrenchbed.diagnosis.dryrun import DryRun
    from wrenchbed.diagnosis.result import Diagnosis

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
    from wrenchbed.report.numbers import quantity

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
