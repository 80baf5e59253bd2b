"""A pseudo terminal that a client opens as a serial port, and what goes wrong on such a line.

It has a path that stays the same, as an adapter has one under /dev/serial/by-id. A client whose bit
rate is another than the device's gets and sends garbage.
"""

import contextlib
import os
import sys
import tempfile
import time
from asyncio import TimerHandle
from collections.abc import Callable
from pathlib import Path

import numpy as np

from robot_emulators.base import arguments
from robot_emulators.base.arguments import Argument
from robot_emulators.base.event_loop import LoopThread
from robot_emulators.base.faults import Faults, LinkFaults, TimedFault
from wrenchbed.errors import DriverError

if sys.platform == "linux":
    import fcntl
    import termios
    import tty

LINK = "serial"
"""Name of the link that has the faults."""
_SHARE = {"share": arguments.number(0.0, 1.0, 0.02)}
KINDS: dict[str, dict[str, Argument]] = {
    "lose": _SHARE, "flip": _SHARE, "garbage": _SHARE, "pieces": {}, "stall": {}, "unplug": {},
}  # fmt: skip
_CHUNK = 4096
_MOST_GARBAGE = 40


class SerialLine:
    """One end of a line; a client opens the other by `path`.

    Faults: ``lose`` a share of the bytes, ``flip`` a bit in a share of the messages, ``garbage``
    between a share of them, ``pieces``: each byte by itself, ``stall``: nothing is heard or sent,
    ``unplug``: the port is gone meanwhile.

    Args:
        thread: in whose loop clients are served.
        name: of the device.
        host: tells lines of several emulators apart.
        baud: at which the device speaks [bit/s].
        received: called with bytes of the client.
        faults: where those of this line are registered.
        more: kinds of faults that the device adds.
        seed: of faults that draw at random.
    """

    def __init__(
        self, thread: LoopThread, name: str, host: str, baud: int,
        received: Callable[[bytes], None], faults: Faults,
        more: dict[str, dict[str, Argument]], seed: int,
    ) -> None:  # fmt: skip
        self._thread, self._baud, self._received = thread, baud, received
        self.faults = LinkFaults(faults, LINK, KINDS | more)
        self.faults.at_once("unplug", self._unplug)
        self._random = np.random.default_rng([seed, baud])
        self.path = _folder() / f"{host}-{name}"
        self._lock = -1
        self._ends = (-1, -1)
        self._plug: TimerHandle | None = None
        self._piece = 0

    def open(self) -> None:
        """Make the terminal and its path.

        Raises:
            DriverError: another emulator has it, or this system has none.
        """
        if sys.platform != "linux":
            raise DriverError("serial lines are emulated on Linux only: run this twin there")
        self._lock = os.open(f"{self.path}.lock", os.O_RDWR | os.O_CREAT, 0o600)
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            os.close(self._lock)
            self._lock = -1
            raise DriverError(
                f"{self.path}: another twin serves it: end that one, or give another --host 127.x"
            ) from error
        self._connect()

    def close(self) -> None:
        """Close the terminal; only in the loop's thread, or when it has ended."""
        if self._plug is not None:
            self._plug.cancel()
        if self._lock >= 0:
            self._disconnect()
            os.close(self._lock)
        self._lock = -1

    def send(self, message: bytes) -> None:
        """Send a message as far as the line lets it through; only in the loop's thread."""
        end = self._ends[0]
        if end < 0 or self.faults.now("stall") is not None:
            return
        if self.faults.any:
            message = self._spoilt(message)
        if not self._agreed():
            message = self._random.bytes(len(message))
        with contextlib.suppress(OSError):  # a client that reads nothing loses bytes
            if self.faults.now("pieces") is None:
                os.write(end, message)
                return
            for k in range(len(message)):
                os.write(end, message[k : k + 1])

    def _spoilt(self, message: bytes) -> bytes:
        random = self._random
        if (one := self.faults.now("flip")) and random.random() < one["share"]:
            at = int(random.integers(len(message)))
            bit = 1 << int(random.integers(8))
            message = message[:at] + bytes([message[at] ^ bit]) + message[at + 1 :]
        if one := self.faults.now("lose"):
            message = bytes(b for b in message if random.random() >= one["share"])
        if (one := self.faults.now("garbage")) and random.random() < one["share"]:
            message += random.bytes(int(random.integers(1, _MOST_GARBAGE)))
        return message

    def _agreed(self) -> bool:
        """Whether the client speaks at the device's bit rate."""
        return bool(termios.tcgetattr(self._ends[1])[4] == getattr(termios, f"B{self._baud}"))

    def _connect(self) -> None:
        device, client = os.openpty()
        tty.setraw(client)
        os.set_blocking(device, False)
        self._ends = (device, client)
        self.path.unlink(missing_ok=True)
        self.path.symlink_to(os.ttyname(client))
        self._thread.soon(lambda: self._thread.loop.add_reader(device, self._listen, device))

    def _disconnect(self) -> None:
        device, client = self._ends
        self._ends = (-1, -1)
        if device < 0:
            return
        self.path.unlink(missing_ok=True)
        if self._thread.inside:
            self._thread.loop.remove_reader(device)
        os.close(device)
        os.close(client)

    def _listen(self, device: int) -> None:
        try:
            data = os.read(device, _CHUNK)
        except OSError:
            return
        if self.faults.now("stall") is None:
            self._received(data if self._agreed() else self._random.bytes(len(data)))

    def _unplug(self, fault: TimedFault) -> None:
        until = time.monotonic() + fault.seconds if fault.seconds else float("inf")
        self._thread.soon(lambda: self._pull(until))

    def _pull(self, until: float) -> None:
        self._disconnect()
        if until != float("inf"):
            self._plug = self._thread.loop.call_at(until, self._connect)


def _folder() -> Path:
    """Where the paths of this user's lines are.

    Raises:
        DriverError: somebody else made it.
    """
    folder = Path(tempfile.gettempdir()) / f"wrenchbed-{os.getuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    found = folder.lstat()
    if found.st_uid != os.getuid() or folder.is_symlink() or found.st_mode & 0o022:
        raise DriverError(f"{folder}: is not this user's alone: remove it, or set TMPDIR")
    return folder
