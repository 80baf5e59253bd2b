"""Pages of studies and scores: tables and figures in sections, as Markdown and as one HTML page;
and the origin of a page or a picture: date, data by their SHA-256, version, seed, command."""

import hashlib
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any

from wrenchbed.files import atomic_folder, write_json, write_text
from wrenchbed.pages import ReportPage
from wrenchbed.pages.chart import Chart
from wrenchbed.pages.draw import Drawn, draw, svg
from wrenchbed.pages.numbers import measured, minus

NO_FILE = "unknown: there is no such file here"
Facts = Sequence[tuple[str, str]]
"""Rows of label and text, such as those of `provenance`."""


def provenance(
    files: Sequence[str | Path], command: str = "", seed: int | None = None
) -> list[tuple[str, str]]:
    """Facts on the origin of a page, as (label, text).

    Args:
        files: paths of the files that were read, stated with SHA-256; a missing one is named so.
        command: command line that made the page; left out if empty.
        seed: seed of all random choices; left out if there were none.
    """
    lines = [(f"SHA-256 of {Path(r).name}", sha256(r) or NO_FILE) for r in files]
    epoch = os.environ.get("SOURCE_DATE_EPOCH", "")  # seconds since 1970, for repeatable builds
    now = datetime.fromtimestamp(int(epoch), UTC) if epoch.isdigit() else datetime.now(UTC)
    lines += [("made", f"{now:%Y-%m-%d %H:%M} UTC by wrenchbed {version('wrenchbed')}")]
    lines += [("seed", str(seed))] if seed is not None else []
    return lines + ([("command", command)] if command else [])


def sha256(path: str | Path) -> str:
    """SHA-256 of a file's bytes as hexadecimal text; empty if there is no such file."""
    try:
        with Path(path).open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except (OSError, ValueError):
        return ""


def markdown(lines: Facts) -> list[str]:
    """Markdown lines of facts, one for each (label, text)."""
    return ["", "**Data and command**", "", *(f"- {label}: {text}" for label, text in lines)]


@dataclass(frozen=True)
class Table:
    """A table of texts on a page; columns of numbers are right-aligned.

    Attributes:
        title: title, with its number in the paper if it has one.
        note: how to read it.
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""

    @classmethod
    def of(
        cls, title: str, columns: Sequence[str], rows: Sequence[Sequence[object]], note: str = ""
    ) -> "Table":
        """Make a table from texts and numbers; numbers are shown with four significant digits."""
        cells = tuple(tuple(render(x) for x in row) for row in rows)
        if any(len(row) != len(columns) for row in cells):
            raise ValueError(f"table {title!r}: rows must have {len(columns)} cells")
        return cls(title, tuple(columns), cells, note)

    @property
    def numeric(self) -> tuple[bool, ...]:
        """For each column, whether all its cells are numbers, so that it is right-aligned."""
        return tuple(
            k > 0 and all(re.match(r"$|[+–−-]?[<>≥≤]?\s?[\d.]|–$", row[k]) for row in self.rows)
            for k in range(len(self.columns))
        )


@dataclass(frozen=True)
class Figure:
    """A chart on a page, which is also written beside the page as ``name``.svg."""

    name: str
    title: str
    chart: Chart
    note: str = ""

    @cached_property
    def drawn(self) -> Drawn:
        """The chart with its SVG, as a page shows it."""
        return draw(self._named)

    @property
    def svg(self) -> str:
        """SVG text of the chart, coloured for white paper."""
        return svg(self._named, themed=False)

    @property
    def _named(self) -> Chart:
        caption = f"{self.note} {self.chart.caption}".strip()
        return replace(self.chart, name=self.name, title=self.title, caption=caption)


@dataclass(frozen=True)
class Card:
    """One of the answers at the top of a page, as a card.

    Attributes:
        label: the question, in a word or two.
        figure: the answer, a number or word in large type.
        text: what it means, one sentence or two.
    """

    label: str
    figure: str
    text: str


@dataclass(frozen=True)
class Section:
    """A section of a page: heading, paragraph, tables and figures."""

    title: str
    text: str
    parts: tuple[Table | Figure, ...] = ()


@dataclass(frozen=True)
class Document:
    """Content of a whole page: summary, cards and sections.

    Attributes:
        made: sentence on how the page was made.
        summary: key results, for programs.
        data: where the data come from, rows of `provenance`.
        cards: the answers of the first screen.
        badge: key of the page's colour, such as a verdict, and text of the badge.
    """

    title: str
    lead: str
    sections: tuple[Section, ...]
    made: str = ""
    summary: Mapping[str, object] = field(default_factory=dict)
    data: Facts = ()
    cards: tuple[Card, ...] = ()
    badge: tuple[str, str] = ("identified", "")

    def markdown(self) -> str:
        """The page as Markdown text; figures are links to files."""
        return ReportPage(self._context, "study.md").html()

    @property
    def figures(self) -> list[Figure]:
        """All figures of the page, in their order."""
        parts = (part for section in self.sections for part in section.parts)
        return [part for part in parts if isinstance(part, Figure)]

    def html(self) -> str:
        """Return the page as one self-contained HTML text, figures included; a `MissingExtraError`
        without jinja2."""
        drawn = [figure.drawn for figure in self.figures]
        return ReportPage(self._context, "study.html", drawn).html()

    @property
    def _context(self) -> dict[str, Any]:
        """Values of the page's templates."""
        return {"page": self, "verdict": self.badge[0]}

    def write(self, folder: Path, name: str, numbers: Any = None) -> None:
        """Write ``name``.md, .html and the figures to a folder; ``numbers``, if any, as .json."""
        texts = {f"{figure.name}.svg": figure.svg for figure in self.figures}
        texts |= {f"{name}.html": self.html(), f"{name}.md": self.markdown()}
        with atomic_folder(folder) as new:
            for file, text in texts.items():
                write_text(new / file, text)
            if numbers is not None:
                write_json(new / f"{name}.json", numbers)


def render(x: object) -> str:
    """Text of a table cell: texts unchanged, numbers with four significant digits, NaN a dash."""
    if isinstance(x, str):
        return x
    if isinstance(x, int) and not isinstance(x, bool):
        return f"{x:,}"
    number = float(x)  # type: ignore[arg-type]
    if number != number:
        return "–"
    if number == 0:
        return "0"
    if 1e-3 <= abs(number) < 1e4:
        return minus(f"{number:#.4g}".rstrip("."))
    if 1e-4 <= abs(number) < 1e-3:
        return minus(f"{number:.6f}")
    return minus(f"{number:,.0f}") if 1e4 <= abs(number) < 1e7 else measured(number, None)
