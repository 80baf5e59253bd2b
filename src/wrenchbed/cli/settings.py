"""NAME=VALUE of settings that one driver or one twin alone has."""

from collections.abc import Mapping, Sequence
from dataclasses import fields
from types import NoneType, UnionType
from typing import Any, get_args, get_origin, get_type_hints

from wrenchbed.errors import ParameterError

_SIMPLE = {int: "a whole number", float: "a number", str: "text", bool: "on or off"}


def pairs(given: Sequence[str]) -> dict[str, str]:
    """Words by name.

    Raises:
        ParameterError: one is not NAME=VALUE.
    """
    split = [text.partition("=") for text in given]
    for text, (name, equals, _) in zip(given, split, strict=True):
        if not name or not equals:
            raise ParameterError(f"--set {text}: give NAME=VALUE")
    return {name: value for name, _, value in split}


def typed(options: type, words: Mapping[str, str], besides: Sequence[str]) -> dict[str, Any]:
    """Values of fields of an options' dataclass; those that have a flag of their own are refused.

    Raises:
        ParameterError: no such field, listing all, or a word that is no value of its type.
    """
    hints = get_type_hints(options)
    known = {f.name: hints[f.name] for f in fields(options) if f.name not in besides}
    known = {name: hint for name, hint in known.items() if _parts(hint)}
    found = {}
    for name, word in words.items():
        if name not in known:
            raise ParameterError(f"--set {name}: no such setting. Known: {', '.join(known)}")
        try:
            found[name] = _value(known[name], word)
        except ValueError as error:
            raise ParameterError(f"--set {name}={word}: must be {_what(known[name])}") from error
    return found


def _parts(hint: Any) -> tuple[Any, ...]:
    """What a word of this type is made of; nothing where no word can be one."""
    if hint in _SIMPLE:
        return (hint,)
    inner = tuple(a for a in get_args(hint) if a not in (NoneType, Ellipsis))
    simple = get_origin(hint) in (tuple, UnionType) and inner and all(map(_parts, inner))
    return inner if simple else ()


def _what(hint: Any) -> str:
    """What a word must be."""
    inner = _parts(hint)[0]
    if get_origin(hint) is tuple:
        return f"{_SIMPLE[inner]}, or several with commas between"
    return _SIMPLE[inner] + (" or none" if get_origin(hint) is UnionType else "")


def _value(hint: Any, word: str) -> Any:
    if get_origin(hint) is UnionType:
        inner = next(a for a in get_args(hint) if a is not NoneType)
        return None if word == "none" else _value(inner, word)
    if get_origin(hint) is tuple:
        inner = _parts(hint)[0]
        return tuple(_value(inner, part) for part in word.split(","))
    if hint is bool:
        if word not in ("on", "off"):
            raise ValueError
        return word == "on"
    return int(word, 0) if hint is int else hint(word)
