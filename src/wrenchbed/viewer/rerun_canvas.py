"""The canvas on which a view is drawn, the layouts of views on the screen (rerun's blueprints), and
the ``.rrd`` file that results."""

import uuid
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr

from wrenchbed import registry
from wrenchbed.errors import printable
from wrenchbed.files import write_bytes
from wrenchbed.physics.wrench import CHANNELS, UNITS
from wrenchbed.robots.base import SimulatedRobot

APP = "wrenchbed"
TIME, ROW = "time", "row"
"""Timelines: of a motion [s]; of poses at rest (row numbers), between which nothing is recorded."""
_NEAR = 0.55
"""Distance of the eye that shows all of a robot, over the diagonal of the box in which it moves."""
_SKY = (242, 244, 247)
"""Background behind the robot [RGB]; curves keep the viewer's own background."""
Window = tuple[str, np.ndarray]
"""A timeline's name, and where on it data lie (N,) [s or rows]."""


class Canvas:
    """Writes objects to a rerun stream (3D viewer): for all times, or as columns over ``axis``."""

    def __init__(self, stream: Any, axis: str = TIME) -> None:
        self.stream, self.axis = stream, axis

    def once(self, path: str, shown: Any) -> None:
        """Add an object of rerun that holds at all times."""
        self.stream.log(path, shown, static=True)

    def columns(self, path: str, at: np.ndarray, data: Any) -> None:
        """Add rerun columns of N values at times [s] or rows ``at`` (N,) of the axis."""
        row = self.axis == ROW
        when = {"sequence": at.astype(np.int64)} if row else {"duration": at}
        self.stream.send_columns(path, [rr.TimeColumn(self.axis, **when)], data)


@contextmanager
def to_file(path: str | Path, blueprint: Any, axis: str = TIME) -> Iterator[Canvas]:
    """Yield a canvas over timeline ``axis``, then write its picture, laid out by ``blueprint``, to
    ``path``."""
    stream = rr.RecordingStream(APP, recording_id=uuid.uuid4())
    written = stream.binary_stream()  # rerun itself reports no disk that is full
    try:
        stream.send_blueprint(blueprint, make_active=False, make_default=True)
        yield Canvas(stream, axis)
        data = written.read()
    finally:
        stream.disconnect()
    write_bytes(path, data or b"")


def log_words(canvas: Canvas, path: str, text: str) -> None:
    """Add a Markdown text that holds at all times."""
    canvas.once(path, rr.TextDocument(printable(text), media_type=rr.MediaType.MARKDOWN))


def scene(robot: str, name: str = "robot", places: np.ndarray | None = None) -> Any:
    """Make a 3D view called ``name`` of a robot (its registry name) from a good side, around
    ``places`` (N, 3) [m] if given."""
    shown = registry.load("robots", robot)
    assert isinstance(shown, SimulatedRobot)  # only such have a scene
    (position, target), up = np.array(shown.eye), (0.0, 0.0, 1.0)
    if places is not None:
        ends, back = np.stack([places.min(axis=0), places.max(axis=0)]), position - target
        target, reach = ends.mean(axis=0), _NEAR * np.linalg.norm(np.ptp(ends, axis=0))
        position = target + reach / np.linalg.norm(back) * back
    eye = rr.blueprint.EyeControls3D(position=position, look_target=target, eye_up=up)
    return rr.blueprint.Spatial3DView(
        origin="/world", name=name, background=list(_SKY), line_grid=False, eye_controls=eye
    )


def channels(name: str, window: Window, *, residual: bool = False) -> Any:
    """Make a view called ``name`` of six wrench channels, zoomed to ``window`` (timeline, times [s]
    or rows (N,)), each above its residual if ``residual``."""
    views = []
    for k, (c, u) in enumerate(zip(CHANNELS, UNITS, strict=True)):
        view = curves(f"/wrench/{c}", f"{c} [{u}]", window, legend=k == 0)
        if residual:
            title = f"{c} measured − simulated [{u}]"
            below = curves(f"/residual/{c}", title, window, legend=False)
            view = rr.blueprint.Vertical(view, below, row_shares=[1.6, 1.0])
        views.append(view)
    return rr.blueprint.Grid(*views, grid_columns=2, name=name)


def curves(origin: str, name: str, window: Window, *, legend: bool = True) -> Any:
    """View of an entity's curves, first zoomed to ``window``: (timeline, times [s] or rows
    (N,))."""
    b = rr.blueprint
    timeline, at = window
    unit = "seq" if timeline == ROW else "seconds"
    low, high = (float(at[k]) for k in (0, -1))
    ends = (int(x) if timeline == ROW else x for x in (low, max(high, low + 1e-3)))
    start, end = (rr.TimeRangeBoundary.absolute(**{unit: x}) for x in ends)
    whole = rr.TimeRange(start=start, end=end)
    axis = b.TimeAxis(link=b.components.LinkAxis.Independent, view_range=whole)
    shown = b.PlotLegend(corner=b.Corner2D.RightTop, visible=legend)
    return b.TimeSeriesView(origin=origin, name=name, axis_x=axis, plot_legend=shown)


def document(origin: str, name: str) -> Any:
    """Make a view called ``name`` that shows the Markdown text at the entity ``origin``."""
    return rr.blueprint.TextDocumentView(origin=origin, name=name)


def blamed(robot: str, at: np.ndarray, places: np.ndarray) -> Any:
    """Make views of the robot around ``places`` (N, 3) [m], of its colour bar (probability that a
    part is the cause) and of residuals over rows ``at`` (K,)."""
    title = "probability that the cause is there: 0 (grey) … 1 (dark red)"
    bar = rr.blueprint.Spatial2DView(origin="/blame", name=title)
    residual = curves("/residual", "residual of all channels, rms [noise of a row]", (ROW, at))
    rows = (scene(robot, "robot, coloured by blame", places), bar, residual)
    return rr.blueprint.Vertical(*rows, row_shares=[1.0, 0.12, 0.3])


def page(left: Any | None, right: Sequence[Any], timeline: str | None = TIME) -> Any:
    """Make the layout of a picture: one view on the left, if any, and tabs on the right.

    If ``timeline`` is None, nothing changes over time and there is no slider.
    """
    b = rr.blueprint
    time = b.TimePanel(state="hidden")
    if timeline is not None:
        time = b.TimePanel(state="collapsed", timeline=timeline, play_state="paused")
    tabs, left_share = b.Tabs(*right, active_tab=0), 2.0 if len(right) == 1 else 1.0
    return b.Blueprint(
        tabs if left is None else b.Horizontal(left, tabs, column_shares=[left_share, 1.2]),
        time,
        b.BlueprintPanel(state="collapsed"),
        b.SelectionPanel(state="collapsed"),
    )
