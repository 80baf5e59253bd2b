"""The box's web server; `pages` has what it shows and sets.

Settings are changed by plain GETs, and a browser sends what any page tells it to: requests that a
page elsewhere asks for are refused. A page elsewhere may have its name resolved to this machine
(DNS rebinding) or ask across origins; Host, Origin and Sec-Fetch-Site show both. Programs that are
no browsers send no Origin. Sources: the Fetch standard, Fetch Metadata (W3C).
"""

import contextlib
import random
import re
import threading
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from socketserver import TCPServer

from robot_emulators.base.faults import Faults
from robot_emulators.netft_box.pages import Reply

_BODY_BYTES = 8192
"""Longest body; a form of the box with all its variables has some 1500 bytes."""
_DEADLINE_S = 2.0
"""Longest pause of a client within its request."""
_LOOK_S = 0.02
"""Time between two looks at the faults, and at a port that someone else took meanwhile [s]."""
_HOST = re.compile(r"(?:localhost|[0-9]{1,3}(?:\.[0-9]{1,3}){3})(?::([0-9]{1,5}))?", re.IGNORECASE)
"""A name that cannot be resolved to another machine; simple clients leave out the port."""


def is_ours(host: str | None, origin: str | None, site: str | None, port: int) -> bool:
    """Whether a request is of a program, or of a page of the server at a port itself.

    Args:
        host: its field Host, None where there is none.
        origin: its field Origin.
        site: its field Sec-Fetch-Site.
        port: at which the server listens.
    """
    name = _HOST.fullmatch(host or "localhost")
    here = name is not None and name[1] in (None, str(port))
    return here and origin in (None, f"http://{host}") and site in (None, "none", "same-origin")


class _Server(ThreadingHTTPServer):
    timeout = _LOOK_S
    reply: Callable[[str, str], tuple[str, str, bytes]]

    def server_bind(self) -> None:
        """Bind without asking a name server for this machine's name."""
        TCPServer.server_bind(self)
        self.server_name, self.server_port = "netft", self.server_address[1]


class _Handler(BaseHTTPRequestHandler):
    server: _Server
    timeout = _DEADLINE_S

    def do_GET(self) -> None:
        """Serve a GET, or a POST of a form."""
        fields, port = self.headers, self.server.server_port
        if not self.path.startswith("/"):
            self.send_error(400)
        elif not is_ours(fields["Host"], fields["Origin"], fields["Sec-Fetch-Site"], port):
            self.send_error(403)
        else:
            length = fields.get("Content-Length", "0")
            body = self.rfile.read(min(int(length), _BODY_BYTES)) if length.isdecimal() else b""
            status, kind, content = self.server.reply(self.path, body.decode("latin-1"))
            code, _, words = status.partition(" ")
            self.send_response(int(code), words)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            self.wfile.write(content)

    do_POST = do_GET

    def log_message(self, format: str, *arguments: object) -> None:
        """Nothing: the emulator's terminal shows its links alone."""


class Web:
    """Serves ``answer(target, body)`` → (status, content type, text) at an address.

    Raises:
        OSError: the address is taken or not allowed.
    """

    def __init__(
        self, address: tuple[str, int], answer: Callable[[str, str], Reply], faults: Faults
    ) -> None:
        self._answer, self._faults = answer, faults
        self._server = self._opened(address)
        self.address = address[0], self._server.server_port
        self._random = random.Random(self.address[1])
        self._lock, self._stopped = threading.Lock(), threading.Event()
        self._thread = threading.Thread(target=self._run, name="netft pages", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Close the port and end all requests; may be called twice."""
        self._stopped.set()
        self._thread.join(_DEADLINE_S)

    def _opened(self, address: tuple[str, int]) -> _Server:
        server = _Server(address, _Handler)
        server.reply = self._reply
        return server

    def _run(self) -> None:
        while not self._stopped.is_set():
            if self._faults.now("http", "unlisten") is None:
                self._server.handle_request()
                continue
            self._server.server_close()
            while not self._stopped.wait(_LOOK_S):
                if self._faults.now("http", "unlisten") is None:
                    with contextlib.suppress(OSError):
                        self._server = self._opened(self.address)
                        break
        self._server.server_close()

    def _reply(self, target: str, body: str) -> tuple[str, str, bytes]:
        while self._faults.now("http", "stall") is not None and not self._stopped.wait(_LOOK_S):
            pass
        with self._lock:
            status, kind, text = self._answer(target, body)
        content = text.encode()
        if self._faults.now("http", "garbage") is not None:
            cut = self._random.randrange(len(content) // 2)
            content = content[:cut] + self._random.randbytes(64) + b"<unclosed>"
        return status, kind, content
