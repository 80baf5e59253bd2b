"""A tree to closures: what takes no time is a plain call, what may wait is a generator.

Which is which follows from the tree alone: a function may wait when it calls one that does. So a
program pays for waiting only where it waits.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, fields
from typing import Any

from robot_emulators.ur.urscript import syntax as tree
from robot_emulators.ur.urscript import values
from robot_emulators.ur.urscript.faults import (
    NO_NAME,
    ProgramEndsError,
    ScriptFaultError,
)
from robot_emulators.ur.urscript.functions import Builtin, Steps
from robot_emulators.ur.urscript.threads import Closure, Frame

Act = Callable[[Frame], Any]
"""Of an expression: its value. Of a block: None, "break", "continue" or `Returned`."""


@dataclass(frozen=True, slots=True)
class Returned:
    """A function's value on its way out."""

    value: Any


@dataclass(frozen=True, slots=True)
class Part:
    """A compiled expression or block; one that waits is a generator function."""

    act: Act
    waits: bool = False

    def steps(self, frame: Frame) -> Steps:
        """As a generator in any case."""
        if self.waits:
            return (yield from self.act(frame))
        return self.act(frame)


def functions_in(block: tree.Block) -> Iterator[tree.Function]:
    """All functions of a tree, at any depth."""
    for node in walk(block):
        if isinstance(node, tree.Function):
            yield node


def walk(block: Iterable[Any]) -> Iterator[Any]:
    """All nodes of a tree."""
    left = list(block)
    while left:
        node = left.pop()
        if isinstance(node, tuple):
            left.extend(node)
        elif isinstance(node, tree.Node):
            yield node
            left.extend(getattr(node, name) for name in _fields(type(node)))


def _fields(kind: type[tree.Node]) -> tuple[str, ...]:
    return tuple(f.name for f in fields(kind) if f.name not in ("line", "column"))


def waiting(block: tree.Block, table: Mapping[str, Builtin]) -> frozenset[str]:
    """Names of functions that may wait."""
    calls: dict[str, set[str]] = {}
    found = {name for name, builtin in table.items() if builtin.waits}
    for function in functions_in(block):
        inside = list(walk(function.body))
        called = calls.setdefault(function.name, set())
        called |= {node.name for node in inside if isinstance(node, tree.Call)}
        if any(isinstance(node, tree.ThreadEnd) and node.how == "join" for node in inside):
            found.add(function.name)
    while more := {n for n, called in calls.items() if n not in found and called & found}:
        found |= more
    return frozenset(found)


