"""A program from its text to its end: parsed, compiled, and run one control cycle at a time."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from robot_emulators.ur.urscript.compiler import Compiler
from robot_emulators.ur.urscript.faults import ScriptFaultError
from robot_emulators.ur.urscript.functions import Builtin
from robot_emulators.ur.urscript.parser import parse
from robot_emulators.ur.urscript.syntax import Function
from robot_emulators.ur.urscript.threads import Body, Threads

LONGEST = 1 << 18
"""Characters of a program."""
UNNAMED = "unnamed"


@dataclass(frozen=True, eq=False)
class Code:
    """A compiled program.

    Attributes:
        name: of the program.
        secondary: it runs beside the program that plays.
        body: what it does.
    """

    name: str
    secondary: bool
    body: Body


def compiled(text: str, table: Mapping[str, Builtin]) -> Code:
    """Compile a program.

    A text of a single function is that function's program; other statements are run as they come.

    Args:
        text: of the program.
        table: functions that it may call.

    Raises:
        ScriptFaultError: the text is no program, or calls what nobody knows.
    """
    if len(text) > LONGEST:
        raise ScriptFaultError(f"a program of more than {LONGEST} characters")
    try:
        block = parse(text)
        whole = block[0] if len(block) == 1 and isinstance(block[0], Function) else None
        body = Compiler(block if whole is None else whole.body, table).program
    except RecursionError:
        raise ScriptFaultError("the program is nested too deeply") from None
    if whole is None:
        return Code(UNNAMED, False, body)
    return Code(whole.name, whole.kind == "sec", body)


class Machine:
    """One program that runs.

    Args:
        code: of the program.
        context: passed first to the functions that it calls.
    """

    def __init__(self, code: Code, context: Any) -> None:
        self.threads = Threads(code.body, context)

    def cycle(self) -> bool:
        """Run until every thread waits; False at the end.

        Raises:
            ScriptFaultError: the program cannot go on.
            ProgramEndsError: it ends itself.
        """
        return self.threads.cycle()
