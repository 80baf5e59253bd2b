"""A program under way: its frames of variables, and its threads, one slice a control cycle each.

A thread runs until it waits, so that nothing interrupts it between two waits. How much it may do
before it waits is bounded, as are threads, calls inside calls, and what values may become.
"""

from collections.abc import Sequence
from typing import Any, Protocol

from robot_emulators.ur.urscript.faults import NO_NAME, ScriptFaultError
from robot_emulators.ur.urscript.functions import Steps

MOST_IN_A_CYCLE = 20_000
"""Loops and calls that a program may take in one control cycle before it waits."""
_MOST_THREADS, _DEEPEST = 50, 40


class Body(Protocol):
    """A compiled block."""

    @property
    def act(self) -> Any:
        """Runs it at once, where it does not wait."""
        ...

    def steps(self, frame: "Frame") -> Steps:
        """Runs it one control cycle at a time."""
        ...


class Frame:
    """Variables of one call, inside those of the function around its definition."""

    __slots__ = ("functions", "names", "parent", "threads")

    def __init__(self, names: dict[str, Any], parent: "Frame | None", threads: "Threads") -> None:
        self.names, self.parent, self.threads = names, parent, threads
        self.functions: dict[str, Closure] = {}

    def closure(self, name: str) -> "Closure":
        """A function by name, from the nearest frame that defines it.

        Raises:
            ScriptFaultError: none of them does.
        """
        holder: Frame | None = self
        while holder is not None:
            if name in holder.functions:
                return holder.functions[name]
            holder = holder.parent
        raise ScriptFaultError(NO_NAME.format(name))


class Closure:
    """A function of the program, with the frame in which it was defined."""

    def __init__(
        self, name: str, names: list[str], defaults: list[Any], body: Body, frame: Frame
    ) -> None:
        self.name, self.names, self.body = name, names, body
        self._defaults, self._frame = defaults, frame

    def frame(self, arguments: Sequence[Any], keys: tuple[str, ...], threads: "Threads") -> Frame:
        """Variables of a call; the last arguments are named by keys.

        Raises:
            ScriptFaultError: arguments do not fit, or calls are too deep.
        """
        threads.enter()
        places = len(arguments) - len(keys)
        if places > len(self.names):
            raise ScriptFaultError(f"{self.name} takes {len(self.names)} arguments at most")
        given = dict(zip(self.names, arguments[:places], strict=False))
        for key, value in zip(keys, arguments[places:], strict=True):
            if key in given or key not in self.names:
                raise ScriptFaultError(f"{self.name} cannot take an argument {key}")
            given[key] = value
        for name, default in zip(self.names, self._defaults, strict=True):
            if name not in given:
                if default is None:
                    raise ScriptFaultError(f"{self.name} needs an argument {name}")
                given[name] = default.act(self._frame)
        return Frame(given, self._frame, threads)


class _Thread:
    def __init__(self, number: int, steps: Steps) -> None:
        self.number, self.steps, self.depth = number, steps, 0


class Threads:
    """All threads of a program.

    Args:
        body: the program.
        context: what its functions act on.

    Attributes:
        top: the frame of global variables.
        current: number of the thread that runs now.
    """

    def __init__(self, body: Body, context: Any) -> None:
        self.context = context
        self.top = Frame({}, None, self)
        main = _Thread(0, body.steps(self.top))
        self._threads, self._count = {0: main}, 0
        self._running, self._left = main, MOST_IN_A_CYCLE

    @property
    def current(self) -> int:
        """Number of the thread that runs now."""
        return self._running.number

    def alive(self, number: Any) -> bool:
        """Whether a thread has not ended."""
        return number in self._threads

    def cycle(self) -> bool:
        """Give each thread its slice; False at the program's end.

        Raises:
            ScriptFaultError: the program cannot go on.
            ProgramEndsError: it ends itself.
        """
        self._left = MOST_IN_A_CYCLE
        done: set[int] = set()
        while 0 in self._threads:
            waiting = [t for n, t in self._threads.items() if n not in done]
            if not waiting:
                return True
            for thread in waiting:
                done.add(thread.number)
                if thread.number in self._threads:
                    self._slice(thread)
        return False

    def _slice(self, thread: _Thread) -> None:
        self._running = thread
        try:
            next(thread.steps)
        except StopIteration:
            self._threads.pop(thread.number, None)
        except RecursionError:
            raise ScriptFaultError("the program is nested too deeply") from None

    def run(self, closure: Closure, arguments: Sequence[Any], keys: tuple[str, ...]) -> int:
        """Begin a thread; its number.

        Raises:
            ScriptFaultError: there are too many, or arguments do not fit.
        """
        if len(self._threads) >= _MOST_THREADS:
            raise ScriptFaultError(f"more than {_MOST_THREADS} threads")
        frame = closure.frame(arguments, keys, self)
        self.leave()
        self._count += 1
        self._threads[self._count] = _Thread(self._count, closure.body.steps(frame))
        return self._count

    def kill(self, number: Any) -> None:
        """End a thread, if there is one of this number."""
        thread = self._threads.get(number) if isinstance(number, int) else None
        if thread is None or thread is self._running:
            return
        del self._threads[thread.number]
        thread.steps.close()

    def join(self, number: Any) -> Steps:
        """Wait for a thread's end."""
        while isinstance(number, int) and number != self.current and number in self._threads:
            yield

    def spend(self) -> None:
        """Count a loop or a call.

        Raises:
            ScriptFaultError: the program takes too many without waiting.
        """
        self._left -= 1
        if self._left < 0:
            raise ScriptFaultError("infinite loop: the thread takes no time, it lacks a sync()")

    def enter(self) -> None:
        """Count a call.

        Raises:
            ScriptFaultError: too many, inside one another or in this cycle.
        """
        self.spend()
        self._running.depth += 1
        if self._running.depth > _DEEPEST:
            raise ScriptFaultError("too many calls inside one another")

    def leave(self) -> None:
        """A call is over."""
        self._running.depth -= 1
