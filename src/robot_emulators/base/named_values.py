"""Rules for values that users give by name: in faults (JSON) and in settings (text)."""

import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, fields
from sys import float_info
from typing import Any

from robot_emulators.errors import SettingError


@dataclass(frozen=True)
class Argument:
    """Rule for the value of one named argument or setting.

    Attributes:
        check: returns whether a value is allowed.
        what: text on what the value must be, for errors.
        default: value if none is given; a default that `check` refuses makes it compulsory.
        parse: converts text to a value.
    """

    check: Callable[[Any], bool]
    what: str
    default: Any = None
    parse: Callable[[str], Any] = str


def is_number(value: Any) -> bool:
    """Whether a value is a finite int or float; booleans do not count as numbers."""
    plain = isinstance(value, int | float) and not isinstance(value, bool)
    return plain and abs(value) <= float_info.max


def number(low: float, high: float, default: float | None = None) -> Argument:
    """Return the rule: a finite number ``low`` … ``high``; without a ``default`` compulsory."""
    return Argument(
        lambda v: is_number(v) and low <= v <= high, f"a number {low:g} … {high:g}", default, float
    )


def above(low: float) -> Argument:
    """Return the rule: a finite number greater than ``low``, without a default, so compulsory."""
    return Argument(lambda v: is_number(v) and v > low, f"a number above {low:g}", parse=float)


def integer(low: int, high: int, default: int | None = None) -> Argument:
    """Return the rule: an integer ``low`` … ``high``, as text also 0x1F; no default: compulsory."""
    return Argument(
        lambda v: is_number(v) and v == int(v) and low <= v <= high,
        f"a whole number {low} … {high}", default, lambda word: int(word, 0),
    )  # fmt: skip


def word(known: Collection[str], default: str | None = None) -> Argument:
    """Return the rule: one of the words in ``known``; without a ``default`` it is compulsory."""
    return Argument(
        lambda v: isinstance(v, str) and v in known, f"one of {', '.join(known)}", default
    )


def text(default: str = "", pattern: str = ".*", what: str = "text") -> Argument:
    """Return the rule: a text that matches a regular expression; errors call the value ``what``."""
    return Argument(
        lambda v: isinstance(v, str) and bool(re.fullmatch(pattern, v, re.DOTALL)), what, default
    )


def flag(default: bool | None = None) -> Argument:
    """Return the rule: True or False, as text ``on`` or ``off``; without ``default`` compulsory."""
    return Argument(
        lambda v: isinstance(v, bool), "true or false (on or off)", default,
        {"on": True, "off": False}.__getitem__,
    )  # fmt: skip


def setting(default: Any, argument: Argument, text: str) -> Any:
    """Make a field of `Settings` from its default, the rule for its value and its help text."""
    return field(default=default, metadata={"argument": argument, "text": text})


@dataclass(frozen=True)
class Settings:
    """Base class of an emulator's settings; each field is made by `setting` and checked.

    Raises:
        SettingError: names the value and what it must be.
    """

    def __post_init__(self) -> None:
        for f in fields(self):
            value, argument = getattr(self, f.name), f.metadata["argument"]
            if not argument.check(value):
                raise SettingError(f"{f.name} = {value!r} must be {argument.what}")


def described(*kinds: type[Settings]) -> dict[str, str]:
    """Return name → help text, with the default, of each setting of these classes of settings."""
    return {f.name: f.metadata["text"] for kind in kinds for f in fields(kind)}


def read(words: Mapping[str, str], *kinds: type[Settings]) -> list[Any]:
    """Parse ``--set name=value`` into one object of each class of settings, in the order of kinds.

    Args:
        words: name of a setting → its value as text; settings left out keep their defaults.
        kinds: classes of settings; each takes the names that it has.

    Raises:
        SettingError: no class has such a setting (lists all), or the text is no allowed value.
    """
    known = described(*kinds)
    for name in words:
        if name not in known:
            listed = "; ".join(f"{key}: {text}" for key, text in known.items())
            raise SettingError(f"--set {name}: there is no such setting. Known: {listed}")
    return [
        kind(**{f.name: _parsed(f.name, words[f.name], f.metadata["argument"])
                for f in fields(kind) if f.name in words})
        for kind in kinds
    ]  # fmt: skip


def _parsed(name: str, word: str, argument: Argument) -> Any:
    try:
        value = argument.parse(word)
    except (ValueError, KeyError):
        value = None
    if not argument.check(value):
        raise SettingError(f"--set {name}={word}: must be {argument.what}")
    return value
