"""Look at a file in rerun's viewer, bound to this machine alone and without its telemetry.

The page that rerun serves asks Google for fonts and reports its use. Here it is served with a
policy that forbids a browser to ask anybody but this machine.
"""

import contextlib
import os
import re
import shutil
import signal
import socket
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import BoundedSemaphore
from typing import Any
from urllib.error import HTTPError, URLError
from urllib.parse import quote
from urllib.request import ProxyHandler, Request, build_opener

from wrenchbed import registry
from wrenchbed.data.plan import Plan, is_plan
from wrenchbed.data.recording import Recording
from wrenchbed.errors import DriverError, ParameterError
from wrenchbed.jobs.ending import bound
from wrenchbed.viewer.plans import plan_view
from wrenchbed.viewer.recordings import recording_view
from wrenchbed.web_requests import RefusedError, check_origin, parse, read_head

HOST = "127.0.0.1"
FILE = "/shown.rrd"
POLICY = (
    "default-src 'self' data: blob:; script-src 'self' 'unsafe-inline' 'wasm-unsafe-eval' blob:; "
    f"style-src 'self' 'unsafe-inline'; connect-src 'self' http://{HOST}:*"
)
"""W3C Content Security Policy: what the page may load and ask."""
_ELSEWHERE = re.compile(rb"<link\b[^>]*\bhttps?://[^>]*>")
_KEPT = ("Content-Type", "rerun-final-length")
_ASKS_S = 20.0


_CLIENTS = 32
"""Most requests at a time: a browser opens six a server."""
_UPSTREAM = build_opener(ProxyHandler({}))
"""Asks rerun itself, whatever proxies the environment names."""
PORT, WEB_PORT = 9876, 9090
PROXY = f"rerun+http://{HOST}:{PORT}/proxy"
"""Where a live picture is sent."""
NOWHERE = f"http://{HOST}:9"
"""Proxy for what rerun would ask of others: the discard port, at which nobody listens."""
_PROXIES = ("all_proxy", "https_proxy", "http_proxy")
_QUIET_S, _OPENS_S, _CLOSES_S = 20.0, 15.0, 5.0
PICTURE = "diagnosis.rrd"
"""Picture in the folder of a diagnosis."""


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    clients: BoundedSemaphore
    behind: int
    """Port at which rerun serves the page."""
    file: Path | None
    """Picture that the page shows."""

    def process_request(self, request: Any, client_address: Any) -> None:
        """Serve it in a thread of its own; beyond the most clients, close it."""
        if self.clients.acquire(blocking=False):
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Serve it, and count it as ended."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self.clients.release()


class _Handler(BaseHTTPRequestHandler):
    server: _Server
    timeout = _ASKS_S

    def handle_one_request(self) -> None:
        """Read one request, check it, and answer it if this machine's browser asks."""
        self.command, self.requestline, self.request_version = "", "", self.protocol_version
        self.close_connection = True
        try:
            head = read_head(self.rfile)
            if not head:
                return
            asked = parse(head)
            check_origin(asked, self.server.server_port, (HOST, "localhost"))
            if asked.method != "GET":
                raise RefusedError("405 Method Not Allowed", "only GET is")
            self.path, self.command = asked.target, asked.method
            self._answer()
        except RefusedError as error:
            self.send_error(int(error.status[:3]), explain=error.why)
        except (TimeoutError, ConnectionError):
            return

    def _answer(self) -> None:
        if self.path == FILE and self.server.file is not None:
            with contextlib.suppress(ConnectionError), self.server.file.open("rb") as shown:
                self.send_response(200)
                self.send_header("Content-Type", "application/octet-stream")
                self.send_header("Content-Length", str(os.fstat(shown.fileno()).st_size))
                self.end_headers()
                shutil.copyfileobj(shown, self.wfile)
            return
        asked = Request(f"http://{HOST}:{self.server.behind}{self.path}")
        try:
            with _UPSTREAM.open(asked, timeout=_ASKS_S) as answer:
                self.send_response(answer.status)
                for name in _KEPT:
                    if answer.headers[name]:
                        self.send_header(name, answer.headers[name])
                self.send_header("Content-Security-Policy", POLICY)
                self.send_header("Referrer-Policy", "no-referrer")
                self.end_headers()
                if answer.headers.get_content_type() == "text/html":
                    self.wfile.write(_ELSEWHERE.sub(b"", answer.read()))
                else:
                    shutil.copyfileobj(answer, self.wfile)
        except HTTPError as error:
            self.send_error(error.code)
        except URLError as error:
            self.send_error(502, str(error.reason))
        except ConnectionError:
            self.close_connection = True  # the browser has left

    def log_message(self, format: str, *args: object) -> None:
        """A page's files are no news."""


def free_port() -> int:
    """A port of this machine that nobody listens at."""
    with socket.socket() as probe:
        probe.bind((HOST, 0))
        return int(probe.getsockname()[1])


@contextmanager
def served(port: int, behind: int, file: Path | None = None) -> Iterator[None]:
    """While the block runs the page that rerun serves at a port is served at another.

    Args:
        port: to serve at.
        behind: at which rerun serves.
        file: to serve as `FILE`.

    Raises:
        DriverError: the port is taken.
    """
    try:
        server = _Server((HOST, port), _Handler)
    except OSError as error:
        raise DriverError(f"the page's port {port} is taken: --web-port names another") from error
    server.behind, server.file, server.clients = behind, file, BoundedSemaphore(_CLIENTS)
    with server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            yield
        finally:
            server.shutdown()


def command(file: str | Path | None, *, port: int = PORT, web_port: int | None = None) -> list[str]:
    """What shows a file, or rows to come: rerun's native viewer, or with a port its web server.

    Raises:
        MissingExtraError: rerun is not installed.
    """
    arguments = [str(_binary()), "--bind", HOST, "--port", str(port)]
    if web_port is not None:
        arguments += ["--serve-web", "--web-viewer-port", str(web_port)]
    return arguments if file is None else [*arguments, str(file)]


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
    behind, shown = free_port() if web else None, None if file is None else Path(file)
    arguments = command(None if web else file, port=port, web_port=behind)
    with contextlib.ExitStack() as stack:
        if behind is not None:
            stack.enter_context(served(web_port, behind, shown))
        process = subprocess.Popen(bound(arguments), env=stack.enter_context(quiet()))
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
    what = f"{base}{FILE}" if port is None else f"rerun+http://{HOST}:{port}/proxy"
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


def view(
    file: str | Path,
    against: Sequence[str | Path] = (),
    *,
    rrd: str | Path | None = None,
    web: bool = False,
    port: int = PORT,
    web_port: int = WEB_PORT,
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
            viewer(picture, web=web, port=port, web_port=web_port) as opened_viewer,
        ):
            if web:
                opened(address(web_port))
            until_closed(opened_viewer)


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
