"""Splits URScript text into tokens, and finds the ends of programs in bytes received at a port.

Line ends are tokens, except inside brackets; a comment runs to the line's end.
"""

import re
from dataclasses import dataclass

from robot_emulators.ur.urscript.values import ScriptFaultError

KEYWORDS = frozenset(
    """def sec thread end if elif else while break continue return global local and or xor not
    True False run kill join halt pass enter_critical exit_critical""".split()
)
NAME, NUMBER, TEXT, MARK, POSE, LINE, END = "name number text mark pose line finish".split()
"""Kinds of tokens; a keyword is its own kind."""

_PATTERN = re.compile(
    r"(?P<blank>[ \t\r\f\v]+|#[^\n]*)"
    r"|(?P<line>\n)"
    r"|(?P<pose>p\[)"
    r"|(?P<name>[A-Za-z_]\w*)"
    r"|(?P<number>0[xX][0-9a-fA-F]+|(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
    r'|(?P<text>"[^"\n]*"|\'[^\'\n]*\')'
    r"|(?P<mark>==|!=|<=|>=|<>|[-+*/%^<>=()\[\],:.;@])",
    re.ASCII,
)
_OPEN, _CLOSE = frozenset(("(", "[")), frozenset((")", "]"))
_LONGEST = 1 << 22
"""Most bytes of an incomplete program; beyond, its connection is closed."""
_OPENS = re.compile(r"(?:def|sec|thread|if|while|for)\b")
_END = re.compile(r"end\b(?!\s*[=(])")


@dataclass(frozen=True, slots=True)
class Token:
    """A token of a URScript text: kind (a keyword, or `NAME` … `END`), line and column from 1."""

    kind: str
    text: str
    line: int
    column: int


def tokens(text: str) -> list[Token]:
    """Split a program's text into tokens, the last of which marks the end; raise `ScriptFaultError`
    if none begins with the next character.
    """
    read: list[Token] = []
    line, start, at, depth = 1, 0, 0, 0
    while at < len(text):
        match = _PATTERN.match(text, at)
        if match is None:
            raise ScriptFaultError(f"syntax_error_on_line:{line}:", line, at - start + 1)
        kind, word = str(match.lastgroup), match.group()
        if kind == LINE:
            if not depth and read and read[-1].kind != LINE:
                read.append(Token(LINE, word, line, at - start + 1))
            line, start = line + 1, match.end()
        elif kind != "blank":
            depth += (word in _OPEN or kind == POSE) - (word in _CLOSE)
            depth = max(depth, 0)
            kind = word if kind == NAME and word in KEYWORDS else kind
            read.append(Token(kind, word, line, at - start + 1))
        at = match.end()
    read.append(Token(LINE, "", line, at - start + 1))
    read.append(Token(END, "", line, at - start + 1))
    return read


def is_secondary(text: str) -> bool:
    """Whether a text is a secondary program (``sec``), which runs beside the main program."""
    return text.lstrip().startswith("sec ")


class Collector:
    """Assembles program texts from one connection's bytes; a line ``run program`` is dropped."""

    def __init__(self) -> None:
        self._line = b""
        self._lines: list[str] = []
        self._size = 0
        self._depth = 0

    @property
    def held(self) -> int:
        """Number of bytes of a program that is still incomplete."""
        return self._size + len(self._line)

    def feed(self, data: bytes) -> list[str] | None:
        """Add received bytes; return programs now complete, None if one exceeds the size limit."""
        *lines, self._line = (self._line + data).split(b"\n")
        taken = [self._take(raw.decode("latin-1")) for raw in lines]
        programs = [text for text in taken if text is not None]
        return None if self.held > _LONGEST else programs

    def _take(self, line: str) -> str | None:
        bare = line.strip()
        bare = "" if bare.startswith("#") or bare == "run program" else bare
        if not bare and not self._lines:
            return None
        self._lines.append(line)
        self._size += len(line) + 1
        if _OPENS.match(bare):
            self._depth += 1
        elif _END.match(bare):
            self._depth = max(0, self._depth - 1)
        if self._depth:
            return None
        text = "\n".join(self._lines) + "\n"
        self._lines, self._size = [], 0
        return text
