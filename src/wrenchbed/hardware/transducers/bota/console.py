"""Commands to the sensor, and what it says when it boots.

A command is some text without an end of line; the answer is ``r,0,X,0``, where X is the command's
first letter and the last number 0 unless it is refused. Sources: the maker's ROS driver
(rokubimini_serial) and Python example.
"""

import re
import time

from wrenchbed.errors import DriverError, LinkError
from wrenchbed.hardware.transducers.serial_line.port import SerialPort

CONFIGURE, RUN, RESET = "C", "R", "#"
_ANSWER_S, _TRIES = 0.5, 3
"""Deadline of an answer [s] and attempts; estimates."""
_BOOT_S, _BOOTED_S = 3.0, 0.5
"""Longest time until the sensor begins to boot again, and until it has said all [s]; the second
source: the maker's Python example, the first an estimate."""
_BANNER = b"App Init"
_LINES = {
    "product": re.compile(rb"name:\s*([ -~]+)"),
    "serial": re.compile(rb"S/N:\s*([ -~]+)"),
    "firmware": re.compile(rb"FW version:\s*([ -~]+)"),
}
_MOST = 1 << 16
"""Bytes that are looked through for an answer; estimate."""


class NoAnswerError(LinkError):
    """The sensor is silent."""


class Console:
    """Speaks to the sensor.

    Args:
        port: the open line.
    """

    def __init__(self, port: SerialPort) -> None:
        self._port = port
        self.came = 0
        """Bytes that came instead of an answer."""

    def boot(self) -> dict[str, str]:
        """Start the sensor anew; what it says of itself, empty where it says nothing."""
        self._port.drain()
        self._port.write(RESET.encode())
        data = self._until(_BANNER, _BOOT_S)
        if _BANNER not in data:
            self.came += len(data)
            return {}
        data += self._until(b"FW version:", _BOOTED_S)
        data += self._until(b"\n", _BOOTED_S)
        found = {name: line.search(data) for name, line in _LINES.items()}
        return {name: one[1].decode().strip() for name, one in found.items() if one}

    def ask(self, command: str) -> None:
        """Send a command and wait until it is confirmed.

        Raises:
            NoAnswerError: it is not.
            DriverError: the sensor refuses it.
        """
        done = f"r,0,{command[0]},".encode()
        for _ in range(_TRIES):
            self._port.drain()
            self._port.write(command.encode())
            data = self._until(done, _ANSWER_S, more=1)
            if done in data:
                code = data[data.index(done) + len(done) :][:1]
                if code == b"0":
                    return
                raise DriverError(f"refuses {command!r} with code {code.decode('latin-1')}")
            self.came += len(data)
        raise NoAnswerError(f"does not answer to {command!r}")

    def _until(self, wanted: bytes, seconds: float, more: int = 0) -> bytes:
        """What comes until some bytes did, and so many more, within some time [s]."""
        data, end = b"", time.monotonic() + seconds
        while (remaining := end - time.monotonic()) > 0.0 and len(data) < _MOST:
            data += self._port.read(remaining)
            at = data.find(wanted)
            if at >= 0 and len(data) >= at + len(wanted) + more:
                break
        return data
