"""What a format of another program is, and how its file is written."""

import re
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from wrenchbed import registry
from wrenchbed.errors import ExportError, one_line
from wrenchbed.exports.load_numbers import SENSOR, LoadNumbers
from wrenchbed.files import write_text

CARRIES = ("mass", "cog", "inertia", "rotation", "position", "bias", "gravity")
"""Numbers that a format may carry, by their names in `LoadNumbers`; of ``cog`` and ``inertia`` also
the form in sensor axes, ``cog_sensor`` and ``inertia_sensor``."""


XML = "<!--"
"""Start of XML's comments, which go on to ``-->`` and may hold no ``--``."""


@dataclass(frozen=True)
class ExportOptions:
    """Inputs that some export formats need besides the fit.

    Attributes:
        urdf: text of the user's own URDF.
        frame: name of the link or frame that carries the sensor in the user's system.
    """

    urdf: str | None = None
    frame: str | None = None


class Export(ABC):
    """A file format of another program, in which load numbers are written.

    Attributes:
        name: as in ``export --to NAME``.
        title: one line for people.
        source: the document or program that defines the format.
        comment: start of a comment line, or ``<!--``; empty where the format has no comments: then
            the notes are written to a second file beside it.
        needs_flange: whether its numbers are in flange axes; sensor axes are of no use.
        carries: which numbers of `CARRIES` it takes; the notes name the others as left out.
    """

    name: str
    title: str
    source: str
    comment: str = "# "
    needs_flange: bool = False
    carries: tuple[str, ...]

    @abstractmethod
    def text(self, numbers: LoadNumbers, options: ExportOptions, notes: Sequence[str]) -> str:
        """Return the text of the whole file; ``notes`` are lines for its comments.

        Raises:
            ExportError: the data did not determine what the format needs.
        """

    def hints(self, numbers: LoadNumbers) -> tuple[str, ...]:
        """Notes for people on this format: units, and what to fill in."""
        return ()

    def commented(self, notes: Sequence[str]) -> str:
        """Notes as comments of this format, safe whatever characters they contain."""
        if self.comment == XML:
            lines = [re.sub("-(?=-|$)", "- ", one_line(line)) for line in notes]
            return f"{XML} {chr(10).join(lines)} -->"
        return "".join(f"{self.comment}{one_line(line)}".rstrip() + "\n" for line in notes)


def export_to(
    format_name: str, numbers: LoadNumbers, out: str | Path, options: ExportOptions | None = None
) -> tuple[list[Path], list[str]]:
    """Write a calibration in the format of another program, by its name in ``list exports``.

    Returns the files that were written, and the notes in them: every number with its standard
    uncertainty (±), and what the format leaves out.

    Raises:
        ExportError: the data did not determine what the format needs.
        NotFoundError: no such format.
    """
    form: Export = registry.load("exports", format_name)
    out, options = Path(out), options or ExportOptions()
    if form.needs_flange and numbers.frame == SENSOR:
        raise ExportError(
            f"{form.name} wants the load in flange axes, and the model of {numbers.robot!r} knows "
            "no flange: state the sensor's place with --mount X Y Z QW QX QY QZ"
        )
    notes = notes_of(form, numbers)
    texts = [form.text(numbers, options, notes)]
    texts += [] if form.comment else ["\n".join(notes) + "\n"]
    files = output_files(format_name, out)
    for file, text in zip(files, texts, strict=True):
        write_text(file, text)
    return files, notes


def output_files(format_name: str, out: str | Path) -> list[Path]:
    """Paths that an export in this format writes; the notes' last, if the format has no comments.

    Raises:
        NotFoundError: no such format.
    """
    form, out = registry.load("exports", format_name), Path(out)
    notes = [] if form.comment else [out.parent / f"{out.name}.notes.txt"]
    return [out, *notes]


def notes_of(form: Export, numbers: LoadNumbers) -> list[str]:
    """Notes on an exported file for people, each one line. Names of files, recordings and
    parameters come from outside: control characters in them are spelled out."""
    here = [getattr(numbers, name) for name in form.carries]
    absent = [n for n in CARRIES if not {n, f"{n}_sensor"} & set(form.carries)]
    unused = [q.line() for q in (getattr(numbers, n) for n in absent) if q.known]
    notes = [
        f"exported by wrenchbed {version('wrenchbed')}: {form.title}",
        f"from {numbers.source} (SHA-256 {numbers.digest}), robot {numbers.robot}, "
        f"recording {numbers.recording}",
        f"CoG and inertia in {numbers.frame} unless stated; ± is one standard uncertainty",
        "the load is what the sensor feels; its own body and its adapter plate come on top of it",
        *(q.line() for q in here),
        *(f"left out: {line}" for line in (*unused, *numbers.left)),
        *form.hints(numbers),
    ]
    return [one_line(note) for note in notes]
