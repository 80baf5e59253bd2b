"""A table of numbers in a text file, as programs and Excel write it: any separator, any encoding.

Encoding, separator, decimal mark and header are read off the file. Lines before the table (notes,
settings) are skipped; the columns of a table without header are called 1, 2, 3 ….
"""

import csv
import io
import re
from codecs import getincrementaldecoder
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import accumulate, islice
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pcsv

from wrenchbed.data.clock import nanoseconds_of
from wrenchbed.errors import MapError, raise_shortage

_SAMPLE = 200
"""Most lines that are looked at to find out how a file is written."""
_LONGEST = 100_000
"""Longest line that is read [characters], some 5,000 numbers: a longer one is hardly a table, and
to split it in all ways takes seconds."""
_SAMPLE_SIZE = 500_000
"""Characters that are looked at, at most: splitting a line in all ways is slow."""
_HEAD = 1_000_000
"""Bytes at the beginning that are looked at."""
_PACKED = (b"\x1f\x8b", b"PK\x03\x04", b"BZh", b"\xfd7zXZ", b"\x28\xb5\x2f\xfd", b"7z\xbc\xaf")
"""First bytes of gzip, zip (workbooks too), bzip2, xz, zstd and 7z files (their format pages)."""
_SEPARATORS = ("\t", ";", ",", "|")
BLANKS = " "
"""The separator that stands for any number of blanks and tabs."""
_COMMENT = re.compile(r"^\s*(?:#+|%+|//)\s*")
_COMMA_NUMBER = re.compile(r"^[+-]?\d+(?:,\d+)?(?:[eE][+-]?\d+)?$")
_NULLS = ["", *"nan NaN NAN null NULL none None NA N/A #N/A - -nan -NaN -nan(ind)".split()]
"""Texts that programs write for a missing number."""
SKIP = "; --skip-incomplete leaves such rows out"
"""End of a message about a missing number in an import: the remedy."""
_EMPTY = {text.lower() for text in _NULLS}


@dataclass(frozen=True)
class Layout:
    """Layout of a text file with a table.

    Attributes:
        separator: one character; `BLANKS` for any number of blanks and tabs.
        decimal: mark of decimal fractions, point or comma.
        skipped: lines before the first row of numbers, the header among them.
        names: names of the columns.
        units: units of the columns, where a line below the names has them.
    """

    separator: str
    decimal: str
    skipped: int
    names: tuple[str, ...]
    units: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Columns:
    """Columns of a text file or a log, and the line at which its rows begin.

    Attributes:
        table: numbers where every cell is one, else text.
        where: name of the file, for messages.
        skipped: lines of the file before row 0; none in a log, or where rows were left out.
        units: units of columns, where a line below the names has them.
    """

    table: pa.Table
    where: str
    skipped: int | None = None
    units: Mapping[str, str] = field(default_factory=dict)

    def complete(self, names: Sequence[str]) -> "Columns":
        """Keep the rows in which every named column has a number."""
        keep = np.ones(self.table.num_rows, dtype=bool)
        for name in set(names) & set(self.table.column_names):
            keep &= ~self.lacks(name)
        return self if keep.all() else replace(self, table=self.table.filter(keep), skipped=None)

    def lacks(self, name: str) -> np.ndarray:
        """Booleans (N,): rows in which a column has no value or none that is finite."""
        column = self.table.column(name)
        if pa.types.is_floating(column.type):
            return ~np.isfinite(np.asarray(column))
        return np.asarray(column.is_null())

    def times(self, name: str) -> np.ndarray | None:
        """Convert a column of text or time stamps to ns since 1970 (N,); None for numbers."""
        once = self.table.column_names.count(name) == 1
        return nanoseconds_of(self.table.column(name)) if once else None

    def numbers(self, name: str, remedy: str = "") -> np.ndarray:
        """Convert a column (N,) to floats; ``remedy`` ends the message about a missing value. A
        `MapError`, with row and line, if there is no such column, or a cell holds text or
        nothing."""
        names = self.table.column_names
        if names.count(name) != 1:
            times = "appears twice" if name in names else "is missing"
            raise MapError(f"{self.where}: column {name!r} {times}; found {', '.join(names)}")
        column = self.table.column(name)
        if pa.types.is_floating(column.type) or pa.types.is_integer(column.type):
            values = column.to_numpy().astype(float)
        else:
            cells = ["" if cell is None else str(cell) for cell in column.to_pylist()]
            for row, cell in enumerate(cells):
                if cell and not is_number(cell):
                    raise self._wrong(name, row, f"{cell!r} is no number")
            values = np.array([np.nan if c.strip().lower() in _EMPTY else float(c) for c in cells])
        bad = np.flatnonzero(~np.isfinite(values))
        if len(bad):
            raise self._wrong(name, int(bad[0]), "the value is missing or not finite", remedy)
        return values

    def _wrong(self, name: str, row: int, why: str, remedy: str = "") -> MapError:
        rows = () if self.skipped is None else _rows(Path(self.where), self.skipped)
        line = "".join(f" (line {number})" for number, _ in islice(rows, row, row + 1))
        return MapError(f"{self.where}: column {name!r}, row {row}: {why}{line}{remedy}")


