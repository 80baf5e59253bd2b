"""Look at a file in rerun's own window, bound to this machine alone and without its telemetry."""

import contextlib
import os
import signal
import socket
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from wrenchbed import registry
from wrenchbed.data.plan import Plan, is_plan
from wrenchbed.data.recording import Recording
from wrenchbed.errors import DriverError, ParameterError
from wrenchbed.jobs.ending import bound
from wrenchbed.viewer.plans import plan_view
from wrenchbed.viewer.recordings import recording_view

HOST = "127.0.0.1"
PORT = 9876
NOWHERE = f"http://{HOST}:9"
"""Proxy for all that rerun would ask of the internet: the discard port, at which nobody listens."""
_PROXIES = ("all_proxy", "https_proxy", "http_proxy")
_QUIET_S = 20.0
PICTURE = "diagnosis.rrd"
"""File name of the picture in the folder of a diagnosis."""


def command(file: str | Path, *, port: int = PORT) -> list[str]:
    """Command line that shows a file in rerun's viewer, which receives data on TCP ``port``."""
    return [str(_binary()), "--bind", HOST, "--port", str(port), str(file)]


def show(file: str | Path, *, port: int = PORT) -> None:
    """Show a file in rerun's viewer, which listens on TCP ``port``, until its window is closed.

    Raises:
        ParameterError: there is no screen for a window.
        DriverError: the port is taken, or the viewer fails.
        MissingExtraError: rerun is not installed.
    """
    if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise ParameterError("there is no screen: write a file with --rrd and open it elsewhere")
    with contextlib.suppress(OSError), socket.create_connection((HOST, port), 1.0):
        raise DriverError(f"port {port} is taken, perhaps by a viewer that is open: close it")
    with quiet() as environment, contextlib.suppress(KeyboardInterrupt):
        done = subprocess.run(bound(command(file, port=port)), env=environment, check=False)
        if done.returncode not in (0, -signal.SIGINT):
            raise DriverError(f"rerun's viewer ended with code {done.returncode}")


@contextmanager
def quiet() -> Iterator[dict[str, str]]:
    """Yield environment variables for a process in which rerun contacts nobody.

    Telemetry is off; the check for newer versions goes to a proxy address where nobody listens.
    """
    with tempfile.TemporaryDirectory(prefix="wrenchbed-view-") as folder:
        folders = dict.fromkeys(("XDG_CONFIG_HOME", "XDG_DATA_HOME", "XDG_CACHE_HOME"), folder)
        away = {name: NOWHERE for word in _PROXIES for name in (word, word.upper())}
        environment = {"RUST_LOG": "warn"} | os.environ | folders | away
        subprocess.run(
            [str(_binary()), "analytics", "disable"],
            env=environment, check=True, capture_output=True, timeout=_QUIET_S,
        )  # fmt: skip
        yield environment


def _binary() -> Path:
    """Path of rerun's viewer program itself: killing its Python wrapper script would not end it."""
    return Path(str(registry.require("rerun_cli", "view").__file__)).parent / "rerun"


def view(
    file: str | Path,
    against: Sequence[str | Path] = (),
    *,
    rrd: str | Path | None = None,
    port: int = PORT,
) -> None:
    """Show a recording, a plan, a diagnosis's folder or an ``.rrd`` file until its window is
    closed; with ``rrd``, write the picture there and open nothing.

    ``against``: up to three fit.json or twin.json files to compare with a recording.

    Raises:
        ParameterError: the file cannot be shown, or cannot be compared.
        MissingExtraError: rerun is not installed.
    """
    with tempfile.TemporaryDirectory(prefix="wrenchbed-") as folder:
        out = None if rrd is None else Path(rrd)
        picture = _picture(Path(file), against, out, Path(folder))
        if rrd is None:
            show(picture, port=port)


def _picture(file: Path, against: Sequence[str | Path], rrd: Path | None, folder: Path) -> Path:
    """Path of a file's ``.rrd`` picture: itself, or drawn from it to ``rrd`` or into ``folder``."""
    made = file / PICTURE if file.is_dir() else file
    if made.suffix == ".rrd":
        if not made.is_file():
            why = "`diagnose --out` draws it for a wrench; report.html is of other recordings too"
            raise ParameterError(f"{made}: there is no such file; {why}")
        if against or rrd is not None:
            raise ParameterError(f"{made}: is a picture already; give the recording instead")
        return made
    out = rrd or folder / f"{file.stem}.rrd"
    if not is_plan(file):
        recording_view(Recording.read(file), out, against)
    elif against:
        raise ParameterError(f"{file}: is a plan; fits and twins are compared with recordings")
    else:
        plan_view(Plan.read(file), out)
    return out
