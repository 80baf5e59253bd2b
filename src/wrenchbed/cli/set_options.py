"""NAME=VALUE words of ``--set``, as values of a driver's options."""

from collections.abc import Mapping, Sequence
from dataclasses import fields
from types import NoneType, UnionType
from typing import Any, get_args, get_origin, get_type_hints

from wrenchbed.errors import ParameterError

_SIMPLE = {int: "a whole number", float: "a number", str: "text", bool: "on or off"}


def pairs(words: Sequence[str]) -> dict[str, str]:
    """Values by name, as text.

    Raises:
        ParameterError: a word is not NAME=VALUE.
    """
    split = [word.partition("=") for word in words]
    for word, (name, equals, _) in zip(words, split, strict=True):
        if not name or not equals:
            raise ParameterError(f"--set {word}: give NAME=VALUE")
    return {name: value for name, _, value in split}


def typed(options: type, words: Mapping[str, str], excluded: Sequence[str]) -> dict[str, Any]:
    """Values for fields of an options dataclass; fields with a flag of their own are excluded.

    Raises:
        ParameterError: no such field (the message lists all), or a value of another type.
    """
    hints = get_type_hints(options)
    known = {f.name: hints[f.name] for f in fields(options) if f.name not in excluded}
    known = {name: hint for name, hint in known.items() if _simple_types(hint)}
    values = {}
    for name, word in words.items():
        if name not in known:
            raise ParameterError(f"--set {name}: no such setting. Known: {', '.join(known)}")
        try:
            values[name] = _value(known[name], word)
        except ValueError as error:
            rule = _rule(known[name])
            raise ParameterError(f"--set {name}={word}: must be {rule}") from error
    return values


def _simple_types(hint: Any) -> tuple[Any, ...]:
    """The simple types that a hint is made of; empty if no word can be its value."""
    if hint in _SIMPLE:
        return (hint,)
    inner = tuple(a for a in get_args(hint) if a not in (NoneType, Ellipsis))
    simple = get_origin(hint) in (tuple, UnionType) and inner and all(map(_simple_types, inner))
    return inner if simple else ()


def _rule(hint: Any) -> str:
    text = _SIMPLE[_simple_types(hint)[0]]
    if get_origin(hint) is tuple:
        return f"{text}, or several with commas between"
    return text + (" or none" if get_origin(hint) is UnionType else "")


def _value(hint: Any, word: str) -> Any:
    if get_origin(hint) is UnionType:
        return None if word == "none" else _value(_simple_types(hint)[0], word)
    if get_origin(hint) is tuple:
        return tuple(_value(_simple_types(hint)[0], part) for part in word.split(","))
    if hint is bool:
        if word not in ("on", "off"):
            raise ValueError
        return word == "on"
    return int(word, 0) if hint is int else hint(word)
