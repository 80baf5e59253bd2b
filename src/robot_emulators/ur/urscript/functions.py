"""Table of the controller functions that a program may call, by name.

Annotations say what an argument must be: a number (``float``), `Three` or `Six` numbers, a truth
value (``bool``), or whatever can be shown as a text (``str``). Programs have each argument checked
and converted before the call; other annotations take any value.
"""

import inspect
from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, get_args

import numpy as np

from robot_emulators.ur.urscript.values import ScriptFaultError, Value, real, shown, truth

Steps = Generator[None, None, Any]
"""Generator of a function that takes time: yields once a control cycle, then returns a value."""
Act = Callable[..., Any]
Three = Annotated[np.ndarray, 3]
"""Annotation of an argument: three numbers, converted to an array (3,)."""
Six = Annotated[np.ndarray, 6]
"""Annotation of an argument: six numbers, converted to an array (6,)."""
MOST = 1e6
"""Largest magnitude that a robot quantity can have, in SI units."""


def number(value: Value, what: str) -> float:
    """Convert a URScript number to float; `ScriptFaultError`, naming ``what``, above `MOST`."""
    plain = real(value, what)
    if abs(plain) > MOST:
        raise ScriptFaultError(f"{what} = {plain:g} is no quantity of a robot")
    return plain


def vector(value: Value, what: str, count: int = 6) -> np.ndarray:
    """Convert a list of ``count`` numbers to an array; else `ScriptFaultError`, naming ``what``."""
    if not isinstance(value, list) or len(value) != count:
        raise ScriptFaultError(f"{what} must be a list of {count} numbers")
    numbers = np.array([real(v, f"each element of {what}") for v in value])
    if not (np.abs(numbers) <= MOST).all():
        raise ScriptFaultError(f"{what} holds what no quantity of a robot can be")
    return numbers


CONVERTERS: dict[str, Callable[[Value, str], Any]] = {
    "number": number, "six": vector, "three": lambda value, what: vector(value, what, 3),
    "truth": lambda value, what: truth(value), "text": lambda value, what: shown(value),
}  # fmt: skip
"""Kind of argument → function that converts its value, given value and name."""
_KINDS: dict[object, str] = {
    float: "number", Six: "six", Three: "three", bool: "truth", str: "text",
}  # fmt: skip


@dataclass(frozen=True)
class Builtin:
    """One controller function that URScript programs may call.

    Attributes:
        act: called with the program's context and the arguments.
        signature: parameters with defaults of ``act``; the first is the context.
        kinds: name of a parameter → its key in `CONVERTERS`, if it is converted.
        waits: whether it is a generator that yields once per control cycle (`Steps`).
    """

    act: Act
    signature: inspect.Signature
    kinds: Mapping[str, str]
    waits: bool

    @property
    def parameters(self) -> list[str]:
        """Names of the parameters that programs can pass, in order."""
        return list(self.signature.parameters)[1:]


class Table(dict[str, Builtin]):
    """Functions that URScript programs may call, by name; `add` makes the decorator. A function's
    first parameter is the context (`ScriptProgram`); a generator function takes control cycles
    (`Steps`)."""

    def add(self, *names: str) -> Callable[[Act], Act]:
        """Return a decorator that adds a function to the table, by its own name or these names."""

        def put(act: Act) -> Act:
            signature = inspect.signature(act)
            kinds: dict[str, str] = {}
            for name, parameter in signature.parameters.items():
                for kind in (parameter.annotation, *get_args(parameter.annotation)):
                    if kind in _KINDS:
                        kinds.setdefault(name, _KINDS[kind])
            waits = inspect.isgeneratorfunction(act)
            for name in names or (act.__name__,):
                self[name] = Builtin(act, signature, kinds, waits)
            return act

        return put
