"""Look at a recording, a plan or a diagnosis in rerun."""

import contextlib
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from wrenchbed.data.plan import Plan, is_plan
from wrenchbed.data.recording import Recording
from wrenchbed.errors import ParameterError
from wrenchbed.viewer import show
from wrenchbed.viewer.plans import plan_view
from wrenchbed.viewer.recordings import recording_view

PICTURE = "diagnosis.rrd"
"""Picture in the folder of a diagnosis."""


def view(
    file: str | Path,
    against: Sequence[str | Path] = (),
    *,
    rrd: str | Path | None = None,
    web: bool = False,
    port: int = show.PORT,
    web_port: int = show.WEB_PORT,
    opened: Callable[[str], None] = lambda _: None,
) -> None:
    """Show a picture until its window is closed, or write it to a file.

    Args:
        file: recording or plan in Parquet, folder of a diagnosis, or an ``.rrd`` file.
        against: fit.json and twin.json files whose simulators are compared with the recording.
        rrd: file to write; then nothing is opened.
        web: serve a browser on this machine instead of opening rerun's own window.
        port: of the viewer's data, on 127.0.0.1.
        web_port: of the page, with ``web``.
        opened: called with the page's address, with ``web``.

    Raises:
        ParameterError: the file cannot be shown, or cannot be compared.
        MissingExtraError: rerun is not installed.
    """
    with tempfile.TemporaryDirectory(prefix="wrenchbed-") as folder:
        out = None if rrd is None else Path(rrd)
        picture = _picture(Path(file), against, out, Path(folder))
        if rrd is not None:
            return
        with (
            contextlib.suppress(KeyboardInterrupt),  # the way to end it
            show.viewer(picture, web=web, port=port, web_port=web_port) as viewer,
        ):
            if web:
                opened(show.address(web_port))
            show.until_closed(viewer)


def _picture(file: Path, against: Sequence[str | Path], rrd: Path | None, folder: Path) -> Path:
    """An existing picture, or one drawn at ``rrd`` or else in the folder."""
    made = file / PICTURE if file.is_dir() else file
    if made.suffix == ".rrd":
        if against or rrd is not None:
            raise ParameterError(f"{made}: is a picture already; give the recording instead")
        if not made.is_file():
            raise ParameterError(f"{made}: there is no such file; `diagnose --out` makes it")
        return made
    out = rrd or folder / f"{file.stem}.rrd"
    if not is_plan(file):
        recording_view(Recording.read(file), out, against)
    elif against:
        raise ParameterError(f"{file}: is a plan; fits and twins are compared with recordings")
    else:
        plan_view(Plan.read(file), out)
    return out
