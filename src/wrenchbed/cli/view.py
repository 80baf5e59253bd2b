"""`wrenchbed view` and `wrenchbed report`: recordings, fits and diagnoses for people."""

import contextlib
import shlex
import tempfile
from pathlib import Path
from typing import Annotated

import tyro

import wrenchbed as wb
from wrenchbed.cli import console
from wrenchbed.data.plan import is_plan
from wrenchbed.errors import ParameterError

_MADE = "diagnosis.rrd"


def view(
    recording: tyro.conf.Positional[Path],
    against: tyro.conf.Positional[tuple[Path, ...]] = (),
    /,
    rrd: Path | None = None,
    web: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    port: int = 9876,
    web_port: int = 9090,
) -> None:
    """Look at a recording with what simulators say, at a plan or at a diagnosis, in rerun.

    Args:
        recording: Parquet file, of a plan too; the folder of a diagnosis; or an .rrd file.
        against: fit.json and twin.json files whose simulators are held against it, the last as a
            ghost.
        rrd: Write this file and open nothing.
        web: Serve a browser on this machine instead of opening rerun's own window.
        port: Of the viewer's data, on 127.0.0.1.
        web_port: With --web: of the page.
    """
    from wrenchbed.viewer import show

    console.check_out(rrd, recording, *against)
    with tempfile.TemporaryDirectory(prefix="wrenchbed-") as folder:
        file = _file(recording, against, rrd, Path(folder))
        if rrd is not None:
            console.OUT.print(f"view → {file}", soft_wrap=True, markup=False, highlight=False)
            return
        with (
            contextlib.suppress(KeyboardInterrupt),  # the way to end it
            show.viewer(file, web=web, port=port, web_port=web_port) as viewer,
        ):
            if web:
                text = f"open {show.address(web_port)} (Ctrl-C ends it)"
                console.OUT.print(text, soft_wrap=True, markup=False, highlight=False)
            show.until_closed(viewer)


def _file(recording: Path, against: tuple[Path, ...], rrd: Path | None, folder: Path) -> Path:
    """The file to show, made if need be: where it is asked for, else in a folder."""
    made = recording / _MADE if recording.is_dir() else recording
    if made.suffix == ".rrd":
        if against or rrd is not None:
            raise ParameterError(f"{made}: is a picture already; give the recording instead")
        if not made.is_file():
            raise ParameterError(f"{made}: there is no such file; `diagnose --out` makes it")
        return made
    from wrenchbed.viewer import plan_view, recording_view

    out = rrd or folder / f"{recording.stem}.rrd"
    if not is_plan(recording):
        recording_view(wb.Recording.read(recording), out, against)
    elif against:
        raise ParameterError(f"{recording}: is a plan; fits and twins are held against recordings")
    else:
        plan_view(wb.Plan.read(recording), out)
    return out


def report(
    recording: tyro.conf.Positional[Path],
    against: tyro.conf.Positional[tuple[Path, ...]] = (),
    /,
    out: Path = Path("report.html"),
) -> None:
    """Write one HTML page about a recording, what simulators say of it, and fits.

    A diagnosis writes its own report, see `wrenchbed diagnose`.

    Args:
        recording: Parquet file.
        against: fit.json and twin.json files whose simulators are held against it.
        out: Page to write.
    """
    from wrenchbed.reports import recording_page

    console.check_out(out, recording, *against)
    words = ["wrenchbed", "report", str(recording), *map(str, against), "--out", str(out)]
    recording_page(wb.Recording.read(recording), against, shlex.join(words)).write(out)
    console.OUT.print(f"report → {out}", soft_wrap=True, markup=False, highlight=False)
