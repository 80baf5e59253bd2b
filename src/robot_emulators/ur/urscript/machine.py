"""A program from its text to its end: translated, compiled, and run one control cycle at a time.

A thread runs until it waits, so that nothing interrupts it between two waits. How much it may do
before it waits is bounded, as are threads, calls inside calls, and the sizes of values.
"""

from collections.abc import Mapping
from itertools import islice
from typing import Any

from robot_emulators.ur.urscript import values
from robot_emulators.ur.urscript.functions import CONVERTERS, Builtin, Steps
from robot_emulators.ur.urscript.translation import FILE, OPERATORS, Code, translated
from robot_emulators.ur.urscript.values import ProgramEndsError, ScriptFaultError

LONGEST = 1 << 18
"""Most characters of a program."""
MOST_IN_A_CYCLE = 20_000
"""Most loop passes and calls of a program in one control cycle, before it waits."""
_MOST_THREADS = 50
_MISTAKES = (ArithmeticError, LookupError, NameError, TypeError, ValueError)
_HELPERS = {
    "ProgramEndsError": ProgramEndsError, "Pose": values.Pose, "copied": values.copied,
    "get": values.get, "put": values.put, "truth": values.truth,
    "o_negative": lambda value: values.ACTS["-"](0, value),
} | {f"o_{name}": values.ACTS[sign] for sign, name in OPERATORS.items()} | {
    f"as_{kind}": convert for kind, convert in CONVERTERS.items()}  # fmt: skip


def compiled(text: str, table: Mapping[str, Builtin]) -> Code:
    """Compile a URScript program, which may call the functions of ``table``. If the text is one
    function, that is the program; else its statements are. Raises a `ScriptFaultError` for a syntax
    error or a call of an unknown function.
    """
    if len(text) > LONGEST:
        raise ScriptFaultError(f"a program of more than {LONGEST} characters")
    try:
        return translated(text, table)
    except RecursionError:
        raise ScriptFaultError("the program is nested too deeply") from None
    except SyntaxError as error:
        raise ScriptFaultError(
            f"syntax_error_on_line:{error.lineno}:", error.lineno or 1, error.offset or 1
        ) from None


class Machine:
    """Runs one URScript program with its threads, one slice a control cycle each.

    Attributes:
        current: number of the thread that runs now; 0 is the main one.
    """

    def __init__(self, code: Code, context: Any) -> None:
        mine = {"context": context, "spend": self._spend, "run": self._run, "kill": self._kill,
                "join": self._join, "__builtins__": {}}  # fmt: skip
        names: dict[str, Any] = _HELPERS | mine | dict(code.builtins)
        exec(code.code, names)
        self._threads: dict[int, Steps] = {0: names["program"]()}
        self.current = self._count = 0
        self._left = MOST_IN_A_CYCLE

    def cycle(self) -> bool:
        """Run each thread until it waits; return False when the program has ended. Raises a
        `ScriptFaultError` if it cannot go on, a `ProgramEndsError` if it calls ``halt``.
        """
        self._left = MOST_IN_A_CYCLE
        done: set[int] = set()
        while 0 in self._threads:
            waiting = [number for number in self._threads if number not in done]
            if not waiting:
                return True
            for number in waiting:
                done.add(number)
                if number in self._threads:
                    self._slice(number)
        return False

    def _slice(self, number: int) -> None:
        self.current = number
        try:
            next(self._threads[number])
        except StopIteration:
            self._threads.pop(number, None)
        except ProgramEndsError:
            raise
        except ScriptFaultError as error:
            raise error.at(*_place(error)) from None
        except RecursionError as error:
            raise ScriptFaultError("too many calls inside one another", *_place(error)) from None
        except _MISTAKES as error:
            raise ScriptFaultError(_in_words(error), *_place(error)) from error

    def _spend(self) -> None:
        """Count a loop pass or call; too many of them before the next wait raise an error."""
        self._left -= 1
        if self._left < 0:
            raise ScriptFaultError("infinite loop: the thread takes no time, it lacks a sync()")

    def _run(self, steps: Steps) -> int:
        if len(self._threads) >= _MOST_THREADS:
            raise ScriptFaultError(f"more than {_MOST_THREADS} threads")
        self._count += 1
        self._threads[self._count] = steps
        return self._count

    def _kill(self, number: Any) -> None:
        """End the program's thread of this number, if it exists."""
        if isinstance(number, int) and number != self.current and number in self._threads:
            self._threads.pop(number).close()

    def _join(self, number: Any) -> Steps:
        while isinstance(number, int) and number != self.current and number in self._threads:
            yield


def _place(error: BaseException) -> tuple[int, int]:
    """Line and column, from 1, of the program text where an error arose; (0, 0) if unknown."""
    place, trace = (0, 0), error.__traceback__
    while trace is not None:
        code = trace.tb_frame.f_code
        if code.co_filename == FILE:
            at = next(islice(code.co_positions(), trace.tb_lasti // 2, None), (0, 0, 0, 0))
            place = (at[0] or 0, (at[2] or 0) + 1)
        trace = trace.tb_next
    return place


def _in_words(error: Exception) -> str:
    """Text of a Python error in a program, in the words of a UR controller."""
    if isinstance(error, NameError):  # the name as it stands in Python is quoted
        return values.NO_NAME.format(str(error).split("'")[1][2:])
    text = str(error)
    for prefix in ("f_", "v_"):
        text = text.replace(f"'{prefix}", "'").removeprefix(prefix)
    return f"a value that cannot be: {text}"
