"""`wrenchbed view` and `wrenchbed report`: pictures and pages of recordings, fits and diagnoses."""

from pathlib import Path

import tyro

import wrenchbed as wb
from wrenchbed.cli import console
from wrenchbed.data.outputs import Kind


def view(
    recording: tyro.conf.Positional[Path],
    against: tyro.conf.Positional[tuple[Path, ...]] = (),
    /,
    rrd: Path | None = None,
    web: bool = False,
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
    console.check_out(rrd, Kind.PICTURE, recording, *against)
    wb.view(
        recording, against, rrd=rrd, web=web, port=port, web_port=web_port,
        opened=lambda address: console.say(f"open {address} (Ctrl-C ends it)"),
    )  # fmt: skip
    if rrd is not None:
        console.say(f"view → {rrd}")


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
    console.check_out(out, Kind.PAGE, recording, *against)
    command = console.command("report", recording, *against, "--out", out)
    wb.report(wb.Recording.read(recording), against, out, command)
    console.say(f"report → {out}")
