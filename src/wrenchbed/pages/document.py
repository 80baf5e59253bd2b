"""What a study shows: tables and figures in sections, as Markdown and as one HTML page."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from wrenchbed.files import atomic_folder, write_json, write_text
from wrenchbed.pages import rendered


@dataclass(frozen=True)
class Table:
    """Cells as text; the first column is left-aligned, the others right.

    Attributes:
        title: with its number in the paper, if it has one.
        note: what to make of it.
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""

    @classmethod
    def of(
        cls, title: str, columns: Sequence[str], rows: Sequence[Sequence[object]], note: str = ""
    ) -> "Table":
        """From numbers, shown with four significant digits, and texts."""
        cells = tuple(tuple(render(x) for x in row) for row in rows)
        if any(len(row) != len(columns) for row in cells):
            raise ValueError(f"table {title!r}: rows must have {len(columns)} cells")
        return cls(title, tuple(columns), cells, note)

    def markdown(self) -> str:
        """A pipe table."""
        line = "| " + " | ".join(["---"] + ["---:"] * (len(self.columns) - 1)) + " |"
        cells = ([c.replace("|", r"\|") for c in row] for row in (self.columns, *self.rows))
        body = ["| " + " | ".join(row) + " |" for row in cells]
        parts = [f"**{self.title}**", "", body[0], line, *body[1:]]
        return "\n".join([*parts, "", self.note] if self.note else parts)


@dataclass(frozen=True)
class Figure:
    """A drawing in SVG, kept beside the page under ``name``.svg."""

    name: str
    title: str
    svg: str
    note: str = ""

    def markdown(self) -> str:
        """A link to the file."""
        text = f"![{self.title}]({self.name}.svg)\n\n*{self.title}*"
        return f"{text}. {self.note}" if self.note else text


@dataclass(frozen=True)
class Section:
    """A heading, a paragraph, tables and figures."""

    title: str
    text: str
    parts: tuple[Table | Figure, ...] = ()


@dataclass(frozen=True)
class Document:
    """A whole study."""

    title: str
    lead: str
    sections: tuple[Section, ...]
    made: str = ""
    summary: Mapping[str, object] = field(default_factory=dict)

    def markdown(self) -> str:
        """The page as Markdown; figures are links."""
        blocks = [f"# {self.title}", self.lead]
        for section in self.sections:
            blocks += [f"## {section.title}", section.text]
            blocks += [part.markdown() for part in section.parts]
        return "\n\n".join([*blocks, self.made]) + "\n"

    def html(self) -> str:
        """One self-contained page with the figures inside.

        Raises:
            MissingExtraError: jinja2 is not installed.
        """
        return rendered("study", {"page": self, "is_table": lambda p: isinstance(p, Table)})

    def write(self, folder: Path, name: str, numbers: Any = None) -> None:
        """``name``.md, ``name``.html and the figures; ``name``.json if there are numbers."""
        parts = [part for section in self.sections for part in section.parts]
        texts = {f"{p.name}.svg": p.svg for p in parts if isinstance(p, Figure)}
        texts |= {f"{name}.html": self.html(), f"{name}.md": self.markdown()}
        with atomic_folder(folder) as new:
            for file, text in texts.items():
                write_text(new / file, text)
            if numbers is not None:
                write_json(new / f"{name}.json", numbers)


def render(x: object) -> str:
    """A cell: texts as they are, numbers with four significant digits, NaN as a dash."""
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
        return f"{number:#.4g}".rstrip(".")
    return f"{number:,.0f}" if 1e4 <= abs(number) < 1e7 else f"{number:.2e}"
