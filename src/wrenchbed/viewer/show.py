"""Rerun's viewer, bound to this machine alone and without its telemetry."""

import contextlib
import os
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from wrenchbed import registry
from wrenchbed.errors import DriverError, ParameterError

HOST = "127.0.0.1"
PORT, WEB_PORT = 9876, 9090
PROXY = f"rerun+http://{HOST}:{PORT}/proxy"
"""Where a live picture is sent."""
_QUIET_S, _OPENS_S = 20.0, 15.0


def command(
    file: str | Path, *, web: bool, port: int = PORT, web_port: int = WEB_PORT
) -> list[str]:
    """What shows a file: rerun's native viewer, or a server for a browser.

    Raises:
        MissingExtraError: rerun is not installed.
    """
    told = [str(_binary()), "--bind", HOST, "--port", str(port)]
    if web:
        told += ["--serve-web", "--web-viewer-port", str(web_port)]
    return [*told, str(file)]


def live(*, web: bool) -> list[str]:
    """What shows rows that are still to come.

    Raises:
        ParameterError: there is no screen for a native viewer.
        MissingExtraError: rerun is not installed.
    """
    told = command("", web=web)[:-1]
    if not web:
        _check_screen()
    return told


def wait_for(process: "subprocess.Popen[bytes]") -> None:
    """Wait until a viewer listens.

    Raises:
        DriverError: it ended, or did not begin in time.
    """
    until = time.monotonic() + _OPENS_S
    while time.monotonic() < until:
        with contextlib.suppress(OSError), socket.create_connection((HOST, PORT), 1.0):
            return
        if process.poll() is not None:
            raise DriverError(f"rerun's viewer ended with {process.returncode}: is {PORT} taken?")
        time.sleep(0.1)
    raise DriverError(f"rerun's viewer does not listen at {HOST}:{PORT}")


def address(port: int = PORT, web_port: int = WEB_PORT) -> str:
    """What to open in a browser."""
    return f"http://{HOST}:{web_port}/?url=rerun%2Bhttp%3A%2F%2F{HOST}%3A{port}%2Fproxy"


@contextmanager
def quiet() -> Iterator[dict[str, str]]:
    """Environment in which rerun sends no telemetry; its settings are left as they are."""
    with tempfile.TemporaryDirectory(prefix="wrenchbed-view-") as folder:
        own = dict.fromkeys(("XDG_CONFIG_HOME", "XDG_DATA_HOME", "XDG_CACHE_HOME"), folder)
        environment = os.environ | own
        subprocess.run(
            [str(_binary()), "analytics", "disable"],
            env=environment, check=True, capture_output=True, timeout=_QUIET_S,
        )  # fmt: skip
        yield environment


def show(told: Sequence[str]) -> None:
    """Run a viewer until it is closed.

    Raises:
        ParameterError: there is no screen for a native viewer.
        DriverError: the viewer failed; it said why.
    """
    if "--serve-web" not in told:
        _check_screen()
    with quiet() as environment:
        code = subprocess.run(told, env=environment, check=False).returncode
    if code:
        raise DriverError(f"rerun's viewer ended with code {code}: is its port taken?")


def _check_screen() -> None:
    if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise ParameterError("there is no screen: look with a browser, or write a file with --rrd")


def _binary() -> Path:
    """Rerun's viewer itself: killing the Python script around it would leave it running."""
    package = registry.require("rerun_cli", "view")
    return Path(str(package.__file__)).parent / "rerun"
