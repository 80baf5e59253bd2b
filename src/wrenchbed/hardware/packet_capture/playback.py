"""Kept packets played to drivers again: a small RTDE server, RDT over UDP, the box's page, and
serial lines.

The other side answers as it did, in its own time. A client that asks for other outputs than those
that were kept is told that there are none.
"""

import contextlib
import socket
import struct
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Self

from wrenchbed.errors import RecordingError
from wrenchbed.hardware.packet_capture.capture import Packet, packets
from wrenchbed.hardware.packet_capture.serial_playback import SerialPlayback
from wrenchbed.web_requests import RefusedError, check_origin, parse, read_head

RTDE, RDT, HTTP = "rtde", "rdt", "http"
"""Names of the peers."""
_PORTS = {RTDE: 30004, RDT: 49152}
_HEAD = struct.Struct(">HB")
_DATA, _OUTPUTS, _START = ord("U"), ord("O"), ord("S")
_RDT_START = (2, 3)
_LOOK_S = 0.1
"""Longest wait for a request [s]; estimate."""


class Playback:
    """Serves a folder of packets at an address of this machine. Use as a context manager.

    Attributes:
        addresses: of ``rtde``, ``rdt`` and ``http``, and the port of each serial sensor by its
            name, as far as they were kept.
        done: whether every stream that was asked for was played to its end.

    Raises:
        RecordingError: the folder holds nothing that can be played.
        OSError: a port is taken.
    """

    def __init__(self, folder: Path, host: str, http_port: int = 8080) -> None:
        self._folder, self._host, self._http_port = folder, host, http_port
        self.addresses: dict[str, str] = {}
        self.done = threading.Event()
        self._stop = threading.Event()
        self._sockets: list[socket.socket] = []
        self._threads: list[threading.Thread] = []

    def __enter__(self) -> Self:
        kept = list(packets(self._folder))
        came: dict[str, list[Packet]] = {RTDE: [], RDT: [], HTTP: []}
        for packet in kept:
            if not packet.sent and packet.peer in came:
                came[packet.peer].append(packet)
        lines: dict[str, list[Packet]] = {}
        for packet in kept:
            if packet.peer not in came:
                lines.setdefault(packet.peer, []).append(packet)
        if not any(came.values()) and all(p.sent for talk in lines.values() for p in talk):
            raise RecordingError(
                f"{self._folder}: holds nothing that came from a robot or a sensor"
            )
        if came[RTDE]:
            self._listen(RTDE, _PORTS[RTDE], _Rtde(came[RTDE], kept, self._stop, self.done).serve)
        if came[HTTP]:
            page = came[HTTP][0].data
            self._listen(HTTP, self._http_port, lambda link: _page(link, page))
        if came[RDT]:
            udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            self._sockets.append(udp)
            udp.bind((self._host, _PORTS[RDT]))
            self.addresses[RDT] = f"{self._host}:{_PORTS[RDT]}"
            self._start(lambda: self._stream_rdt(udp, came[RDT]))
        for name, talk in lines.items():
            line = SerialPlayback(talk, self._stop, self.done)
            self.addresses[name] = line.path
            self._start(line.serve)
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        for one in self._sockets:
            one.close()
        for thread in self._threads:
            thread.join(2.0)

    def _listen(self, name: str, port: int, serve: Callable[[socket.socket], None]) -> None:
        server = socket.create_server((self._host, port))
        server.settimeout(_LOOK_S)
        self._sockets.append(server)
        self.addresses[name] = f"{self._host}:{port}"

        def accept() -> None:
            while not self._stop.is_set():
                try:
                    link, _ = server.accept()
                except TimeoutError:
                    continue
                except OSError:
                    return
                self._start(lambda link=link: _closing(link, serve))  # type: ignore[misc]

        self._start(accept)

    def _start(self, work: Callable[[], None]) -> None:
        thread = threading.Thread(target=work, name="playback", daemon=True)
        self._threads.append(thread)
        thread.start()

    def _stream_rdt(self, udp: socket.socket, datagrams: Sequence[Packet]) -> None:
        """Wait for a request to start, then send all datagrams as they came."""
        udp.settimeout(_LOOK_S)
        while not self._stop.is_set():
            try:
                data, client = udp.recvfrom(2048)
            except TimeoutError:
                continue
            except OSError:
                return
            if len(data) == 8 and struct.unpack(">HH4x", data)[1] in _RDT_START:
                with contextlib.suppress(OSError):
                    _play(datagrams, lambda d, to=client: udp.sendto(d, to), self._stop)  # type: ignore[misc]
                self.done.set()
                return


