"""JSON and TOML of others: read within limits of size and depth, and checked field by field."""

import json
import tomllib
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from math import inf, isfinite
from pathlib import Path
from sys import float_info
from typing import Any

from wrenchbed.errors import WrenchbedError, did_you_mean, raise_shortage

_LARGEST = {"JSON": 2**25, "TOML": 2**20}
"""Most bytes of a file, by kind: 10 times the largest diagnosis, 100 times a map of columns."""
_MOST_DOTS = 200
"""Most dots in a line of TOML: time and memory of `tomllib` grow with the square of a key's
parts."""
_PARQUET = b"PAR1"
"""First bytes of a Parquet file."""
_DEEPEST = 100
"""Levels of nested objects and lists: wrenchbed writes 7, Python's recursion ends at 1,000."""
_LONGEST_NAME = 4096
"""Longest name [characters]: the longest path of Linux."""


def load(path: str | Path, error: type[WrenchbedError], other: str = "JSON") -> Any:
    """Read a JSON or TOML file and return its content; its suffix says which, ``other`` for
    suffixes that are neither.

    Raises:
        error: the class given: no such file, a folder, unreadable or not valid.
    """
    path = Path(path)
    kind = {".json": "JSON", ".toml": "TOML"}.get(path.suffix, other)
    if path.is_fifo():  # it would be waited for
        raise error(f"{path}: is no regular file: give a {kind} file")
    try:
        with path.open("rb") as file:
            return parsed(file.read(_LARGEST[kind] + 1), f"{path}:", error, kind)
    except FileNotFoundError as cause:
        raise error(f"{path}: there is no such file") from cause
    except IsADirectoryError as cause:
        raise error(f"{path}: is a folder; give a {kind} file") from cause
    except MemoryError as cause:
        raise_shortage(cause, path)
        raise
    except OSError as cause:
        raise_shortage(cause, path)
        raise error(f"{path}: cannot be read: {cause.strerror}") from cause


def parsed(raw: bytes, where: str, error: type[WrenchbedError], kind: str = "JSON") -> Any:
    """Parse JSON or TOML (``kind``) in UTF-8 bytes and return its content.

    Raises:
        error: the class given, with ``where`` before its text: not valid, too long or too nested.
    """
    if len(raw) > _LARGEST[kind]:
        raise error(f"{where} is longer than {_LARGEST[kind]:,} bytes, which no {kind} here is")
    if raw.startswith(_PARQUET):
        raise error(f"{where} is Parquet, such as recordings and plans, not {kind}")
    try:
        text = raw.decode()
        dots = (line.count(".") for line in text.splitlines())
        if kind == "TOML" and max(dots, default=0) > _MOST_DOTS:
            raise ValueError(f"more than {_MOST_DOTS} dots stand in one line: break it")
        content = tomllib.loads(text) if kind == "TOML" else json.loads(text)
    except RecursionError as cause:
        raise error(f"{where} not valid {kind} here: nested more than {_DEEPEST} levels") from cause
    except ValueError as cause:
        raise error(f"{where} not valid {kind}: {str(cause).splitlines()[0]}") from cause
    level, depth = [content], 0
    while level := [x for part in level for x in _inner(part)]:
        depth += 1
        if depth > _DEEPEST:
            raise error(f"{where} not valid {kind} here: nested more than {_DEEPEST} levels")
    return content


def text_of(path: Path, error: type[WrenchbedError]) -> str:
    """Read the text of a regular TOML file, not beyond the length that one may have. Raises the
    class ``error``: no such file, or no text; `parsed` refuses one that is too long."""
    if path.exists() and not path.is_file():  # a pipe would be waited for
        raise error(f"{path}: is no regular file: give a TOML file")
    try:
        with path.open("rb") as file:
            return file.read(_LARGEST["TOML"] + 1).decode()
    except (OSError, UnicodeDecodeError) as cause:
        why = getattr(cause, "strerror", None) or "it is no text"
        raise error(f"{path}: cannot be read: {why}") from None


def _inner(part: Any) -> Collection[Any]:
    return part.values() if isinstance(part, dict) else part if isinstance(part, list) else ()


def is_number(value: Any) -> bool:
    """Whether a value is a finite int or float; booleans do not count as numbers."""
    plain = isinstance(value, int | float) and not isinstance(value, bool)
    return plain and abs(value) <= float_info.max


