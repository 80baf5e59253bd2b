"""Checked JSON and TOML: a file's objects, read with errors that name file, field and rule."""

import json
import tomllib
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from sys import float_info
from typing import Any

from wrenchbed.errors import WrenchbedError, did_you_mean, raise_shortage

_LARGEST = {"JSON": 2**25, "TOML": 2**20}
"""Of a file [bytes]: estimates, 10 times the largest diagnosis and 100 times the largest map."""
_MOST_DOTS = 200
"""In a line of TOML: time and memory of `tomllib` grow with the square of a key's parts."""
_DEEPEST = 100
"""Levels of nested objects and lists: estimate, wrenchbed writes 7."""
_LONGEST_NAME = 4096
"""Of a name [characters]: the longest path of Linux."""


def load(path: str | Path, error: type[WrenchbedError], other: str = "JSON") -> Any:
    """The content of a JSON or TOML file by its suffix; files of other suffixes are ``other``.

    Raises:
        error: no such file, a folder, unreadable or not valid.
    """
    path = Path(path)
    kind = {".json": "JSON", ".toml": "TOML"}.get(path.suffix, other)
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
    """The content of JSON or TOML.

    Args:
        raw: the text in UTF-8.
        where: file or part of one, for messages.
        error: what is raised.
        kind: ``JSON`` or ``TOML``.

    Raises:
        error: not valid, too long, or nested too deeply.
    """
    if len(raw) > _LARGEST[kind]:
        raise error(f"{where} is longer than {_LARGEST[kind]:,} bytes, which no {kind} here is")
    try:
        text = raw.decode()
        if kind == "TOML" and max(map(_dots, text.splitlines()), default=0) > _MOST_DOTS:
            raise error(f"{where} more than {_MOST_DOTS} dots stand in one line: break it")
        content = tomllib.loads(text) if kind == "TOML" else json.loads(text)
    except WrenchbedError:
        raise
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


def _dots(line: str) -> int:
    return line.count(".")


def _inner(part: Any) -> Collection[Any]:
    return part.values() if isinstance(part, dict) else part if isinstance(part, list) else ()


def is_number(value: Any) -> bool:
    """Whether a value is a finite number (true and false are none)."""
    plain = isinstance(value, int | float) and not isinstance(value, bool)
    return plain and abs(value) <= float_info.max


class Fields:
    """An object of a file whose fields are checked as they are read.

    Args:
        raw: the object.
        where: file, and the part of it, at the beginning of each message.
        error: what is raised.
        name: of this object in its file, with dots; empty for the file itself.
    """

    def __init__(self, raw: Any, where: str, error: type[WrenchbedError], name: str = "") -> None:
        self.where, self.kind, self.name = where, error, name
        if not isinstance(raw, Mapping):
            raise error(f"{where}{name or 'the file'} is not a JSON object")
        self.raw = raw

    def error(self, key: str, rule: str) -> WrenchbedError:
        """The error for a field: its value and what is allowed there."""
        return self.kind(f"{self.where}{self._label(key)} = {self.raw.get(key)!r} {rule}")

    def _label(self, key: str) -> str:
        return f"{self.name}.{key}" if self.name else key

    def only(self, known: Collection[str], what: str) -> "Fields":
        """Refuse fields that are not known; returns itself."""
        for key in self.raw:
            if key not in known:
                has = f"{what} has {', '.join(sorted(known))}"
                close = did_you_mean(key, known) or ";"
                raise self.kind(f"{self.where}there is no field {self._label(key)}{close} {has}")
        return self

    def part(self, key: str) -> "Fields":
        """The object in a field; empty if it is absent or null."""
        raw = self.raw.get(key)
        return Fields({} if raw is None else raw, self.where, self.kind, self._label(key))

    def parts(self, key: str) -> list["Fields"]:
        """The objects in a list; none if it is absent."""
        raw = self.raw.get(key, [])
        if not isinstance(raw, list):
            raise self.error(key, "must be a list")
        return [
            Fields(x, self.where, self.kind, f"{self._label(key)}[{k}]") for k, x in enumerate(raw)
        ]

    def text(self, key: str, *, required: bool = False, rule: str = "must be a name") -> str | None:
        """A text that is not empty."""
        value = self.raw.get(key)
        if value is None and not required:
            return None
        if not isinstance(value, str) or not value:
            raise self.error(key, rule)
        if len(value) > _LONGEST_NAME:
            raise self.error(key, f"has {len(value):,} characters, more than {_LONGEST_NAME:,}")
        return value

    def choice(self, key: str, known: Collection[str], rule: str, default: Any = None) -> str:
        """One of some words."""
        value = self.raw.get(key, default)
        if not isinstance(value, str) or value not in known:
            raise self.error(key, rule)
        return value

    def number(
        self, key: str, unit: str, *, positive: bool = False, nonnegative: bool = False
    ) -> float | None:
        """A finite number."""
        value = self.raw.get(key)
        if value is None:
            return None
        if not is_number(value):
            raise self.error(key, f"must be a number [{unit}]")
        if (positive and value <= 0) or (nonnegative and value < 0):
            raise self.error(key, f"must be {'above' if positive else 'at least'} 0 {unit}")
        return float(value)

    def numbers(
        self, key: str, n: int, *, nonnegative: bool = False, rule: str = ""
    ) -> tuple[float, ...] | None:
        """A list of n finite numbers."""
        value = self.raw.get(key)
        if value is None:
            return None
        if not isinstance(value, list | tuple) or len(value) != n:
            raise self.error(key, rule or f"must be {n} numbers")
        if not all(map(is_number, value)):
            raise self.error(key, rule or f"must be {n} finite numbers")
        if nonnegative and min(value) < 0:
            raise self.error(key, "must not be negative")
        return tuple(float(x) for x in value)

    @contextmanager
    def naming(self, key: str) -> Iterator[None]:
        """Errors of the library inside the block name the field."""
        try:
            yield
        except self.kind:
            raise
        except WrenchbedError as error:
            raise self.kind(f"{self.where}{self._label(key)}: {error}") from error
