"""Where a view goes: a file, written whole or not at all."""

import uuid
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from wrenchbed import registry

APP = "wrenchbed"
TIME, ROW = "time", "row"
"""Timelines: of a motion [s], and of poses at rest, between which nothing is recorded."""


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

    def step(self, timeline: str, k: int, shown: Mapping[str, Any]) -> None:
        """Draw things by their paths at a step of a timeline."""
        self.stream.set_time(timeline, sequence=k)
        for path, thing in shown.items():
            self.stream.log(path, thing)

    def columns(self, path: str, at: np.ndarray, data: Any) -> None:
        """Draw data over the axis at (N,) [s or rows]."""
        rr = registry.require("rerun", "view")
        row = self.axis == ROW
        when = {"sequence": at.astype(np.int64)} if row else {"duration": at}
        self.stream.send_columns(path, [rr.TimeColumn(self.axis, **when)], data)


@contextmanager
def to_file(path: str | Path, blueprint: Any, axis: str = TIME) -> Iterator[Canvas]:
    """A canvas whose file stands at ``path`` once the block has ended well.

    Raises:
        MissingExtraError: rerun is not installed.
    """
    rr = registry.require("rerun", "view")
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    half = path.with_name(path.name + ".part")
    stream = rr.RecordingStream(APP, recording_id=uuid.uuid4())
    stream.save(half, default_blueprint=blueprint)
    try:
        yield Canvas(stream, axis)
    except BaseException:
        stream.disconnect()
        half.unlink(missing_ok=True)
        raise
    stream.flush()
    stream.disconnect()
    half.replace(path)
