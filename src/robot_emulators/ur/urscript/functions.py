"""Functions that a program may call: a table by name, with parameters as the language has them."""

import inspect
from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass
from typing import Any

from robot_emulators.ur.urscript.faults import ScriptFaultError
from robot_emulators.ur.urscript.syntax import Call

Steps = Generator[None, None, Any]
"""What a function that takes time makes: one `next` a control cycle, then its value."""
_NEEDED = inspect.Parameter.empty


@dataclass(frozen=True)
class Builtin:
    """One function.

    Attributes:
        act: called with the program's context and the arguments.
        parameters: name → default, `inspect.Parameter.empty` without one.
        waits: it makes `Steps`.
        named: it takes any arguments by name.
    """

    act: Callable[..., Any]
    parameters: Mapping[str, Any]
    waits: bool
    named: bool = False

    def order(self, call: Call) -> tuple[list[tuple[str, int]], list[Any]]:
        """Where each parameter's value comes from, and defaults; by place or name.

        Returns:
            a pair a parameter: ("place", k), ("name", k) or ("default", k); and the defaults.

        Raises:
            ScriptFaultError: too many arguments, an unknown name, or one that is missing.
        """
        names = list(self.parameters)
        if len(call.places) > len(names):
            raise self._wrong(call, f"takes {len(names)} arguments at most")
        given = {names[k]: ("place", k) for k in range(len(call.places))}
        for k, (name, _) in enumerate(call.names):
            if name not in self.parameters or name in given:
                raise self._wrong(call, f"cannot take an argument {name}")
            given[name] = ("name", k)
        defaults: list[Any] = []
        for name, default in self.parameters.items():
            if name not in given:
                if default is _NEEDED:
                    raise self._wrong(call, f"needs an argument {name}")
                given[name] = ("default", len(defaults))
                defaults.append(default)
        return [given[name] for name in names], defaults

    @staticmethod
    def _wrong(call: Call, why: str) -> ScriptFaultError:
        return ScriptFaultError(f"{call.name} {why}", call.line, call.column)


class Table(dict[str, Builtin]):
    """Functions by name; `add` is a decorator.

    The first parameter of a function is the context. One that makes `Steps` is a generator
    function, or is added with ``waits=True``.
    """

    def add(
        self, *names: str, waits: bool | None = None
    ) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
        """Put a function into the table, by its own name or others."""

        def put(act: Callable[..., Any]) -> Callable[..., Any]:
            _, *rest = inspect.signature(act).parameters.values()
            named = any(p.kind is p.VAR_KEYWORD for p in rest)
            parameters = {p.name: p.default for p in rest if p.kind is not p.VAR_KEYWORD}
            takes_time = inspect.isgeneratorfunction(act) if waits is None else waits
            for name in names or (act.__name__,):
                self[name] = Builtin(act, parameters, takes_time, named)
            return act

        return put
