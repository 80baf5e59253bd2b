"""A canvas: what a view is drawn on, and the file of rerun that it becomes; Markdown for it."""

import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr

from wrenchbed.files import write_bytes

APP = "wrenchbed"
TIME, ROW = "time", "row"
"""Timelines: of a motion [s], and of poses at rest, between which nothing is recorded."""
_RANGES = ((0x20, 0x7E), (0xA0, 0x17F), (0x391, 0x3C9), (0x410, 0x44F))
"""Latin, Greek and Cyrillic letters of its font, Inter."""
_SIGNS = frozenset("–—‘’“”„…•→←↑↓−×÷±≈≠≤≥√∞∆∑·\n")


class Canvas:
    """Where things are drawn: once, at a step, or as columns over one timeline.

    Args:
        stream: of rerun.
        axis: timeline of `columns`.
    """

    def __init__(self, stream: Any, axis: str = TIME) -> None:
        self.stream, self.axis = stream, axis

    def once(self, path: str, shown: Any) -> None:
        """Draw for all times."""
        self.stream.log(path, shown, static=True)

    def columns(self, path: str, at: np.ndarray, data: Any) -> None:
        """Draw data over the axis at (N,) [s or rows]."""
        row = self.axis == ROW
        when = {"sequence": at.astype(np.int64)} if row else {"duration": at}
        self.stream.send_columns(path, [rr.TimeColumn(self.axis, **when)], data)


@contextmanager
def to_file(path: str | Path, blueprint: Any, axis: str = TIME) -> Iterator[Canvas]:
    """A canvas whose file stands at ``path`` once the block has ended well.

    Raises:
        MissingExtraError: rerun is not installed.
    """
    stream = rr.RecordingStream(APP, recording_id=uuid.uuid4())
    written = stream.binary_stream()  # rerun itself reports no disk that is full
    try:
        stream.send_blueprint(blueprint, make_active=False, make_default=True)
        yield Canvas(stream, axis)
        data = written.read()
    finally:
        stream.disconnect()
    write_bytes(path, data or b"")


def readable(text: str) -> str:
    """The text with a question mark for every character that the viewer may lack."""
    return "".join(c if c in _SIGNS or _known(ord(c)) else "?" for c in text)


def log_words(canvas: Canvas, path: str, text: str) -> None:
    """Log Markdown for all times."""
    document = rr.TextDocument(readable(text), media_type=rr.MediaType.MARKDOWN)
    canvas.once(path, document)


def bar(share: float) -> str:
    """A share (0 … 1) as a row of dots."""
    return "•" * round(20 * share)


def _known(code: int) -> bool:
    return any(low <= code <= high for low, high in _RANGES)