class Compiler:
    """Compiles one program.

    Args:
        block: the program.
        table: functions that it may call besides its own.
    """

    def __init__(self, block: tree.Block, table: Mapping[str, Builtin]) -> None:
        self._table = table
        self._own = {function.name for function in functions_in(block)}
        self._waiting = waiting(block, table)
        self.program = self.block(block)

    def block(self, block: tree.Block) -> Part:
        """Statements one after the other; functions are known from the start."""
        first = [self._define(s) for s in block if isinstance(s, tree.Function)]
        rest = [self.statement(s) for s in block if not isinstance(s, tree.Function)]
        parts = first + rest
        if any(part.waits for part in parts):
            return Part(_waiting_block([(p.act, p.waits) for p in parts]), True)
        return Part(_plain_block([p.act for p in parts]))

    def statement(self, node: tree.Statement) -> Part:
        """One statement."""
        return self._statements[type(node)](self, node)

    def expression(self, node: tree.Expression) -> Part:
        """One expression."""
        return self._expressions[type(node)](self, node)

    def _define(self, node: tree.Function) -> Part:
        body = self.block(node.body)
        names = [name for name, _ in node.parameters]
        defaults = [None if d is None else self.expression(d) for _, d in node.parameters]

        def define(frame: Frame) -> None:
            frame.functions[node.name] = Closure(node.name, names, defaults, body, frame)

        return Part(define)

    def _assign(self, node: tree.Assign) -> Part:
        value, target = self.expression(node.value), node.target
        if isinstance(target, tree.Name):
            store = _storing(target.name, node.scope)
            if value.waits:

                def later(frame: Frame) -> Steps:
                    store(frame, values.copied((yield from value.act(frame))))

                return Part(later, True)
            act = value.act
            return Part(lambda frame: store(frame, values.copied(act(frame))))
        holder = self.expression(target.target)
        at = (
            self.expression(target.at)
            if isinstance(target, tree.Index)
            else Part(lambda frame: target.name)
        )
        return _combined([value, holder, at], lambda frame, v, h, a: _put(h, a, v), node, True)

    def _evaluate(self, node: tree.Evaluate) -> Part:
        part = self.expression(node.value)
        if part.waits:

            def later(frame: Frame) -> Steps:
                yield from part.act(frame)

            return Part(later, True)
        act = part.act

        def now(frame: Frame) -> None:
            act(frame)

        return Part(now)

    def _if(self, node: tree.If) -> Part:
        branches = [(self.expression(c), self.block(b)) for c, b in node.branches]
        otherwise = self.block(node.otherwise)
        if otherwise.waits or any(c.waits or b.waits for c, b in branches):

            def later(frame: Frame) -> Steps:
                for condition, block in branches:
                    if values.truth((yield from condition.steps(frame))):
                        return (yield from block.steps(frame))
                return (yield from otherwise.steps(frame))

            return Part(_placed_steps(later, node), True)
        pairs, last = [(c.act, b.act) for c, b in branches], otherwise.act

        def now(frame: Frame) -> Any:
            for condition, block in pairs:
                if values.truth(condition(frame)):
                    return block(frame)
            return last(frame)

        return Part(_placed(now, node))

    def _while(self, node: tree.While) -> Part:
        condition, body = self.expression(node.condition), self.block(node.body)
        if condition.waits or body.waits:

            def later(frame: Frame) -> Steps:
                while values.truth((yield from condition.steps(frame))):
                    frame.threads.spend()
                    how = yield from body.steps(frame)
                    if how is not None and how != "continue":
                        return None if how == "break" else how
                return None

            return Part(_placed_steps(later, node), True)
        test, act = condition.act, body.act

        def now(frame: Frame) -> Any:
            while values.truth(test(frame)):
                frame.threads.spend()
                how = act(frame)
                if how is not None and how != "continue":
                    return None if how == "break" else how
            return None

        return Part(_placed(now, node))

    def _return(self, node: tree.Return) -> Part:
        if node.value is None:
            return Part(lambda frame: Returned(None))
        return _combined([self.expression(node.value)], lambda frame, v: Returned(v), node)

    def _leave(self, node: tree.Leave) -> Part:
        if node.how != "halt":
            return Part(lambda frame: node.how)

        def halt(frame: Frame) -> None:
            raise ProgramEndsError

        return Part(halt)

    def _thread_end(self, node: tree.ThreadEnd) -> Part:
        thread = self.expression(node.thread)
        if node.how == "kill":
            return _combined([thread], lambda frame, t: frame.threads.kill(t), node, True)

        def join(frame: Frame) -> Steps:
            number = yield from thread.steps(frame)
            yield from frame.threads.join(number)

        return Part(_placed_steps(join, node), True)

    def _literal(self, node: tree.Literal) -> Part:
        value = node.value
        return Part(lambda frame: value)

    def _name(self, node: tree.Name) -> Part:
        name = node.name

        def read(frame: Frame) -> Any:
            holder: Frame | None = frame
            while holder is not None:
                if name in holder.names:
                    return holder.names[name]
                holder = holder.parent
            raise ScriptFaultError(NO_NAME.format(name), node.line, node.column)

        return Part(read)

    def _list(self, node: tree.ListOf) -> Part:
        made = values.Pose if node.pose else list
        if node.pose and len(node.items) != 6:
            raise ScriptFaultError("a pose has six elements", node.line, node.column)
        return _combined(
            [self.expression(item) for item in node.items],
            lambda frame, *items: made(values.copied(item) for item in items), node,
        )  # fmt: skip

    def _unary(self, node: tree.Unary) -> Part:
        act = _UNARY[node.operator]
        return _combined([self.expression(node.operand)], lambda frame, v: act(v), node)

    def _binary(self, node: tree.Binary) -> Part:
        left, right = self.expression(node.left), self.expression(node.right)
        if node.operator in ("and", "or"):
            return self._short(node, left, right)
        act = values.OPERATORS[node.operator]
        if left.waits or right.waits:
            return _combined([left, right], lambda frame, a, b: act(a, b), node)
        first, second = left.act, right.act
        return Part(_placed(lambda frame: act(first(frame), second(frame)), node))

    @staticmethod
    def _short(node: tree.Binary, left: Part, right: Part) -> Part:
        """The right side is looked at only where it matters."""
        decided = node.operator == "or"
        if left.waits or right.waits:

            def later(frame: Frame) -> Steps:
                if values.truth((yield from left.steps(frame))) == decided:
                    return decided
                return values.truth((yield from right.steps(frame)))

            return Part(_placed_steps(later, node), True)
        first, second, truth = left.act, right.act, values.truth

        def now(frame: Frame) -> bool:
            return decided if truth(first(frame)) == decided else truth(second(frame))

        return Part(_placed(now, node))

    def _index(self, node: tree.Index) -> Part:
        parts = [self.expression(node.target), self.expression(node.at)]
        return _combined(parts, lambda frame, holder, at: _get(holder, at), node)

    def _member(self, node: tree.Member) -> Part:
        name = node.name
        return _combined(
            [self.expression(node.target)], lambda frame, holder: _get(holder, name), node
        )

    def _call(self, node: tree.Call) -> Part:
        if node.name in self._own:
            return self._own_call(node)
        builtin = self._table.get(node.name)
        if builtin is None:
            raise ScriptFaultError(NO_NAME.format(node.name), node.line, node.column)
        places = [self.expression(e) for e in node.places]
        named = [self.expression(e) for _, e in node.names]
        act = builtin.act
        if builtin.named:
            keys = [name for name, _ in node.names]
            return _combined(
                named,
                lambda frame, *v: act(frame.threads.context, **dict(zip(keys, v, strict=True))),
                node,
            )
        order, defaults = builtin.order(node)
        parts = [
            {"place": places, "name": named}[how][k] if how != "default" else _constant(defaults[k])
            for how, k in order
        ]
        if not builtin.waits:
            return _combined(parts, lambda frame, *v: act(frame.threads.context, *v), node, True)

        def later(frame: Frame) -> Steps:
            arguments: list[Any] = []
            for part in parts:
                arguments.append((yield from part.steps(frame)))
            return (yield from act(frame.threads.context, *arguments))

        return Part(_placed_steps(later, node), True)

    def _own_call(self, node: tree.Call) -> Part:
        parts = [self.expression(e) for e in (*node.places, *(e for _, e in node.names))]
        keys = tuple(name for name, _ in node.names)
        name, waits = node.name, node.name in self._waiting
        if waits or any(part.waits for part in parts):

            def later(frame: Frame) -> Steps:
                arguments: list[Any] = []
                for part in parts:
                    arguments.append((yield from part.steps(frame)))
                closure = frame.closure(name)
                inner = closure.frame(arguments, keys, frame.threads)
                how = yield from closure.body.steps(inner)
                frame.threads.leave()
                return how.value if isinstance(how, Returned) else None

            return Part(_placed_steps(later, node), True)

        def now(frame: Frame, *arguments: Any) -> Any:
            closure = frame.closure(name)
            how = closure.body.act(closure.frame(arguments, keys, frame.threads))
            frame.threads.leave()
            return how.value if isinstance(how, Returned) else None

        return _combined(parts, now, node)

    def _run(self, node: tree.Run) -> Part:
        call = node.call
        if call.name not in self._own:
            raise ScriptFaultError(NO_NAME.format(call.name), call.line, call.column)
        parts = [self.expression(e) for e in (*call.places, *(e for _, e in call.names))]
        keys = tuple(name for name, _ in call.names)

        def run(frame: Frame, *arguments: Any) -> int:
            return frame.threads.run(frame.closure(call.name), arguments, keys)

        return _combined(parts, run, node)

    _statements: Mapping[type, Callable[["Compiler", Any], Part]] = {
        tree.Assign: _assign, tree.Evaluate: _evaluate, tree.If: _if, tree.While: _while,
        tree.Return: _return, tree.Leave: _leave, tree.ThreadEnd: _thread_end,
    }  # fmt: skip
    _expressions: Mapping[type, Callable[["Compiler", Any], Part]] = {
        tree.Literal: _literal, tree.Name: _name, tree.ListOf: _list, tree.Unary: _unary,
        tree.Binary: _binary, tree.Index: _index, tree.Member: _member, tree.Call: _call,
        tree.Run: _run,
    }  # fmt: skip


