"""Rerun's viewer, bound to this machine alone and without its telemetry."""

import contextlib
import os
import signal
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import quote

from wrenchbed import registry
from wrenchbed.errors import DriverError, ParameterError
from wrenchbed.viewer import page
from wrenchbed.viewer.page import HOST

PORT, WEB_PORT = 9876, 9090
PROXY = f"rerun+http://{HOST}:{PORT}/proxy"
"""Where a live picture is sent."""
NOWHERE = f"http://{HOST}:9"
"""Proxy for what rerun would ask of others: the discard port, at which nobody listens."""
_PROXIES = ("all_proxy", "https_proxy", "http_proxy")
_QUIET_S, _OPENS_S, _CLOSES_S = 20.0, 15.0, 5.0


def command(file: str | Path | None, *, port: int = PORT, web_port: int | None = None) -> list[str]:
    """What shows a file, or rows to come: rerun's native viewer, or with a port its web server.

    Raises:
        MissingExtraError: rerun is not installed.
    """
    told = [str(_binary()), "--bind", HOST, "--port", str(port)]
    if web_port is not None:
        told += ["--serve-web", "--web-viewer-port", str(web_port)]
    return told if file is None else [*told, str(file)]


@contextmanager
def viewer(
    file: str | Path | None, *, web: bool, port: int = PORT, web_port: int = WEB_PORT
) -> Iterator["subprocess.Popen[bytes]"]:
    """A viewer that listens, open until it is closed or the block ends.

    Args:
        file: to show; None for rows that are still to come.
        web: served to a browser of this machine instead of in a window. A browser fetches the file
            itself: rerun's server spins on files that it has read.
        port: of its data.
        web_port: of the page.

    Raises:
        ParameterError: there is no screen for a window.
        DriverError: the viewer does not begin; a port is taken.
        MissingExtraError: rerun is not installed.
    """
    if not web:
        _check_screen()
    _check_free(port)
    behind, shown = page.free_port() if web else None, None if file is None else Path(file)
    told = command(None if web else file, port=port, web_port=behind)
    with contextlib.ExitStack() as stack:
        if behind is not None:
            stack.enter_context(page.served(web_port, behind, shown))
        process = subprocess.Popen(told, env=stack.enter_context(quiet()))
        try:
            for listens in (port,) if behind is None else (port, behind):
                _wait_for(process, listens)
            yield process
        finally:
            process.terminate()
            process.wait(_CLOSES_S)


def until_closed(process: "subprocess.Popen[bytes]") -> None:
    """Wait until a viewer is closed.

    Raises:
        DriverError: it failed; it said why.
    """
    code = process.wait()
    if code not in (0, -signal.SIGINT):
        raise DriverError(f"rerun's viewer ended with code {code}")


def _wait_for(process: "subprocess.Popen[bytes]", port: int) -> None:
    """Wait until a viewer listens.

    Raises:
        DriverError: it ended, or did not begin in time.
    """
    until = time.monotonic() + _OPENS_S
    while time.monotonic() < until:
        with contextlib.suppress(OSError), socket.create_connection((HOST, port), 1.0):
            return
        if process.poll() is not None:
            raise DriverError(f"rerun's viewer ended with code {process.returncode}")
        time.sleep(0.1)
    raise DriverError(f"rerun's viewer does not listen at {HOST}:{port}")


def address(web_port: int = WEB_PORT, port: int | None = None) -> str:
    """What to open in a browser: the file of its server, or, with a port, rows to come."""
    base = f"http://{HOST}:{web_port}"
    what = f"{base}{page.FILE}" if port is None else f"rerun+http://{HOST}:{port}/proxy"
    return f"{base}/?url={quote(what, safe='')}"


@contextmanager
def quiet() -> Iterator[dict[str, str]]:
    """Environment in which rerun asks nobody; the user's settings are left as they are.

    Telemetry is off, and its question for newer versions goes to a proxy that is not there.
    """
    with tempfile.TemporaryDirectory(prefix="wrenchbed-view-") as folder:
        own = dict.fromkeys(("XDG_CONFIG_HOME", "XDG_DATA_HOME", "XDG_CACHE_HOME"), folder)
        away = {name: NOWHERE for word in _PROXIES for name in (word, word.upper())}
        environment = {"RUST_LOG": "warn"} | os.environ | own | away
        subprocess.run(
            [str(_binary()), "analytics", "disable"],
            env=environment, check=True, capture_output=True, timeout=_QUIET_S,
        )  # fmt: skip
        yield environment


def _check_free(port: int) -> None:
    with contextlib.suppress(OSError), socket.create_connection((HOST, port), 1.0):
        raise DriverError(f"port {port} is taken, perhaps by a viewer that is open: close it")


def _check_screen() -> None:
    if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise ParameterError("there is no screen: look with a browser, or write a file with --rrd")


def _binary() -> Path:
    """Rerun's viewer itself: killing the Python script around it would leave it running."""
    package = registry.require("rerun_cli", "view")
    return Path(str(package.__file__)).parent / "rerun"
