"""Output on any terminal: of few columns, and of encodings that lack some characters."""

import codecs
import io
import os
import shutil
import sys

LEAST_COLUMNS = 40
"""The narrowest output; below, tyro's layout of help does not end (tyro 1.0)."""
_HANDLER = "wrenchbed.plain"
_PLAIN = {
    "…": "...", "→": "->", "←": "<-", "−": "-", "–": "-", "—": "-", "±": "+-", "·": ".", "•": "*",
    "≤": "<=", "≥": ">=", "×": "x", "°": " deg", "‘": "'", "’": "'", "“": '"', "”": '"', "²": "^2",
    "³": "^3", "µ": "u", "μ": "u", "━": "-", "─": "-", "│": "|", "✓": "+",
}  # fmt: skip
"""What stands for a character that an encoding lacks; for others a question mark."""


def prepare() -> None:
    """Let standard output and error write everything, on at least `LEAST_COLUMNS` columns."""
    codecs.register_error(_HANDLER, _replaced)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=_HANDLER)
    if shutil.get_terminal_size().columns < LEAST_COLUMNS:
        os.environ["COLUMNS"] = str(LEAST_COLUMNS)


def lacks(text: str) -> bool:
    """Whether standard output lacks characters of a text."""
    try:
        text.encode(getattr(sys.stdout, "encoding", None) or "ascii")
    except UnicodeEncodeError:
        return True
    return False


def _replaced(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    lacking = error.object[error.start : error.end]
    return "".join(_PLAIN.get(c, "?") for c in lacking), error.end