def read_text(path: Path, separator: str | None = None) -> Columns:
    """Read a table of numbers from a text file; without a ``separator`` it is detected. A
    `MapError` if there is no such file, no table of numbers, or a row of another number of
    cells."""
    head, encoding = _head(path)
    lines = head.splitlines()
    long = next((k for k, line in enumerate(lines) if len(line) > _LONGEST), None)
    if long is not None:
        raise MapError(
            f"{path}: line {long + 1} has {len(lines[long]):,} characters, more than {_LONGEST:,}; "
            "is this a table?"
        )
    layout = find_layout(lines, path, separator)
    source: Path | io.BytesIO = path
    mark, skipped = layout.separator, layout.skipped
    if mark == BLANKS:
        rows = ("\t".join(text.split()) for _, text in _rows(path, skipped))
        source, mark, skipped, encoding = io.BytesIO("\n".join(rows).encode()), "\t", 0, "utf-8"
    uneven = list[str]()

    def judged(row: pcsv.InvalidRow) -> str:
        if not _COMMENT.match(row.text):
            uneven.append(row.text)
        return "skip"

    width = len(layout.names)
    cells = max(width, len(split(lines[layout.skipped], layout.separator)))
    try:
        table = pcsv.read_csv(
            source,
            read_options=pcsv.ReadOptions(
                column_names=[str(k) for k in range(cells)], skip_rows=skipped, encoding=encoding
            ),
            parse_options=pcsv.ParseOptions(delimiter=mark, invalid_row_handler=judged),
            convert_options=pcsv.ConvertOptions(
                decimal_point=layout.decimal, strings_can_be_null=True, null_values=_NULLS
            ),
        )
    except (pa.ArrowException, UnicodeError) as error:
        raise_shortage(error, path)
        raise MapError(f"{path}: not a table: {str(error).splitlines()[0]}") from error
    if uneven:
        _check_cut(path, layout, cells)
        lost = pa.table({field.name: pa.nulls(len(uneven), field.type) for field in table.schema})
        table = pa.concat_tables([table, lost])
    if not table.num_rows:
        raise MapError(f"{path}: the file has 0 rows")
    units = {n: u for n, u in zip(layout.names, layout.units, strict=False) if u}
    named = table.select(range(width)).rename_columns(list(layout.names))
    return Columns(named, str(path), layout.skipped, units)


def _check_cut(path: Path, layout: Layout, cells: int) -> None:
    """Raise `MapError` for a row of other than ``cells`` cells, but for the last if cut off."""
    rows = enumerate(_rows(path, layout.skipped))
    for row, (line, text) in rows:
        count = len(split(text, layout.separator))
        if count != cells and (count > cells or next(rows, None) is not None):
            raise MapError(
                f"{path}: row {row} (line {line}) has {count} cells, the rows before it {cells}: "
                f"{text.strip()[:60]!r}"
            )


def _rows(path: Path, skipped: int) -> Iterator[tuple[int, str]]:
    """Yield line number (from 1) and text of each table row, without empty lines and comments."""
    with path.open(encoding=_head(path)[1], errors="replace") as stream:
        for line, text in enumerate(stream, start=1):
            if line > skipped and text.strip() and not _COMMENT.match(text):
                yield line, text


