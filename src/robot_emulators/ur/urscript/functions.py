"""Functions of the controller that a program may call: a table by name."""

import inspect
from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Any

Steps = Generator[None, None, Any]
"""What a function that takes time makes: one `next` a control cycle, then its value."""
Act = Callable[..., Any]


@dataclass(frozen=True)
class Builtin:
    """One function.

    Attributes:
        act: called with the program's context and the arguments.
        signature: of it, with the names and defaults that programs use.
        waits: it makes `Steps`.
    """

    act: Act
    signature: inspect.Signature
    waits: bool


class Table(dict[str, Builtin]):
    """Functions by name; `add` is a decorator.

    The first parameter of a function is the context. One that makes `Steps` is a generator
    function.
    """

    def add(self, *names: str) -> Callable[[Act], Act]:
        """Put a function into the table, by its own name or others."""

        def put(act: Act) -> Act:
            waits = inspect.isgeneratorfunction(act)
            for name in names or (act.__name__,):
                self[name] = Builtin(act, inspect.signature(act), waits)
            return act

        return put
