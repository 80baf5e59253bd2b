"""Pictures of a campaign: drawn live on real robots and twins, afterwards in simulation."""

import contextlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import wrenchbed as wb
from wrenchbed.cli import console
from wrenchbed.drivers.base import Driver
from wrenchbed.drivers.base.live import LiveDriver
from wrenchbed.errors import ParameterError
from wrenchbed.robots.base import SimulatedRobot


@contextmanager
def watched(link: Driver, out: Path, rrd: Path | None, view: str | None) -> Iterator[None]:
    """While the block runs a live driver's readings are drawn; else the recording, at its end.

    Args:
        out: recording that the block writes.
        rrd: picture to write, if any.
        view: ``window`` or ``browser`` to watch in, if any.
    """
    if not isinstance(link, LiveDriver):
        if view is not None:
            raise ParameterError(
                "--view is for live drivers; look at the recording: wrenchbed view"
            )
        yield
        if rrd is not None:
            from wrenchbed.viewer import recording_view

            recording_view(wb.Recording.read(out), rrd)
        return
    if rrd is None and view is None:
        yield
        return
    from wrenchbed.viewer.live import LiveView

    if not isinstance(link.robot, SimulatedRobot):
        raise ParameterError(f"robot {link.robot.name!r} has no model that could be shown")
    with _viewer(view) as url, LiveView(link.robot, rrd, url) as picture:
        link.onlooker = picture
        try:
            yield
        finally:
            link.onlooker = None
    if picture.dropped:
        text = f"the picture missed {picture.dropped} rows; the recording has them"
        console.OUT.print(text, soft_wrap=True, markup=False, highlight=False)


@contextmanager
def _viewer(view: str | None) -> Iterator[str | None]:
    """A viewer to draw in, open until it is closed by who looks."""
    if view is None:
        yield None
        return
    from wrenchbed.viewer import show

    with show.viewer(None, web=view == "browser") as viewer:
        if view == "browser":
            text = f"open {show.address(port=show.PORT)}"
            console.OUT.print(text, soft_wrap=True, markup=False, highlight=False)
        try:
            yield show.PROXY
        finally:
            if view == "window":
                console.OUT.print("close the window to go on")
                with contextlib.suppress(KeyboardInterrupt):
                    show.until_closed(viewer)
