"""The robot's dashboard server: one text command a connection, with a deadline for all of it.

Universal Robots, "Dashboard server": TCP 29999, a line in, a line out, after a line of welcome.
"""

import socket
import time

from wrenchbed.errors import LinkError

PORT = 29999


def ask(host: str, command: str, timeout: float = 1.0) -> str:
    """The answer to one command.

    Raises:
        LinkError: none came in time [s].
    """
    deadline = time.monotonic() + timeout
    try:
        with socket.create_connection((host, PORT), timeout) as link:
            rest = _line(link, b"", deadline)[1]
            link.sendall(command.encode() + b"\n")
            return _line(link, rest, deadline)[0].decode(errors="replace").strip()
    except OSError as error:
        why = error.strerror or str(error)
        raise LinkError(f"dashboard of {host}: no answer to {command!r}: {why}") from error


def _line(link: socket.socket, data: bytes, deadline: float) -> tuple[bytes, bytes]:
    while b"\n" not in data:
        left = deadline - time.monotonic()
        if left <= 0.0 or len(data) > 4096:
            raise TimeoutError("timed out")
        link.settimeout(left)
        part = link.recv(1024)
        if not part:
            raise ConnectionResetError("the connection was closed")
        data += part
    line, _, rest = data.partition(b"\n")
    return line, rest