class _Rtde:
    """Answers of a controller as they came."""

    def __init__(
        self, came: Sequence[Packet], kept: Sequence[Packet], stop: threading.Event,
        done: threading.Event,
    ) -> None:  # fmt: skip
        self._stop, self._done = stop, done
        self._answers: dict[int, bytes] = {}
        self._states: list[Packet] = []
        for packet in _framed(came):
            kind = packet.data[2]
            if kind == _DATA:
                self._states.append(packet)
            else:
                self._answers.setdefault(kind, packet.data)
        asked = [p.data for p in _framed([p for p in kept if p.sent and p.peer == RTDE])]
        self._names = next((_names(d) for d in asked if d[2] == _OUTPUTS), ())

    def serve(self, link: socket.socket) -> None:
        """Answer one client until it has all states."""
        data = b""
        while not self._stop.is_set():
            part = link.recv(4096)
            if not part:
                return
            data += part
            while len(data) >= _HEAD.size and len(data) >= (size := _HEAD.unpack_from(data)[0]):
                request, data = data[:size], data[size:]
                link.sendall(self._reply(request))
                if request[2] == _START:
                    _play(self._states, link.sendall, self._stop)
                    self._done.set()
                    return

    def _reply(self, request: bytes) -> bytes:
        kind = request[2]
        if kind == _OUTPUTS and _names(request) != self._names:
            told = b"\x00" + ",".join(["NOT_FOUND"] * len(_names(request))).encode()
            return _HEAD.pack(_HEAD.size + len(told), kind) + told
        return self._answers.get(kind, _HEAD.pack(_HEAD.size + 1, kind) + b"\x00")


def _names(request: bytes) -> tuple[str, ...]:
    """Outputs of a request of protocol 2."""
    return tuple(n for n in request[11:].decode("latin-1").split(",") if n)


def _framed(chunks: Sequence[Packet]) -> list[Packet]:
    """Pieces of a stream as whole RTDE packets, each with the time of its last piece."""
    found, data = [], b""
    for chunk in chunks:
        data += chunk.data
        while len(data) >= _HEAD.size:
            size = _HEAD.unpack_from(data)[0]
            if size < _HEAD.size or len(data) < size:
                break
            found.append(chunk._replace(data=data[:size]))
            data = data[size:]
    return found


def _play(kept: Sequence[Packet], send: Callable[[bytes], object], stop: threading.Event) -> None:
    """Send packets at the times between them at which they came."""
    begun = time.monotonic()
    for packet in kept:
        wait = packet.t - kept[0].t - (time.monotonic() - begun)
        if wait > 0.0 and stop.wait(wait):
            return
        send(packet.data)


def _page(link: socket.socket, page: bytes) -> None:
    """The page for whoever asks by an address, not for a page elsewhere."""
    status, kind = "200 OK", "text/xml"
    try:
        with link.makefile("rb") as stream:
            asked = parse(read_head(stream))
        check_origin(asked, link.getsockname()[1], ("localhost",), addresses=True)
    except RefusedError as error:
        status, kind, page = error.status, "text/plain", f"{error.why}\n".encode()
    head = f"HTTP/1.0 {status}\r\nContent-Type: {kind}\r\nConnection: close\r\n"
    link.sendall(f"{head}Content-Length: {len(page)}\r\n\r\n".encode() + page)


def _closing(link: socket.socket, serve: Callable[[socket.socket], None]) -> None:
    with link, contextlib.suppress(OSError):
        serve(link)
