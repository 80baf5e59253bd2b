"""What a fault may be told besides its time: one check a value, with its default."""

from collections.abc import Callable, Collection
from dataclasses import dataclass
from math import isfinite
from typing import Any


@dataclass(frozen=True)
class Ask:
    """One value.

    Attributes:
        check: whether it may be this.
        what: it must be, in words.
        default: where it is not given; one that `check` refuses makes it compulsory.
    """

    check: Callable[[Any], bool]
    what: str
    default: Any = None


def number(low: float, high: float, default: float | None = None) -> Ask:
    """A number from low to high."""
    return Ask(
        lambda v: _is_number(v) and low <= v <= high, f"a number {low:g} … {high:g}", default
    )


def whole(low: int, high: int, default: int | None = None) -> Ask:
    """A whole number from low to high."""
    return Ask(
        lambda v: _is_number(v) and v == int(v) and low <= v <= high,
        f"a whole number {low} … {high}", default,
    )  # fmt: skip


def word(known: Collection[str], default: str | None = None) -> Ask:
    """One of some words."""
    shown = list(known)
    return Ask(lambda v: isinstance(v, str) and v in known, f"one of {shown}", default)


def text(default: str) -> Ask:
    """Any text."""
    return Ask(lambda v: isinstance(v, str), "text", default)


def flag(default: bool) -> Ask:
    """True or false."""
    return Ask(lambda v: isinstance(v, bool), "true or false", default)


def numbers(count: int, most: float) -> Ask:
    """A list of numbers, none beyond ± most."""
    return Ask(
        lambda v: isinstance(v, list) and len(v) == count
        and all(_is_number(x) and abs(x) <= most for x in v),
        f"{count} numbers, none beyond {most:g}",
    )  # fmt: skip


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)
