"""A serial port of this machine: 8N1 without flow control, by the system's own termios.

Every failure is a `LinkError` that names the port and what to do.
"""

import contextlib
import errno
import os
import select
import struct
import sys
import time

from wrenchbed.errors import DriverError, LinkError
from wrenchbed.hardware.packet_capture.capture import Capture

if sys.platform == "linux":
    import fcntl
    import termios

_CHUNK = 4096
"""Bytes that are read at a time; estimate."""
_WRITE_S = 1.0
"""Longest that a port may take no bytes [s]; estimate."""
_GET_SERIAL, _SET_SERIAL = 0x541E, 0x541F
"""TIOCGSERIAL and TIOCSSERIAL; source: Linux, include/uapi/asm-generic/ioctls.h."""
_SERIAL_STRUCT, _FLAGS_AT = 128, 16
"""Room for struct serial_struct, and where its flags are [bytes]; source: Linux, tty_flags.h."""
_LOW_LATENCY = 1 << 13
"""ASYNC_LOW_LATENCY: USB adapters pass bytes on at once instead of each 16 ms; as above."""
_REMEDIES = {
    errno.ENOENT: "there is no such port: plug the sensor in and look at /dev/serial/by-id",
    errno.ENXIO: "nothing is behind it: plug the sensor's adapter in again",
    errno.ENODEV: "nothing is behind it: plug the sensor's adapter in again",
    errno.EACCES: "you may not use it: sudo usermod -aG dialout $USER, then log in again",
    errno.EPERM: "you may not use it: sudo usermod -aG dialout $USER, then log in again",
    errno.EBUSY: "another program uses it: end that program",
    errno.EISDIR: "is a folder: give the port itself, for instance /dev/ttyUSB0",
}


class SerialPort:
    """An open port; use from one thread at a time, `write` from any.

    Args:
        path: of the port, for instance ``/dev/ttyUSB0``.
        baud: of the line [bit/s].
        capture: where bytes are kept, under the peer's name.
        peer: name of the line in kept packets.

    Raises:
        DriverError: this system has no termios as Linux has.
        LinkError: the port cannot be opened; names it and the remedy.
    """

    def __init__(
        self, path: str, baud: int, capture: Capture | None = None, peer: str = "serial"
    ) -> None:
        if sys.platform != "linux":
            raise DriverError(
                f"{path}: sensors on a serial line are read on Linux only: run wrenchbed there"
            )
        self.path, self._capture, self._peer = path, capture, peer
        try:
            self._fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        except OSError as error:
            raise LinkError(f"{path}: {_REMEDIES.get(error.errno or 0, error.strerror)}") from error
        try:
            self._lock()
            self._set_up(baud)
        except BaseException:
            os.close(self._fd)
            raise
        self._poll = select.poll()
        self._poll.register(self._fd, select.POLLIN)

    def close(self) -> None:
        """Release the port; may be called twice."""
        if self._fd >= 0:
            os.close(self._fd)
        self._fd = -1

    def read(self, seconds: float) -> bytes:
        """What has come, after waiting for it at most some seconds; empty if nothing has.

        Raises:
            LinkError: the port is gone.
        """
        if not self._poll.poll(1e3 * max(0.0, seconds)):
            return b""
        try:
            data = os.read(self._fd, _CHUNK)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise self._gone() from error
        if not data:
            raise self._gone()
        if self._capture is not None:
            self._capture.add(self._peer, data)
        return data

    def write(self, data: bytes) -> None:
        """Send bytes.

        Raises:
            LinkError: the port is gone, or takes nothing.
        """
        if self._capture is not None:
            self._capture.add(self._peer, data, sent=True)
        end = time.monotonic() + _WRITE_S
        while data:
            try:
                data = data[os.write(self._fd, data) :]
            except BlockingIOError:
                if time.monotonic() > end:
                    raise LinkError(f"{self.path}: takes no bytes: check the adapter") from None
                time.sleep(1e-3)
            except OSError as error:
                raise self._gone() from error

    def drain(self) -> None:
        """Drop what has come and was not read."""
        with contextlib.suppress(OSError, ValueError):
            termios.tcflush(self._fd, termios.TCIFLUSH)

    def quiet(self, pause: float, seconds: float) -> bool:
        """Drop what comes until nothing came for a pause [s]; False if it does not end [s].

        Raises:
            LinkError: the port is gone.
        """
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            if not self.read(pause):
                return True
        return False

    def _lock(self) -> None:
        try:
            fcntl.flock(self._fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise LinkError(f"{self.path}: {_REMEDIES[errno.EBUSY]}") from error

    def _set_up(self, baud: int) -> None:
        try:
            found = termios.tcgetattr(self._fd)
            speed = getattr(termios, f"B{baud}")
            flags = termios.CS8 | termios.CREAD | termios.CLOCAL
            characters = list(found[6])
            characters[termios.VMIN] = characters[termios.VTIME] = 0
            raw = [0, 0, flags, 0, speed, speed, characters]
            termios.tcsetattr(self._fd, termios.TCSANOW, raw)
            termios.tcflush(self._fd, termios.TCIOFLUSH)
            set_to = termios.tcgetattr(self._fd)
        except termios.error as error:
            raise LinkError(
                f"{self.path}: is no serial port ({error.args[-1]}): give the sensor's, for "
                "instance /dev/ttyUSB0"
            ) from error
        if set_to[4:6] != [speed, speed]:
            raise LinkError(f"{self.path}: its adapter cannot do {baud} bit/s: use another adapter")
        self._hurry()

    def _hurry(self) -> None:
        """Ask a USB adapter to pass on bytes at once, where it can."""
        with contextlib.suppress(OSError):
            held = bytearray(_SERIAL_STRUCT)
            fcntl.ioctl(self._fd, _GET_SERIAL, held)
            (flags,) = struct.unpack_from("i", held, _FLAGS_AT)
            struct.pack_into("i", held, _FLAGS_AT, flags | _LOW_LATENCY)
            fcntl.ioctl(self._fd, _SET_SERIAL, held)

    def _gone(self) -> LinkError:
        return LinkError(
            f"{self.path}: the port is gone: the cable or its adapter was unplugged; plug it in "
            "and connect again"
        )
