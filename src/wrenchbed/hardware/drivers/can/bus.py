"""A CAN bus of python-can with one reader that passes frames on and detects a lost bus. If a
socketcand server dies, python-can receives nothing at full speed for ever; if one is silent,
python-can's constructor waits for ever. Both are detected here."""

import contextlib
import errno
import logging
import socket
import struct
import threading
import time
from collections.abc import Callable
from typing import Any

from wrenchbed.errors import DriverError, LinkError
from wrenchbed.registry import require

Listener = Callable[[float, int, bytes], None]
"""Called with the time of arrival (`time.monotonic` [s]), an 11-bit CAN id and the frame's data."""
OPENING_S = 3.0
"""Deadline of a socketcand server's answer [s]: one on the same network answers within 0.1 s."""
_WAIT_S, _SEND_S, _AGAIN_S = 0.02, 0.05, 5e-4
"""Longest wait for a frame, after which a server that hung up is noticed; longest wait for sending,
the drives' usual watchdog; pause while the transmit queue is full, five frames at 1 Mbit/s [s]."""


class CanLink:
    """An open CAN bus of python-can, with one reader thread.

    Attributes:
        dead: reason why no frame will come any more, empty while the bus works.
        error_frames: number of error frames received.
        full: number of attempts to send that the kernel's full transmit queue refused.
        failures: number of exceptions of listeners, which do not affect other listeners.
    """

    def __init__(self, bus: Any) -> None:
        can = require("can", "hil")
        self._message = can.Message
        self._refused: tuple[type[Exception], ...] = (OSError, ValueError, can.CanError)
        self._bus = bus
        self.dead = ""
        self.error_frames = self.failures = self.full = 0
        self._listeners: tuple[Listener, ...] = ()
        self._lock = threading.Lock()
        self._running = True
        self._socket: socket.socket | None = getattr(bus, "_SocketCanDaemonBus__socket", None)
        if self._socket is not None:
            limit = struct.pack("ll", 0, int(_SEND_S * 1e6))
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, limit)
        self._thread = threading.Thread(target=self._run, name="can reader", daemon=True)
        self._thread.start()

    def listen(self, heard: Listener) -> None:
        """Register ``heard(t, id, data)``, which the reader thread calls for each data frame."""
        self._listeners = (*self._listeners, heard)

    def leave(self, heard: Listener) -> None:
        """Unregister a function ``heard`` that `listen` has registered."""
        self._listeners = tuple(one for one in self._listeners if one != heard)

    def send(self, can_id: int, data: bytes) -> None:
        """Send a data frame; a `LinkError` if the bus is gone or its transmit queue stays full."""
        if self.dead:
            raise LinkError(f"CAN bus: {self.dead}")
        message = self._message(arbitration_id=can_id, data=data, is_extended_id=False)
        end = time.monotonic() + _SEND_S
        while True:
            try:
                with self._lock:
                    self._bus.send(message, timeout=_SEND_S)
                return
            except self._refused as error:
                code = getattr(error, "error_code", None) or getattr(error, "errno", None)
                if code != errno.ENOBUFS or time.monotonic() > end:  # else the bus is busy
                    self.dead = self.dead or f"it takes no frames: {error}"
                    raise LinkError(f"CAN bus: {self.dead}") from error
            self.full += 1
            time.sleep(_AGAIN_S)

    def close(self) -> None:
        """Stop reading and release the bus; may be called twice."""
        if not self._running:
            return
        self._running = False
        if threading.current_thread() is not self._thread:
            self._thread.join(2.0)
        self.dead = self.dead or "it was closed"
        with contextlib.suppress(*self._refused):
            self._bus.shutdown()

    def _run(self) -> None:
        while self._running and not self.dead:
            try:
                message = self._bus.recv(_WAIT_S)
            except Exception as error:
                self.dead = f"it cannot be read: {' '.join(str(error).split())[:80]}"
                return
            if message is None:
                if _ended(self._socket):
                    self.dead = "its server closed the connection"
            elif message.is_error_frame:
                self.error_frames += 1
            elif not message.is_remote_frame and not message.is_extended_id:
                now, data = time.monotonic(), bytes(message.data)
                for heard in self._listeners:
                    try:
                        heard(now, message.arbitration_id, data)
                    except Exception:
                        self.failures += 1


def open_bus(interface: str, channel: str, host: str, port: int, bitrate: int) -> CanLink:
    """Open a bus: socketcand if a host is given, else python-can's ``interface`` or, if that is
    empty, SocketCAN. Raises a `LinkError` if it does not exist or does not answer within
    `OPENING_S`, a `MissingExtraError` if python-can is not installed."""
    can = require("can", "hil")
    logging.getLogger("can").addHandler(logging.NullHandler())
    kind = interface or ("socketcand" if host else "socketcan")
    words: dict[str, Any] = {"interface": kind, "channel": channel}
    if kind == "socketcand":
        if not host:
            raise DriverError("interface socketcand needs a host")
        _check_server(host, port, channel)
        words |= {"host": host, "port": port, "tcp_tune": True}
    elif kind not in ("socketcan", "virtual"):
        words["bitrate"] = bitrate
    try:
        return CanLink(can.Bus(**words))
    except Exception as error:
        where = f"{kind}:{host}:{port}:{channel}" if host else f"{kind}:{channel}"
        raise LinkError(f"cannot open {where}: {' '.join(str(error).split())[:120]}") from error


def _check_server(host: str, port: int, channel: str) -> None:
    """Raise `LinkError` unless a socketcand server opens bus ``channel`` within a deadline."""
    where = f"CAN server at {host}:{port}"
    try:
        with socket.create_connection((host, port), OPENING_S) as trial:
            greeting = trial.recv(64)
            trial.sendall(f"< open {channel} >".encode())
            answer = trial.recv(64) if greeting == b"< hi >" else b""
    except TimeoutError as error:
        raise LinkError(f"{where} does not answer within {OPENING_S:g} s") from error
    except (OSError, ValueError) as error:
        raise LinkError(f"no {where}: {error}; give its address, and start it first") from error
    if greeting != b"< hi >":
        raise LinkError(f"{where} answers {greeting[:20]!r}: it does not speak socketcand")
    if answer != b"< ok >":
        raise LinkError(f"{where} has no bus {channel!r}: give the channel that it serves")


def _ended(connection: socket.socket | None) -> bool:
    if connection is None:
        return False
    try:
        return connection.recv(1, socket.MSG_PEEK | socket.MSG_DONTWAIT) == b""
    except BlockingIOError:
        return False
    except OSError:
        return True
