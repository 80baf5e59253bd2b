"""A small HTTP server of one thread: bounded requests, a deadline each, one at a time."""

import contextlib
import random
import socket
import threading
import time
from collections.abc import Callable

from wrenchbed.serving.netft.troubles import Troubles

_REQUEST_BYTES = 8192
_DEADLINE_S = 2.0
_LISTEN_S = 0.1


class Web:
    """Serves ``answer(target, body)`` → (status, content type, text) at an address.

    Raises:
        OSError: the address is taken or not allowed.
    """

    def __init__(
        self,
        address: tuple[str, int],
        answer: Callable[[str, str], tuple[str, str, str]],
        troubles: Troubles,
    ) -> None:
        self._answer, self._troubles = answer, troubles
        self._listener: socket.socket | None = _listen(address)
        self.address: tuple[str, int] = self._listener.getsockname()
        self._random = random.Random(self.address[1])
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="netft http", daemon=True)

    def start(self) -> None:
        """Answer from now on."""
        self._thread.start()

    def stop(self) -> None:
        """End the thread and close the port."""
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join(_DEADLINE_S + 1.0)
        if self._listener is not None:
            self._listener.close()
            self._listener = None

    def _run(self) -> None:
        while not self._ended.is_set():
            if self._troubles.now("unlisten") is not None:
                self._leave()
            elif self._listener is None:
                with contextlib.suppress(OSError):
                    self._listener = _listen(self.address)
            if self._listener is None:
                self._ended.wait(_LISTEN_S)
                continue
            with contextlib.suppress(OSError):
                connection, _ = self._listener.accept()
                with connection:
                    self._serve(connection)

    def _leave(self) -> None:
        if self._listener is not None:
            self._listener.close()
            self._listener = None

    def _serve(self, connection: socket.socket) -> None:
        end = time.monotonic() + _DEADLINE_S
        connection.settimeout(_LISTEN_S)
        request = self._receive(connection, end)
        while self._troubles.now("stall") is not None and not self._ended.wait(_LISTEN_S / 2):
            end = time.monotonic() + _DEADLINE_S
        connection.settimeout(max(0.1, end - time.monotonic()))
        connection.sendall(self._reply(request))
        connection.shutdown(socket.SHUT_WR)

    def _receive(self, connection: socket.socket, end: float) -> bytes:
        data = b""
        while len(data) < _REQUEST_BYTES and time.monotonic() < end and not self._ended.is_set():
            if complete(data):
                break
            try:
                more = connection.recv(4096)
            except TimeoutError:
                continue
            if not more:
                break
            data += more
        return data

    def _reply(self, request: bytes) -> bytes:
        method, target, body = parse(request)
        if method not in ("GET", "POST"):
            status, kind, text = "400 Bad Request", "text/html", "<html></html>"
        else:
            status, kind, text = self._answer(target, body)
        content = text.encode()
        if self._troubles.now("garbage") is not None:
            cut = self._random.randrange(len(content) // 2)
            content = content[:cut] + self._random.randbytes(64) + b"<unclosed>"
        head = (
            f"HTTP/1.0 {status}\r\nContent-Type: {kind}\r\n"
            f"Content-Length: {len(content)}\r\nConnection: close\r\n\r\n"
        )
        return head.encode() + content


def parse(request: bytes) -> tuple[str, str, str]:
    """Method, target and body of a request; empty words where it is none."""
    head, _, body = request.partition(b"\r\n\r\n")
    words = head.split(b"\r\n", 1)[0].decode("latin-1").split(" ")
    if len(words) != 3 or not words[2].startswith("HTTP/1."):
        return "", "", ""
    return words[0], words[1], body.decode("latin-1")


def complete(request: bytes) -> bool:
    """Whether all of a request is there."""
    head, end, body = request.partition(b"\r\n\r\n")
    if not end:
        return False
    for line in head.split(b"\r\n")[1:]:
        name, _, value = line.partition(b":")
        if name.strip().lower() == b"content-length":
            digits = value.strip()
            return not digits.isdigit() or len(digits) > 5 or len(body) >= int(digits)
    return True


def _listen(address: tuple[str, int]) -> socket.socket:
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(address)
        listener.listen(4)
        listener.settimeout(_LISTEN_S)
    except OSError:
        listener.close()
        raise
    return listener