_UNARY: dict[str, Callable[[Any], Any]] = {
    "not": lambda v: not values.truth(v),
    "-": values.negative,
    "+": lambda v: v,
}


def _plain_block(acts: list[Act]) -> Act:
    def block(frame: Frame) -> Any:
        for act in acts:
            how = act(frame)
            if how is not None:
                return how
        return None

    return block


def _waiting_block(parts: list[tuple[Act, bool]]) -> Act:
    def block(frame: Frame) -> Steps:
        for act, waits in parts:
            how = (yield from act(frame)) if waits else act(frame)
            if how is not None:
                return how
        return None

    return block


def _constant(value: Any) -> Part:
    return Part(lambda frame: values.copied(value))


def _combined(
    parts: list[Part], act: Callable[..., Any], node: tree.Node, silent: bool = False
) -> Part:
    """Values of parts from left to right, and what comes of them; a statement's value is None."""
    if any(part.waits for part in parts):

        def later(frame: Frame) -> Steps:
            found: list[Any] = []
            for part in parts:
                found.append((yield from part.steps(frame)))
            return act(frame, *found)

        return Part(_placed_steps(later, node), True)
    acts = [part.act for part in parts]
    return Part(_placed(lambda frame: act(frame, *[a(frame) for a in acts]), node))


