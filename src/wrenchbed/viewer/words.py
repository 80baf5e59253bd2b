"""Words that rerun's viewer can draw: it ends at a character that its one font lacks."""

from wrenchbed import registry
from wrenchbed.viewer.stream import Canvas

_RANGES = ((0x20, 0x7E), (0xA0, 0x17F), (0x391, 0x3C9), (0x410, 0x44F))
"""Latin, Greek and Cyrillic letters of its font, Inter."""
_SIGNS = frozenset("–—‘’“”„…•→←↑↓−×÷±≈≠≤≥√∞∆∑·\n")


def readable(text: str) -> str:
    """The text with a question mark for every character that the viewer may lack."""
    return "".join(c if c in _SIGNS or _known(ord(c)) else "?" for c in text)


def log_words(canvas: Canvas, path: str, text: str) -> None:
    """Log Markdown for all times."""
    rr = registry.require("rerun", "view")
    document = rr.TextDocument(readable(text), media_type=rr.MediaType.MARKDOWN)
    canvas.once(path, document)


def bar(share: float) -> str:
    """A share (0 … 1) as a row of dots."""
    return "•" * round(20 * share)


def _known(code: int) -> bool:
    return any(low <= code <= high for low, high in _RANGES)
