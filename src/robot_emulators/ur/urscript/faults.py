"""What is wrong with a program, and where."""

NO_NAME = "compile_error_name_not_found:{}:"
"""How a controller reports a name that it does not know."""


class ScriptFaultError(Exception):
    """A program cannot go on.

    Attributes:
        text: what is wrong.
        line, column: where, from 1; 0 where nobody knows.
    """

    def __init__(self, text: str, line: int = 0, column: int = 0) -> None:
        super().__init__(text)
        self.text, self.line, self.column = text, line, column

    def at(self, line: int, column: int) -> "ScriptFaultError":
        """The same with a place, unless it has one."""
        return self if self.line else ScriptFaultError(self.text, line, column)


class ProgramEndsError(Exception):
    """The program ends here as its author wants: ``halt``."""
