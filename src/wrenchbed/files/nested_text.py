"""JSON and TOML of others: read within limits of size and depth, or refused by one line."""

import json
import tomllib
from collections.abc import Collection
from pathlib import Path
from typing import Any

from wrenchbed.errors import WrenchbedError, raise_shortage

_LARGEST = {"JSON": 2**25, "TOML": 2**20}
"""Of a file [bytes]: 10 times the largest diagnosis and 100 times the largest map."""
_MOST_DOTS = 200
"""In a line of TOML: time and memory of `tomllib` grow with the square of a key's parts."""
_PARQUET = b"PAR1"
"""How such files begin."""
_DEEPEST = 100
"""Levels of nested objects and lists: wrenchbed writes 7, Python's recursion ends at 1,000."""


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
    if raw.startswith(_PARQUET):
        raise error(f"{where} is Parquet, such as recordings and plans, not {kind}")
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


def text_of(path: Path, error: type[WrenchbedError], kind: str = "TOML") -> str:
    """The text of a regular file, not read beyond what a file of its kind may hold.

    Raises:
        error: no such file, or it is no text; a longer one is left to `parsed` to refuse.
    """
    if path.exists() and not path.is_file():  # a pipe would be waited for
        raise error(f"{path}: is no regular file: give a {kind} file")
    try:
        with path.open("rb") as file:
            return file.read(_LARGEST[kind] + 1).decode()
    except (OSError, UnicodeDecodeError) as cause:
        why = getattr(cause, "strerror", None) or "it is no text"
        raise error(f"{path}: cannot be read: {why}") from None


def _dots(line: str) -> int:
    return line.count(".")


def _inner(part: Any) -> Collection[Any]:
    return part.values() if isinstance(part, dict) else part if isinstance(part, list) else ()
