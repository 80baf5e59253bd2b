"""URScript that arrives at the ports: where a program ends, and what ends it."""

import re

_LONGEST = 1 << 22
"""Bytes of a program that is not complete, from which the connection is closed."""
_OPENS = re.compile(r"(?:def|sec|thread|if|while|for)\b")
_END = re.compile(r"end\b(?!\s*[=(])")


class ProgramError(Exception):
    """A runtime error of the script, which ends it.

    Attributes:
        line, column: of its text, from 1; 0 where nobody knows.
    """

    def __init__(self, text: str, line: int = 0, column: int = 0) -> None:
        super().__init__(text)
        self.line, self.column = line, column


def is_secondary(text: str) -> bool:
    """Whether a program runs beside the one that plays and changes nothing of it."""
    return text.lstrip().startswith("sec ")


class Collector:
    """Puts programs together from the bytes of one connection."""

    def __init__(self) -> None:
        self._line = b""
        self._lines: list[str] = []
        self._size = 0
        self._depth = 0

    @property
    def held(self) -> int:
        """Bytes of a program that is not complete."""
        return self._size + len(self._line)

    def feed(self, data: bytes) -> list[str] | None:
        """Programs that are complete now; None where one grows beyond all measure."""
        *lines, self._line = (self._line + data).split(b"\n")
        taken = [self._take(raw.decode("latin-1")) for raw in lines]
        programs = [text for text in taken if text is not None]
        return None if self.held > _LONGEST else programs

    def _take(self, line: str) -> str | None:
        bare = line.strip()
        bare = "" if bare.startswith("#") else bare
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
