"""Rerun's page for browsers, served so that it speaks to this machine alone.

The page that rerun serves asks Google for fonts and reports its use; here it comes with a policy
that forbids a browser to ask anybody but this machine.
"""

import contextlib
import os
import re
import shutil
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.error import HTTPError, URLError
from urllib.request import Request, urlopen

from wrenchbed.errors import DriverError

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


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    behind: int
    """Port at which rerun serves the page."""
    file: Path | None
    """Picture that the page shows."""


class _Handler(BaseHTTPRequestHandler):
    server: _Server

    def do_GET(self) -> None:
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
            with urlopen(asked, timeout=_ASKS_S) as answer:
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
    server.behind, server.file = behind, file
    with server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            yield
        finally:
            server.shutdown()
