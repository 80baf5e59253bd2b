"""Values of URScript and the results of its operators.

A value is a number, a truth value, a text, a list, a pose (`Pose`, a list of six) or a struct
(dict). Lists take part in sums and products element by element, as newer controllers do.
"""

import math
from collections.abc import Callable
from typing import Any

NO_NAME = "compile_error_name_not_found:{}:"
"""Controller's message on an unknown name; ``{}`` stands for the name."""
Value = Any
"""A URScript value: float, int, bool, str, list, `Pose` or dict."""
_EXACT = 2**53
"""Magnitude beyond which whole numbers become floating point, so that none grows without bound."""
LONGEST_TEXT, LONGEST_LIST = 1 << 15, 1 << 12


class ScriptFaultError(Exception):
    """Raised when a URScript program fails and cannot continue.

    Attributes:
        text: what is wrong.
        line, column: place in the program's text, from 1; 0 if unknown.
    """

    def __init__(self, text: str, line: int = 0, column: int = 0) -> None:
        super().__init__(text)
        self.text, self.line, self.column = text, line, column

    def at(self, line: int, column: int) -> "ScriptFaultError":
        """Return this error with a line and column of the program, unless it has them already."""
        return self if self.line else ScriptFaultError(self.text, line, column)


class ProgramEndsError(Exception):
    """Raised where a URScript program ends itself by ``halt``."""


class Pose(list[Any]):
    """URScript's pose ``p[x, y, z, rx, ry, rz]``: position [m] and rotation vector [rad]."""


def copied(value: Value) -> Value:
    """Return a URScript value; a list or struct as a deep copy, as no two variables share one."""
    if isinstance(value, list):
        return type(value)(copied(v) if isinstance(v, list | dict) else v for v in value)
    return {k: copied(v) for k, v in value.items()} if isinstance(value, dict) else value


def shown(value: Value) -> str:
    """Text of a URScript value, as the functions textmsg and str_cat write it."""
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list):
        inside = ", ".join(shown(v) for v in value[:LONGEST_LIST])
        return f"p[{inside}]" if isinstance(value, Pose) else f"[{inside}]"
    if isinstance(value, dict):
        return f"struct({', '.join(f'{k}={shown(v)}' for k, v in value.items())})"
    return str(value)


def truth(value: Value) -> bool:
    """Convert a condition's value to bool; raise `ScriptFaultError` for a value of another type."""
    if isinstance(value, bool | int | float):
        return bool(value)
    raise ScriptFaultError(f"a condition must be true or false, not {kind(value)}")


def kind(value: Value) -> str:
    """Type of a URScript value in words, such as ``a list``, for error messages."""
    for of, word in ((bool, "a truth value"), (int | float, "a number"), (str, "a text"),
                     (Pose, "a pose"), (list, "a list"), (dict, "a struct")):  # fmt: skip
        if isinstance(value, of):
            return word
    return "nothing"


def real(value: Value, what: str = "an argument") -> float:
    """Convert a value to a finite float, else raise `ScriptFaultError`, which calls it ``what``."""
    if isinstance(value, int | float) and math.isfinite(value):
        return float(value)
    raise ScriptFaultError(f"{what} must be a number, not {kind(value)}")


def _arithmetic(sign: str, act: Callable[[Any, Any], Any]) -> Callable[[Value, Value], Value]:
    def number(left: Value, right: Value) -> Value:
        try:
            value = act(left, right)
            return float(value) if isinstance(value, int) and abs(value) > _EXACT else value
        except ZeroDivisionError:
            raise ScriptFaultError("division by zero") from None
        except OverflowError:
            return math.inf

    def of(left: Value, right: Value) -> Value:
        if isinstance(left, int | float) and isinstance(right, int | float):
            return number(left, right)
        if isinstance(left, list) and isinstance(right, list):
            if len(left) != len(right):
                raise ScriptFaultError(f"{sign} of lists of {len(left)} and {len(right)} elements")
            return type(left)(of(a, b) for a, b in zip(left, right, strict=True))
        if isinstance(left, list) and isinstance(right, int | float):
            return type(left)(of(a, right) for a in left)
        if isinstance(right, list) and isinstance(left, int | float):
            return type(right)(of(left, b) for b in right)
        raise ScriptFaultError(f"{sign} of {kind(left)} and {kind(right)}")

    return of


def _ordered(sign: str, act: Callable[[Any, Any], bool]) -> Callable[[Value, Value], bool]:
    def of(left: Value, right: Value) -> bool:
        if isinstance(left, int | float) and isinstance(right, int | float):
            return act(left, right)
        raise ScriptFaultError(f"{sign} of {kind(left)} and {kind(right)}")

    return of


def _modulo(a: float, b: float) -> float:
    return math.fmod(a, b) if isinstance(a, float) or isinstance(b, float) else a % b


def _power(a: float, b: float) -> float:
    if (a == 0 and b < 0) or isinstance(value := float(a) ** float(b), complex):
        raise ScriptFaultError(f"{a:g} to the power of {b:g}")
    return float(value)


ACTS: dict[str, Callable[[Value, Value], Value]] = {
    "+": _arithmetic("+", lambda a, b: a + b),
    "-": _arithmetic("-", lambda a, b: a - b),
    "*": _arithmetic("*", lambda a, b: a * b),
    "/": _arithmetic("/", lambda a, b: a / b),
    "%": _arithmetic("%", _modulo),
    "^": _arithmetic("^", _power),
    "<": _ordered("<", lambda a, b: a < b),
    ">": _ordered(">", lambda a, b: a > b),
    "<=": _ordered("<=", lambda a, b: a <= b),
    ">=": _ordered(">=", lambda a, b: a >= b),
    "xor": lambda a, b: truth(a) != truth(b),
}
"""Sign of an operator → function that computes it from its two operands."""


def _at(holder: list[Value], index: Value) -> int:
    if isinstance(index, bool) or not isinstance(index, int | float) or index != int(index):
        raise ScriptFaultError(f"an index must be a whole number, not {shown(index)}")
    if not 0 <= index < len(holder):
        raise ScriptFaultError(f"index {int(index)} of a list of {len(holder)} elements")
    return int(index)


def get(holder: Value, key: Value) -> Value:
    """Return an element of ``holder``: of a list by index ``key``, of a struct by name ``key``."""
    if isinstance(holder, list):
        return holder[_at(holder, key)]
    if isinstance(holder, dict) and key in holder:
        return holder[key]
    raise _without(holder, key)


def put(value: Value, holder: Value, key: Value) -> None:
    """Set an element of ``holder``: of a list by index ``key``, of a struct by name ``key``."""
    if isinstance(holder, list):
        holder[_at(holder, key)] = value
    elif isinstance(holder, dict) and key in holder:
        holder[key] = value
    else:
        raise _without(holder, key)


def _without(holder: Value, key: Value) -> ScriptFaultError:
    if isinstance(holder, dict):
        return ScriptFaultError(f"the struct has no {shown(key)}")
    return ScriptFaultError(f"{kind(holder)} has no elements")
