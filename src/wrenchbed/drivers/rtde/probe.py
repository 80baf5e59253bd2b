"""Ask a controller for its version before ur_rtde is let near it.

ur_rtde's constructors wait for ever for a controller that accepts and is silent, and return
useless objects for one that refuses; two packets of the protocol with deadlines tell first.
Protocol: Universal Robots, "RTDE guide": header uint16 size, uint8 type, big endian.
"""

import socket
import struct
import time

PORT = 30004
_HEADER = struct.Struct(">HB")
_PROTOCOL, _VERSION, _TEXT = ord("V"), ord("v"), ord("M")
_LONGEST = 4096


class Unfit(Exception):  # noqa: N818
    """A controller that cannot be used; the message says why."""


def version(host: str, timeout: float) -> tuple[int, int, int, int]:
    """Major, minor, bugfix and build of the controller.

    Raises:
        OSError: it cannot be reached.
        TimeoutError: it accepts and does not answer in time [s].
        Unfit: it answers what is no RTDE.
    """
    deadline = time.monotonic() + timeout
    with socket.create_connection((host, PORT), timeout) as link:
        if _ask(link, deadline, _PROTOCOL, struct.pack(">H", 2)) != b"\x01":
            raise Unfit("the controller refuses protocol version 2 of RTDE")
        answer = _ask(link, deadline, _VERSION, b"")
        if len(answer) != 16:
            raise Unfit(f"the controller's version has {len(answer)} bytes instead of 16")
        major, minor, bugfix, build = struct.unpack(">IIII", answer)
        return major, minor, bugfix, build


def _ask(link: socket.socket, deadline: float, kind: int, body: bytes) -> bytes:
    link.sendall(_HEADER.pack(_HEADER.size + len(body), kind) + body)
    while True:
        size, answered = _HEADER.unpack(_exactly(link, deadline, _HEADER.size))
        if not _HEADER.size <= size <= _LONGEST:
            raise Unfit(f"the controller sent a packet of {size} bytes: this is no RTDE")
        content = _exactly(link, deadline, size - _HEADER.size)
        if answered == kind:
            return content
        if answered != _TEXT:
            raise Unfit(f"the controller answered with a packet of type {answered}")


def _exactly(link: socket.socket, deadline: float, n: int) -> bytes:
    data = b""
    while len(data) < n:
        left = deadline - time.monotonic()
        if left <= 0.0:
            raise TimeoutError("the controller accepts connections and does not answer")
        link.settimeout(left)
        try:
            part = link.recv(n - len(data))
        except TimeoutError:
            continue
        if not part:
            raise ConnectionResetError("the controller closed the connection")
        data += part
    return data
