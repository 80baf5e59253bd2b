"""RTDE without ur_rtde: the controller's version, and named outputs over a connection of its own.

ur_rtde shifts all values after an output that it does not know; here the controller's own types
say how each is packed. Source of the protocol: Universal Robots, "RTDE guide": header uint16 size,
uint8 type, big endian. Only the standard library is imported, so that a worker starts quickly.
"""

import math
import socket
import struct
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

PORT = 30004
"""TCP port of RTDE; source: Universal Robots, "RTDE guide"."""
NATIVE_HZ = {False: 125.0, True: 500.0}
"""States per second of a CB3 and of an e-Series; source: Universal Robots, "RTDE guide"."""
_HEADER = struct.Struct(">HB")
_PROTOCOL, _VERSION, _TEXT = ord("V"), ord("v"), ord("M")
_LONGEST = 4096
"""Bytes of the longest packet that is taken; a longer one is no RTDE."""

_OUTPUTS, _START, _DATA = ord("O"), ord("S"), ord("U")
_TYPES = {
    "BOOL": "?", "UINT8": "B", "UINT32": "I", "UINT64": "Q", "INT32": "i", "DOUBLE": "d",
    "VECTOR3D": "3d", "VECTOR6D": "6d", "VECTOR6INT32": "6i", "VECTOR6UINT32": "6I",
}  # fmt: skip
"""Type that the controller names, and how it is packed; source: Universal Robots, "RTDE guide"."""
_MISSING = "NOT_FOUND"
Values = tuple[float, ...]


class Unfit(Exception):  # noqa: N818
    """A controller that cannot be used; the message says why."""


def controller_version(host: str, timeout: float) -> tuple[int, int, int, int]:
    """Major, minor, bugfix and build of the controller.

    Raises:
        OSError: it cannot be reached.
        TimeoutError: it accepts and does not answer in time [s].
        Unfit: its answer is not RTDE.
    """
    deadline = time.monotonic() + timeout
    with socket.create_connection((host, PORT), timeout) as link:
        return _version(link, deadline)


def _version(link: socket.socket, deadline: float) -> tuple[int, int, int, int]:
    if _ask(link, deadline, _PROTOCOL, struct.pack(">H", 2)) != b"\x01":
        raise Unfit("the controller refuses protocol version 2 of RTDE")
    answer = _ask(link, deadline, _VERSION, b"")
    if len(answer) != 16:
        raise Unfit(f"the controller's version has {len(answer)} bytes instead of 16")
    major, minor, bugfix, build = struct.unpack(">IIII", answer)
    return major, minor, bugfix, build


def _ask(link: socket.socket, deadline: float, kind: int, body: bytes) -> bytes:
    link.sendall(_HEADER.pack(_HEADER.size + len(body), kind) + body)
    return _content(link, deadline, kind)


def _content(link: socket.socket, deadline: float, kind: int) -> bytes:
    """Content of the next packet of a kind; texts before it are skipped."""
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
        remaining = deadline - time.monotonic()
        if remaining <= 0.0:
            raise TimeoutError("the controller accepts connections and does not answer")
        link.settimeout(remaining)
        try:
            part = link.recv(n - len(data))
        except TimeoutError:
            continue
        if not part:
            raise ConnectionResetError("the controller closed the connection")
        data += part
    return data


class Outputs:
    """Named outputs that a controller streams.

    Attributes:
        names: those that it has, of those asked for.
        version: of its software.
    """

    def __init__(self, link: socket.socket, version: tuple[int, int, int, int]) -> None:
        self.version = version
        self.names: tuple[str, ...] = ()
        self._link = link
        self._packing: list[struct.Struct] = []

    def ask(self, names: Sequence[str], rate: float, deadline: float) -> None:
        """Ask for outputs at a rate [Hz]; those that the controller lacks are left out.

        Raises:
            TimeoutError, OSError: it does not answer by then.
            Unfit: its answer is not RTDE.
        """
        wanted = list(names)
        while wanted:
            body = struct.pack(">d", rate) + ",".join(wanted).encode()
            answer = _ask(self._link, deadline, _OUTPUTS, body)
            types = answer[1:].decode("latin-1").split(",")
            if len(types) != len(wanted):
                raise Unfit(f"the controller names {len(types)} types for {len(wanted)} outputs")
            if _MISSING not in types:
                break
            wanted = [n for n, kind in zip(wanted, types, strict=True) if kind != _MISSING]
        else:
            raise Unfit("the controller has none of the outputs")
        if unknown := [kind for kind in types if kind not in _TYPES]:
            raise Unfit(f"the controller names a type {unknown[0][:20]!r}")
        self.names = tuple(wanted)
        self._packing = [struct.Struct(">" + _TYPES[kind]) for kind in types]
        if _ask(self._link, deadline, _START, b"") != b"\x01":
            raise Unfit("the controller refuses to start")

    def next(self, deadline: float) -> tuple[float, dict[str, Values]]:
        """Arrival [s] and values of the next packet.

        Raises:
            TimeoutError, OSError: none comes by then.
            Unfit: it is not RTDE.
        """
        content = _content(self._link, deadline, _DATA)
        now = time.monotonic()
        if len(content) != 1 + sum(packing.size for packing in self._packing):
            raise Unfit(f"the controller sends {len(content)} bytes of data, not as announced")
        values, at = {}, 1
        for name, packing in zip(self.names, self._packing, strict=True):
            values[name] = tuple(map(float, packing.unpack_from(content, at)))
            at += packing.size
        return now, values


@contextmanager
def outputs(
    host: str,
    names: Sequence[str],
    timeout: float,
    rate: float | None = None,
) -> Iterator[Outputs]:
    """A stream of outputs, started within a time [s], at a rate [Hz] or the controller's own.

    Raises:
        OSError: it cannot be reached, or does not answer in time.
        Unfit: its answer is not RTDE.
    """
    deadline = time.monotonic() + timeout
    with socket.create_connection((host, PORT), timeout) as link:
        stream = Outputs(link, _version(link, deadline))
        stream.ask(names, rate or NATIVE_HZ[stream.version[0] > 3], deadline)
        yield stream


def once(host: str, names: Sequence[str], timeout: float) -> dict[str, Values]:
    """One packet of named outputs; less where the controller lacks some or does not answer."""
    try:
        with outputs(host, names, timeout) as stream:
            values = stream.next(time.monotonic() + timeout)[1]
    except (OSError, Unfit):
        return {}
    return {name: v for name, v in values.items() if all(map(math.isfinite, v))}