def _head(path: Path) -> tuple[str, str]:
    """First lines of a file and its encoding: UTF-8, UTF-16, Windows-1252 of Excel. `MapError`."""
    if path.is_fifo():  # it would be waited for
        raise MapError(f"{path}: is no regular file: give a text file")
    try:
        with path.open("rb") as stream:
            raw = stream.read(_HEAD)
            cut = bool(stream.read(1))
    except FileNotFoundError as error:
        raise MapError(f"{path}: there is no such file") from error
    except OSError as error:
        raise_shortage(error, path)
        raise MapError(f"{path}: cannot be read: {error.strerror}") from error
    first = raw[:400]
    wide = {b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16"}.get(raw[:2])
    if wide is None and first.count(0) > len(first) // 4:
        wide = "utf-16-le" if first[1::2].count(0) > first[::2].count(0) else "utf-16-be"
    for name in [wide] if wide else ["utf-8-sig", "cp1252"]:
        try:
            text = getincrementaldecoder(name)().decode(raw, final=not cut)
        except UnicodeDecodeError:
            continue
        if "\0" not in text:
            return text.rpartition("\n")[0] if cut and "\n" in text else text, name
    if raw.startswith(_PACKED):
        raise MapError(f"{path}: is packed; unpack it, or save a workbook as CSV, and give that")
    raise MapError(f"{path}: is not text; a CSV table, a rosbag or an MCAP file is wanted")


def find_layout(lines: Sequence[str], path: Path, separator: str | None = None) -> Layout:
    """Detect the layout of a text file's table from the file's first lines; a `MapError` if there
    is no table of numbers in it."""
    some = [k for k, line in enumerate(lines[: 4 * _SAMPLE]) if line.strip()][:_SAMPLE]
    ends = accumulate(len(lines[k]) for k in some)
    some = [k for k, end in zip(some, ends, strict=True) if end <= _SAMPLE_SIZE]
    plain = [k for k in some if not _COMMENT.match(lines[k])]
    if not plain:
        raise MapError(f"{path}: the file has 0 rows")
    choices = [separator] if separator is not None else [*_SEPARATORS, BLANKS]
    best: tuple[float, Layout] | None = None
    for choice in choices:
        for decimal in ".," if choice != "," else ".":
            table = _table_at(lines, some, plain, choice, decimal)
            if table is not None and (best is None or table[0] > best[0]):
                best = table
    if best is None:
        first = lines[plain[0]]
        raise MapError(f"{path}: the file has 0 rows of numbers; it begins {first[:60]!r}")
    return best[1]


def _table_at(
    lines: Sequence[str], some: Sequence[int], plain: Sequence[int], separator: str, decimal: str
) -> tuple[float, Layout] | None:
    """Plausibility (more is better) and layout of a table with this separator and decimal mark;
    None if there is none. ``some``: indices of lines not empty, ``plain``: no comments."""
    cells = {k: split(lines[k], separator) for k in plain}
    widths = Counter(len(c) for c in cells.values() if _numeric(c, decimal) > 0)
    if not widths:
        return None
    width = max(widths, key=lambda w: (widths[w], w))
    if width == 1 and decimal == ",":
        return None
    body = [k for k in plain if len(cells[k]) == width]
    first, last = _first_row(cells, body, decimal), body[-1]
    rows = [k for k in body if k >= first]
    numeric = sum(_numeric(cells[k], decimal) for k in rows) / (width * max(len(rows), 1))
    same = len(rows) / max(sum(first <= k <= last for k in plain), 1)
    names, units = _header(lines, some, first, separator, decimal, width)
    while names and not names[-1] and width == len(names) and not any(cells[k][-1] for k in rows):
        width, names = width - 1, names[:-1]  # every line ends in a separator
    names = [name or str(k + 1) for k, name in enumerate(names)]
    enough = min(width, 7) / 7.0  # a wrench and more
    layout = Layout(separator, decimal, first, tuple(names), tuple(units))
    return numeric * same * (0.5 + enough) + 1e-3 * len(rows) / len(plain), layout


def _first_row(cells: dict[int, list[str]], body: Sequence[int], decimal: str) -> int:
    """Index of the first line of numbers among lines ``body``; ``cells``: texts by line index."""
    later = [cells[k] for k in body[1:]]
    columns = [
        j for j in range(len(cells[body[0]]))
        if 2 * sum(is_number(row[j], decimal) for row in later) > len(later)
    ]  # fmt: skip
    for k in body if columns else ():
        text = sum(bool(cells[k][j]) and not is_number(cells[k][j], decimal) for j in columns)
        if 2 * text <= len(columns):
            return k
    return body[0]


def _header(
    lines: Sequence[str], some: Sequence[int], first: int, separator: str, decimal: str, width: int
) -> tuple[list[str], list[str]]:
    """Names of ``width`` columns, else numbers, from lines at ``some`` before ``first``, and units,
    if a word stands twice in the line below one of different words."""
    before = [k for k in some if k < first]
    names = _words(lines[before[-1]], separator, decimal, width) if before else None
    if names is not None and len(set(names)) < len(names) and len(before) > 1:
        above = _words(lines[before[-2]], separator, decimal, width)
        if above is not None and len(set(above)) == len(above):
            return above, names
    return names or [str(k + 1) for k in range(width)], []


def _words(line: str, separator: str, decimal: str, width: int) -> list[str] | None:
    """Cells of a line, if there are ``width`` or one less and none is a number; else None."""
    for mark in (separator, BLANKS, ",", ";", "\t"):
        cells = split(_COMMENT.sub("", line), mark)
        names = [name.strip().strip('"').strip() for name in cells]
        if len(names) in (width, width - 1) and not _numeric(names, decimal):
            return names + [""] * (width - len(names))
    return None


def split(line: str, separator: str) -> list[str]:
    """Cells of a line, stripped of blanks and quotes."""
    if separator == BLANKS:
        return line.split()
    cells = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    return [cell.strip() for cell in cells]


def is_number(cell: str, decimal: str = ".") -> bool:
    """Whether a text cell is a number with this decimal mark; an empty one is not."""
    if decimal == ",":
        if "." in cell or not _COMMA_NUMBER.match(cell):
            return False
        cell = cell.replace(",", ".")
    try:
        float(cell)
    except ValueError:
        return cell.strip().lower() in _EMPTY - {""}
    return "_" not in cell


def _numeric(cells: Sequence[str], decimal: str) -> int:
    return sum(is_number(c, decimal) for c in cells)
