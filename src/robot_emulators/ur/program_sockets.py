"""TCP connections that a URScript program opens: nothing blocks, and buffered input is bounded."""

import contextlib
import ipaddress
import select
import socket

_MOST = 16
"""Most connections of one program."""
_HOLDS = 1 << 16
"""Most received bytes that wait for the program, beside those in the kernel's buffer."""


class Link:
    """TCP/IP connection that a program opens without waiting; `open` says when it is established.
    ``source`` is the local address to connect from; empty: any."""

    def __init__(self, address: str, port: int, source: str) -> None:
        self.held = bytearray()
        self.lost = False
        self._open = False
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        try:
            if source:
                self._socket.bind((source, 0))
            self._socket.connect((address, port))
        except BlockingIOError:
            pass
        except OSError:
            self.close()

    @property
    def open(self) -> bool:
        """Whether the connection is open; `lost` is set if it could not be established."""
        if not self._open and not self.lost and select.select([], [self._socket], [], 0.0)[1]:
            self._open = not self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
            if not self._open:
                self.close()
        return self._open and not self.lost

    def read(self, count: int) -> bytes | None:
        """Take ``count`` received bytes; None if fewer have arrived."""
        if len(self.held) < count:
            self._hear()
        return self._taken(count) if len(self.held) >= count else None

    def until(self, end: bytes) -> bytes | None:
        """Take received bytes up to an end mark, which is dropped; None if it has not arrived."""
        if end not in self.held:
            self._hear()
        at = self.held.find(end)
        return self._taken(at + len(end))[:at] if at >= 0 else None

    def all(self) -> bytes | None:
        """Take all received bytes; None if none have arrived."""
        self._hear()
        return self._taken(len(self.held)) if self.held else None

    def send(self, data: bytes) -> bool:
        """Send bytes without waiting; close the connection, return False if some are refused."""
        if not self.open:
            return False
        try:
            sent = self._socket.send(data)
        except OSError:
            sent = 0
        if sent < len(data):
            self.close()
        return sent == len(data)

    def close(self) -> None:
        self.lost = True
        self._socket.close()

    def _taken(self, count: int) -> bytes:
        data = bytes(self.held[:count])
        del self.held[:count]
        return data

    def _hear(self) -> None:
        while self.open and len(self.held) < _HOLDS:
            try:
                data = self._socket.recv(4096)
            except BlockingIOError:
                return
            except OSError:
                data = b""
            if not data:
                self.close()
            self.held += data


class Links:
    """TCP/IP connections of one URScript program, by name.

    Args:
        source: local address to connect from; any if it is empty or 0.0.0.0.
    """

    def __init__(self, source: str) -> None:
        self._source = "" if source in ("", "0.0.0.0") else source
        self._links: dict[str, Link] = {}

    def dial(self, address: str, port: int, name: str) -> Link | None:
        """Begin to open a named connection; None if the address is invalid or there are too many.
        Names of hosts are not looked up, as that would hold up the control cycle."""
        address = "127.0.0.1" if address == "localhost" else address
        with contextlib.suppress(ValueError):
            ipaddress.IPv4Address(address)
            if 0 < port < 1 << 16 and (name in self._links or len(self._links) < _MOST):
                self.hang_up(name)
                self._links[name] = Link(address, port, self._source)
                return self._links[name]
        return None

    def of(self, name: str) -> Link | None:
        """Return the named connection if it is open or has unread bytes, else None."""
        link = self._links.get(name)
        return link if link is not None and (link.open or link.held) else None

    def hang_up(self, name: str) -> None:
        """Close the connection of this name."""
        link = self._links.pop(name, None)
        if link is not None:
            link.close()

    def close(self) -> None:
        for name in list(self._links):
            self.hang_up(name)
