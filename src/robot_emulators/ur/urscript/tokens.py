"""Text to tokens. Line ends count, except inside brackets; a comment runs to the line's end."""

import re
from dataclasses import dataclass

from robot_emulators.ur.urscript.values import ScriptFaultError

KEYWORDS = frozenset(
    """def sec thread end if elif else while break continue return global local and or xor not
    True False run kill join halt pass enter_critical exit_critical""".split()
)
NAME, NUMBER, TEXT, MARK, POSE, LINE, END = "name number text mark pose line finish".split()
"""Kinds of tokens; the kind of a keyword is the keyword."""

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


@dataclass(frozen=True, slots=True)
class Token:
    """One token with its place, from 1."""

    kind: str
    text: str
    line: int
    column: int


def tokens(text: str) -> list[Token]:
    """All tokens of a program, with an end.

    Raises:
        ScriptFaultError: a character that begins none.
    """
    found: list[Token] = []
    line, start, at, depth = 1, 0, 0, 0
    while at < len(text):
        match = _PATTERN.match(text, at)
        if match is None:
            raise ScriptFaultError(f"syntax_error_on_line:{line}:", line, at - start + 1)
        kind, word = str(match.lastgroup), match.group()
        if kind == LINE:
            if not depth and found and found[-1].kind != LINE:
                found.append(Token(LINE, word, line, at - start + 1))
            line, start = line + 1, match.end()
        elif kind != "blank":
            depth += (word in _OPEN or kind == POSE) - (word in _CLOSE)
            depth = max(depth, 0)
            kind = word if kind == NAME and word in KEYWORDS else kind
            found.append(Token(kind, word, line, at - start + 1))
        at = match.end()
    found.append(Token(LINE, "", line, at - start + 1))
    found.append(Token(END, "", line, at - start + 1))
    return found