class Fields:
    """An object of a JSON or TOML file, whose fields are checked when they are read.

    Args:
        raw: the object as it was parsed.
        where: file, and the part of it, at the beginning of each message.
        error: class of the errors to raise.
        name: path of this object in its file, with dots; empty for the file itself.
    """

    def __init__(self, raw: Any, where: str, error: type[WrenchbedError], name: str = "") -> None:
        self.where, self.kind, self.name = where, error, name
        if not isinstance(raw, Mapping):
            raise error(f"{where}{name or 'the file'} is not an object with fields")
        self.raw = raw

    def error(self, key: str, rule: str) -> WrenchbedError:
        """Make the error for field ``key``: its value, or "is missing", and ``rule``, words on what
        it must be."""
        if key not in self.raw:
            return self.kind(f"{self.where}{self._label(key)} is missing: it {rule}")
        return self.kind(f"{self.where}{self._label(key)} = {self.raw[key]!r} {rule}")

    def _label(self, key: str) -> str:
        return f"{self.name}.{key}" if self.name else key

    def only(self, known: Collection[str], what: str = "it") -> "Fields":
        """Raise an error for a field not in ``known``; in it, ``what`` names the object. Return
        self."""
        for key in self.raw:
            if key not in known:
                has = f"{what} has {', '.join(sorted(known))}"
                close = did_you_mean(key, known) or ";"
                raise self.kind(f"{self.where}there is no field {self._label(key)}{close} {has}")
        return self

    def part(self, key: str) -> "Fields":
        """The object in field ``key`` as `Fields`; an empty one if the field is absent or null."""
        raw = self.raw.get(key)
        return Fields({} if raw is None else raw, self.where, self.kind, self._label(key))

    def parts(self, key: str) -> list["Fields"]:
        """The objects in the list of field ``key``; empty if the field is absent."""
        raw = self.raw.get(key, [])
        if not isinstance(raw, list):
            raise self.error(key, "must be a list")
        return [
            Fields(x, self.where, self.kind, f"{self._label(key)}[{k}]") for k, x in enumerate(raw)
        ]

    def text(self, key: str, rule: str = "must be a name") -> str | None:
        """Text of field ``key``, else an error with ``rule``; None if the field is absent."""
        return None if self.raw.get(key) is None else self.stated_text(key, rule)

    def stated_text(self, key: str, rule: str = "must be a text that is not empty") -> str:
        """Text of field ``key``; an error that states ``rule`` if it is absent or empty."""
        value = self.raw.get(key)
        if not isinstance(value, str) or not value:
            raise self.error(key, rule)
        if len(value) > _LONGEST_NAME:
            raise self.error(key, f"has {len(value):,} characters, more than {_LONGEST_NAME:,}")
        return value

    def choice(self, key: str, known: Collection[str], rule: str, default: Any = None) -> str:
        """Text of field ``key``: one of ``known``, else an error with ``rule`` (as "must be a, b or
        c"); ``default`` if absent."""
        value = self.raw.get(key, default)
        if not isinstance(value, str) or value not in known:
            raise self.error(key, rule)
        return value

    def number(
        self, key: str, unit: str, *, positive: bool = False, nonnegative: bool = False
    ) -> float | None:
        """Finite number in field ``key``, > 0 if ``positive``, ≥ 0 if ``nonnegative``; None if the
        field is absent. The unit is for messages."""
        if self.raw.get(key) is None:
            return None
        value = self.stated_number(key, f"must be a number [{unit}]")
        if (positive and value <= 0) or (nonnegative and value < 0):
            raise self.error(key, f"must be {'above' if positive else 'at least'} 0 {unit}")
        return value

    def stated_number(self, key: str, rule: str = "must be a finite number") -> float:
        """Finite number in field ``key``; an error that states ``rule`` if it is absent or none."""
        if not is_number(self.raw.get(key)):
            raise self.error(key, rule)
        return float(self.raw[key])

    def amount(self, key: str, unit: str, most: float = inf, not_in: str = "") -> float:
        """Number in field ``key``, 0 … ``most`` [``unit``]; above, the error asks "is it in
        ``not_in``?"."""
        value = self.stated_number(key, f"must be a number in {unit}, without its unit")
        if not 0.0 <= value <= most:
            hint = f" (is it in {not_in}?)" if not_in and value > most else ""
            upto = f" … {most:g}" if isfinite(most) else " or more"
            raise self.error(key, f"must be 0{upto} {unit}{hint}")
        return value

    def numbers(
        self, key: str, n: int, *, nonnegative: bool = False, rule: str = ""
    ) -> tuple[float, ...] | None:
        """List of n finite numbers in field ``key``; None if absent; ``rule`` is for errors."""
        if self.raw.get(key) is None:
            return None
        values = self.stated_numbers(key, n, rule)
        if nonnegative and min(values) < 0:
            raise self.error(key, "must not be negative")
        return values

    def stated_numbers(
        self, key: str, n: int, rule: str = "", most: float = inf, not_in: str = ""
    ) -> tuple[float, ...]:
        """List of n finite numbers within ± ``most`` in field ``key``, which must be present; for
        larger ones the error asks whether they are in the unit ``not_in``."""
        values: Any = self.raw.get(key)
        rule = rule or f"must be {n} finite numbers"
        count = len(values) if isinstance(values, list | tuple) else 0
        if count != n or not all(map(is_number, values)):
            raise self.error(key, rule)
        if max(map(abs, values)) > most:
            raise self.error(key, f"{rule}, within {most:g} (is it in {not_in}?)")
        return tuple(float(x) for x in values)

    def square(self, key: str, size: int) -> list[list[float]]:
        """Matrix (size, size) of finite numbers in field ``key``, as a list of rows."""
        rows: Any = self.raw.get(key)
        right = isinstance(rows, list) and len(rows) == size
        if not right or not all(
            isinstance(r, list) and len(r) == size and all(map(is_number, r)) for r in rows
        ):
            rule = f"must be a matrix of {size} × {size} finite numbers"
            raise self.kind(f"{self.where}{self._label(key)} {rule}")
        return [[float(x) for x in row] for row in rows]

    @contextmanager
    def naming(self, key: str) -> Iterator[None]:
        """In the block, let errors that the library raises name field ``key``."""
        try:
            yield
        except self.kind:
            raise
        except WrenchbedError as error:
            raise self.kind(f"{self.where}{self._label(key)}: {error}") from error


def toml_fields(text: str, where: str, error: type[WrenchbedError]) -> Fields:
    """Parse TOML text to its fields; errors are of the class ``error`` and begin with ``where``."""
    return Fields(parsed(text.encode(), f"{where}:", error, "TOML"), f"{where}: ", error)


def quoted(words: str) -> str:
    """Quote a text as a TOML string of one line."""
    escaped = words.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() else f"\\u{ord(c):04x}" for c in escaped) + '"'


def listed(values: Iterable[float]) -> str:
    """TOML array of numbers, written with all their digits."""
    return "[" + ", ".join(repr(float(v)) for v in values) + "]"
