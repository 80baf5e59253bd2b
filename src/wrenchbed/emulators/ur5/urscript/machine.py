"""A program from its text to its end: parsed, compiled, and run one control cycle at a time."""

from collections.abc import Mapping
from typing import Any

from wrenchbed.emulators.ur5.urscript.compiler import Compiler
from wrenchbed.emulators.ur5.urscript.faults import ScriptFaultError
from wrenchbed.emulators.ur5.urscript.functions import Builtin
from wrenchbed.emulators.ur5.urscript.parser import parse
from wrenchbed.emulators.ur5.urscript.syntax import Function
from wrenchbed.emulators.ur5.urscript.threads import Threads

LONGEST = 1 << 18
"""Characters of a program."""
UNNAMED = "unnamed"


class Machine:
    """One program.

    A text of a single function is that function's program; other statements are run as they come.

    Args:
        text: of the program.
        table: functions that it may call.
        context: passed to them first.

    Attributes:
        name: of the program.
        secondary: it runs beside the program that plays.

    Raises:
        ScriptFaultError: the text is no program, or calls what nobody knows.
    """

    def __init__(self, text: str, table: Mapping[str, Builtin], context: Any) -> None:
        if len(text) > LONGEST:
            raise ScriptFaultError(f"a program of more than {LONGEST} characters")
        try:
            block = parse(text)
            whole = block[0] if len(block) == 1 and isinstance(block[0], Function) else None
            self.name = UNNAMED if whole is None else whole.name
            self.secondary = whole is not None and whole.kind == "sec"
            body = Compiler(block if whole is None else whole.body, table).program
        except RecursionError:
            raise ScriptFaultError("the program is nested too deeply") from None
        self.threads = Threads(body, context)

    def cycle(self) -> bool:
        """Run until every thread waits; False at the end.

        Raises:
            ScriptFaultError: the program cannot go on.
            ProgramEndsError: it ends itself.
        """
        return self.threads.cycle()