_MISTAKES = (ArithmeticError, LookupError, TypeError, ValueError)


def _placed(act: Act, node: tree.Node) -> Act:
    """Whatever goes wrong has a place."""
    line, column = node.line, node.column

    def placed(frame: Frame) -> Any:
        try:
            return act(frame)
        except ScriptFaultError as error:
            raise error.at(line, column) from None
        except _MISTAKES as error:
            raise ScriptFaultError(f"a value that cannot be: {error}", line, column) from error

    return placed


def _placed_steps(act: Act, node: tree.Node) -> Act:
    line, column = node.line, node.column

    def placed(frame: Frame) -> Steps:
        try:
            return (yield from act(frame))
        except ScriptFaultError as error:
            raise error.at(line, column) from None
        except _MISTAKES as error:
            raise ScriptFaultError(f"a value that cannot be: {error}", line, column) from error

    return placed


def _storing(name: str, scope: str) -> Callable[[Frame, Any], None]:
    if scope == "local":

        def local(frame: Frame, value: Any) -> None:
            frame.names[name] = value

        return local
    if scope == "global":

        def top(frame: Frame, value: Any) -> None:
            frame.threads.top.names[name] = value

        return top

    def nearest(frame: Frame, value: Any) -> None:
        holder: Frame | None = frame
        while holder is not None:
            if name in holder.names:
                holder.names[name] = value
                return
            holder = holder.parent
        frame.names[name] = value

    return nearest


def _place(holder: Any, at: Any) -> int:
    if isinstance(at, bool) or not isinstance(at, int | float) or at != int(at):
        raise ScriptFaultError(f"an index must be a whole number, not {values.shown(at)}")
    if not 0 <= at < len(holder):
        raise ScriptFaultError(f"index {int(at)} of a list of {len(holder)} elements")
    return int(at)


def _get(holder: Any, at: Any) -> Any:
    if isinstance(holder, dict):
        if at in holder:
            return holder[at]
        raise ScriptFaultError(f"the struct has no {values.shown(at)}")
    if isinstance(holder, list):
        return holder[_place(holder, at)]
    raise ScriptFaultError(f"{values.kind(holder)} has no elements")


def _put(holder: Any, at: Any, value: Any) -> None:
    if isinstance(holder, dict) and isinstance(at, str):
        if at not in holder:
            raise ScriptFaultError(f"the struct has no {at}")
        holder[at] = values.copied(value)
    elif isinstance(holder, list):
        holder[_place(holder, at)] = values.copied(value)
    else:
        raise ScriptFaultError(f"{values.kind(holder)} has no elements")
