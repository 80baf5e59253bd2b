"""Results as people read them in a terminal of 80 columns."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Group
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from wrenchbed.physics.wrench import CHANNELS

if TYPE_CHECKING:
    from wrenchbed.calibration.fit import Fit, IdentifiedValue
    from wrenchbed.pages.document import Document


_SHOWN = {"m": ("mm", 1e3), "rad": ("°", 180 / np.pi), "kg·m²": ("g·m²", 1e3)}
"""Units that people read more easily than SI, and their factors."""


def describe(plugin: Any) -> str:
    """One line about a plug-in: its title, or the first line of its docstring."""
    title = getattr(plugin, "title", None)
    return str(title or (plugin.__doc__ or "").strip().splitlines()[0])


def plugins(kind: str, rows: Mapping[str, str]) -> Table:
    """Names and one line each."""
    table = Table(box=None, show_header=False, padding=(0, 2, 0, 0))
    for name, text in rows.items():
        table.add_row(Text(name, style="bold"), text)
    return table


def fit(result: Fit, truth: Mapping[str, float] | None = None) -> Group:
    """A calibration: parameters, residuals, what the data cannot tell, and its status.

    With the true values of a simulated robot, each estimate stands beside its own.
    """
    head = Text.assemble(
        ("calibration ", "bold"),
        (f"{result.recording}", ""),
        f"  {result.robot}, {_amount(result)}",
    )
    parts: list[Any] = [head, "", _parameters(result, truth), "", _residuals(result), ""]
    cannot = _cannot_tell(result)
    if cannot:
        parts += [Text("what this data cannot tell", style="bold"), *cannot, ""]
    if result.touches is not None:
        seats = result.touches
        told = (
            f"{seats.count} with {1e3 * seats.std:g} mm per axis; the least fitting, number "
            f"{seats.worst}, lies {seats.distance:.1f} σ from where all else puts it"
        )
        parts += [Text("touches", style="bold"), _indented(told), ""]
    if result.target_rms is not None:
        told = f"{1e3 * result.target_rms:.3g} mm rms expected in the robot's target workspace"
        parts += [Text("position of the tool", style="bold"), _indented(told), ""]
    parts += [Text("status", style="bold"), _indented(result.status)]
    return Group(*parts)


def _indented(text: str) -> Padding:
    return Padding(Text(text), (0, 0, 0, 2))


def _amount(result: Fit) -> str:
    if result.rows == result.poses:
        return f"{result.rows} rows"
    return f"{result.poses} poses, {result.rows} rows"


def _parameters(result: Fit, truth: Mapping[str, float] | None) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="dim")
    table.add_column("parameter", no_wrap=True)
    for name in ("value", "± std", "start"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    if truth is not None:
        table.add_column("truth", justify="right", no_wrap=True)
        table.add_column("off by", justify="right", no_wrap=True)
    for p in result.identified:
        unit, factor = _SHOWN.get(p.unit, (p.unit, 1.0))
        cells = [p.name, *_numbers(p, factor), unit]
        if truth is not None:
            cells += _beside(p, truth.get(p.name, p.nominal), factor)
        table.add_row(*cells)
    return table


def _beside(p: IdentifiedValue, true: float, factor: float) -> tuple[str, str]:
    """The true value, and how many standard uncertainties the estimate is off."""
    off = f"{(p.value - true) / p.std:+.1f} σ" if p.std else ""
    return f"{true * factor:.7g}", off


def _numbers(p: IdentifiedValue, factor: float) -> tuple[str, str, str]:
    """Value, uncertainty and start with as many decimals as the uncertainty deserves."""
    if p.std is None:
        return f"{p.value * factor:.4f}", "in sum only", _start(p.nominal * factor)
    std = p.std * factor
    decimals = int(np.clip(1 - np.floor(np.log10(std)), 0, 9)) if std > 0 else 9
    return f"{p.value * factor:.{decimals}f}", f"{std:.2g}", _start(p.nominal * factor)


def _start(x: float) -> str:
    return f"{x:.4g}" if abs(x) > 1e-12 else "0"


def _residuals(result: Fit) -> Table:
    table = Table(box=None, padding=(0, 1, 0, 0), header_style="dim")
    table.add_column("per channel [N, N·m]", no_wrap=True)
    for channel in CHANNELS:
        table.add_column(channel, justify="right", no_wrap=True, min_width=7)
    noise = result.noise
    table.add_row("residual rms", *map(_short, result.residual_rms))
    table.add_row(f"one row, {noise.source}", *map(_short, noise.row))
    worth = [f"{w:.0f}" for w in noise.effective]
    table.add_row("effective rows", *worth)
    return table


def _short(x: float) -> str:
    return f"{x:.4f}" if x >= 1e-3 else f"{x:.1e}" if x > 0 else "0"


def _cannot_tell(result: Fit) -> list[Padding]:
    o = result.observability
    lines = [f"rank {o.rank} of {len(o.names)} parameters"]
    if o.no_effect:
        lines.append(f"no effect on any reading: {', '.join(o.no_effect)}")
    lines += [r.sentence for r in o.redundancies]
    return [_indented(line) for line in lines] if len(lines) > 1 else []


def score_table(main: str, page: Document) -> Group:
    """The figures of a sealed benchmark: targets, the judged entrant, the oracle."""
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="bold")
    table.add_column("")
    for head in ("target", f"{main} (95 %)", "n", "oracle"):
        table.add_column(head, justify="right", no_wrap=True)
    figures = page.sections[0].parts[0]
    assert not hasattr(figures, "svg")
    for row in figures.rows:
        table.add_row(*row[:5])
    return Group(Text(page.title, style="bold"), Text(page.lead), "", table)
