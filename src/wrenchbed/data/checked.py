"""Checked JSON and TOML: a file's objects, read with errors that name file, field and rule.

`load` and `parsed` are those of `files.nested_text`.
"""

from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from sys import float_info
from typing import Any

from wrenchbed.errors import WrenchbedError, did_you_mean
from wrenchbed.files.nested_text import load, parsed

__all__ = ["Fields", "is_number", "load", "parsed"]
_LONGEST_NAME = 4096
"""Longest name [characters]: the longest path of Linux."""


def is_number(value: Any) -> bool:
    """Whether a value is a finite number (true and false are none)."""
    plain = isinstance(value, int | float) and not isinstance(value, bool)
    return plain and abs(value) <= float_info.max


class Fields:
    """An object of a JSON or TOML file; each field is checked when it is read.

    Args:
        raw: the object as it was parsed.
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
        """Raise the error for a field that is not known, with the nearest name; return the object.

        Args:
            known: names of all fields.
            what: has these fields, for the message.
        """
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
        """Objects in a list; none if the field is absent."""
        raw = self.raw.get(key, [])
        if not isinstance(raw, list):
            raise self.error(key, "must be a list")
        return [
            Fields(x, self.where, self.kind, f"{self._label(key)}[{k}]") for k, x in enumerate(raw)
        ]

    def text(self, key: str, *, required: bool = False, rule: str = "must be a name") -> str | None:
        """Text of a field that is not empty."""
        value = self.raw.get(key)
        if value is None and not required:
            return None
        if not isinstance(value, str) or not value:
            raise self.error(key, rule)
        if len(value) > _LONGEST_NAME:
            raise self.error(key, f"has {len(value):,} characters, more than {_LONGEST_NAME:,}")
        return value

    def choice(self, key: str, known: Collection[str], rule: str, default: Any = None) -> str:
        """Text of a field that must be one of the known words."""
        value = self.raw.get(key, default)
        if not isinstance(value, str) or value not in known:
            raise self.error(key, rule)
        return value

    def number(
        self, key: str, unit: str, *, positive: bool = False, nonnegative: bool = False
    ) -> float | None:
        """Finite number of a field."""
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
        """List of n finite numbers of a field."""
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

    def square(self, key: str, size: int) -> list[list[float]]:
        """A matrix (size, size) of finite numbers."""
        rows = self.raw.get(key)
        if (
            not isinstance(rows, list)
            or len(rows) != size
            or not all(
                isinstance(r, list) and len(r) == size and all(map(is_number, r)) for r in rows
            )
        ):
            rule = f"must be a matrix of {size} × {size} finite numbers"
            raise self.kind(f"{self.where}{self._label(key)} {rule}")
        return [[float(x) for x in row] for row in rows]

    @contextmanager
    def naming(self, key: str) -> Iterator[None]:
        """Errors of the library inside the block name the field."""
        try:
            yield
        except self.kind:
            raise
        except WrenchbedError as error:
            raise self.kind(f"{self.where}{self._label(key)}: {error}") from error
