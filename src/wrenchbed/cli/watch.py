"""Pictures of a recording run: live on real robots and emulators, afterwards in simulation."""

import contextlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import wrenchbed as wb
from wrenchbed.cli import console
from wrenchbed.errors import ParameterError
from wrenchbed.hardware.drivers.base import Driver
from wrenchbed.hardware.drivers.base.live import LiveDriver
from wrenchbed.robots.base import SimulatedRobot


@contextmanager
def watched(link: Driver, out: Path, rrd: Path | None, view: str | None) -> Iterator[None]:
    """Draw a live driver's readings while the block runs; otherwise the recording at its end.

    Args:
        link: driver that the block records with.
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
        console.say(f"the picture missed {picture.dropped} rows; the recording has them")


@contextmanager
def _viewer(view: str | None) -> Iterator[str | None]:
    """Address of a viewer, which stays open until its user closes it."""
    if view is None:
        yield None
        return
    from wrenchbed.viewer import show

    with show.viewer(None, web=view == "browser") as viewer:
        if view == "browser":
            console.say(f"open {show.address(port=show.PORT)}")
        try:
            yield show.PROXY
        finally:
            if view == "window":
                console.say("close the window to go on")
                with contextlib.suppress(KeyboardInterrupt):
                    show.until_closed(viewer)
