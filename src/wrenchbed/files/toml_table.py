"""A table of a user's TOML whose fields are checked as they are read, and values as TOML writes
them."""

from collections.abc import Collection, Iterable, Mapping
from math import inf, isfinite
from sys import float_info
from typing import Any, NoReturn

from wrenchbed.errors import ParameterError, did_you_mean
from wrenchbed.files.nested_text import parsed


class TomlTable:
    """One table.

    Args:
        raw: what TOML gives; anything but a mapping is refused.
        where: the file, for messages.
        name: of the table in front of a field's name, for instance ``[mass] ``.

    Raises:
        ParameterError: it is no table.
    """

    def __init__(self, raw: Any, where: str, name: str = "") -> None:
        self.where, self.name = where, name
        if not isinstance(raw, Mapping):
            raise ParameterError(f"{where}: {name.strip(': ') or 'the file'} must be a table")
        self.raw = raw

    @classmethod
    def of(cls, text: str, where: str) -> "TomlTable":
        """The top table of a file's text.

        Raises:
            ParameterError: it is not valid TOML.
        """
        return cls(parsed(text.encode(), f"{where}:", ParameterError, "TOML"), where)

    def refuse(self, key: str, rule: str) -> NoReturn:
        """Raise the error of a field that breaks a rule (``must be …``), or is missing."""
        if key not in self.raw:
            raise ParameterError(f"{self.where}: {self.name}{key} is missing: it {rule}")
        raise ParameterError(f"{self.where}: {self.name}{key} = {self.raw[key]!r} {rule}")

    def only(self, known: Collection[str]) -> "TomlTable":
        """Refuse fields of other names."""
        for key in self.raw:
            if key not in known:
                raise ParameterError(
                    f"{self.where}: {self.name}there is no field {key!r}"
                    f"{did_you_mean(key, known)}. Known: {', '.join(sorted(known))}"
                )
        return self

    def part(self, key: str) -> "TomlTable":
        """A table within this one."""
        if key not in self.raw:
            self.refuse(key, f"must be a table [{key}]")
        return TomlTable(self.raw[key], self.where, f"[{key}] ")

    def text(self, key: str) -> str:
        """A text that is not empty."""
        value = self.raw.get(key)
        if not isinstance(value, str) or not value.strip():
            self.refuse(key, "must be a text that is not empty")
        return value

    def number(self, key: str, rule: str = "must be a finite number") -> float:
        """A finite number."""
        value = self.raw.get(key)
        if value is None or not _is_number(value):
            self.refuse(key, rule)
        return float(value)

    def amount(self, key: str, unit: str, most: float = inf, not_in: str = "") -> float:
        """A number from 0 to ``most`` in a unit; beyond it may be ``not_in`` another unit."""
        value = self.number(key, f"must be a number in {unit}, without its unit")
        if not 0.0 <= value <= most:
            hint = f" (is it in {not_in}?)" if not_in and value > most else ""
            upto = f" … {most:g}" if isfinite(most) else " or more"
            self.refuse(key, f"must be 0{upto} {unit}{hint}")
        return value

    def numbers(
        self, key: str, count: int, rule: str = "", most: float = inf, not_in: str = ""
    ) -> list[float]:
        """So many finite numbers within ± ``most``; beyond it may be ``not_in`` another unit."""
        value, rule = self.raw.get(key), rule or f"must be {count} numbers"
        if not isinstance(value, list) or len(value) != count or not all(map(_is_number, value)):
            self.refuse(key, rule)
        if max(map(abs, value)) > most:
            self.refuse(key, f"{rule}, within {most:g} (is it in {not_in}?)")
        return [float(v) for v in value]


def _is_number(value: Any) -> bool:
    plain = isinstance(value, int | float) and not isinstance(value, bool)
    return plain and abs(value) <= float_info.max


def quoted(words: str) -> str:
    """A TOML string of one line."""
    escaped = words.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() else f"\\u{ord(c):04x}" for c in escaped) + '"'


def listed(values: Iterable[float]) -> str:
    """A TOML array of numbers, with all their digits."""
    return "[" + ", ".join(repr(float(v)) for v in values) + "]"
