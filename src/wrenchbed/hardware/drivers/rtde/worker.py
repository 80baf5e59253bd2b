"""Entry point of both workers, and their messages: JSON objects over a pair of local sockets.

``python -m wrenchbed.hardware.drivers.rtde.worker state|control …``. A worker always ends by
`os._exit`: destructors of ur_rtde throw after the controller died, which would abort the process.
Only the standard library is imported, so that workers start quickly.
"""

import contextlib
import json
import os
import select
import signal
import socket
import sys
import threading
from collections import deque
from collections.abc import Callable
from importlib import import_module
from typing import Any

from wrenchbed.hardware.drivers.rtde.shared_state import SharedState

Message = dict[str, Any]
_LONGEST = 4096
"""Bytes of the longest message; the longest sent have some hundred."""
_MS = 1e3  # by definition
_PRIORITY = -10
"""Nice value of the workers: before other programs, behind real-time ones."""
LOST = 3
"""Exit code of a worker that lost the controller."""
_LOSS = ("Could not receive data", "Lost connection", "Reconnecting", "closed the connection")
"""What ur_rtde prints before it reconnects by itself, which ends in a crash."""


class Closed(Exception):  # noqa: N818
    """The other end is gone."""


class MessageChannel:
    """One end of a channel that keeps the borders and the order of messages."""

    def __init__(self, end: socket.socket) -> None:
        self._end = end
        self._end.setblocking(False)
        self._poll = select.poll()
        self._poll.register(end.fileno(), select.POLLIN)

    @classmethod
    def of(cls, descriptor: int) -> "MessageChannel":
        """The end that a process inherited."""
        return cls(socket.socket(fileno=descriptor))

    def send(self, message: Message) -> bool:
        """Send at once; False where the other end does not take it."""
        with contextlib.suppress(OSError):
            self._end.send(json.dumps(message).encode()[:_LONGEST])
            return True
        return False

    def receive(self, timeout: float) -> Message | None:
        """The next message; None if there is none in time [s].

        Raises:
            Closed: the other end is gone.
        """
        try:
            if not self._poll.poll(max(0.0, timeout) * _MS):
                return None
            raw = self._end.recv(_LONGEST)
        except BlockingIOError:
            return None
        except (OSError, ValueError) as error:
            raise Closed(str(error)) from error
        if not raw:
            raise Closed("closed")
        return dict(json.loads(raw))

    def close(self) -> None:
        """Release it; may be called twice."""
        self._end.close()


def pair() -> tuple[MessageChannel, socket.socket]:
    """One end for this process, and the other for a child to inherit."""
    mine, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    return MessageChannel(mine), other


class Printed:
    """Lines that the library prints in this process; one that reports a loss calls back."""

    def __init__(self, lost: Callable[[str], None]) -> None:
        self.lines: deque[str] = deque(maxlen=8)
        self._lost = lost
        out, into = os.pipe()
        for standard in (1, 2):
            os.dup2(into, standard)
        os.close(into)
        threading.Thread(target=self._read, args=(out,), daemon=True).start()

    def _read(self, out: int) -> None:
        with os.fdopen(out, "r", errors="replace") as lines:
            for line in lines:
                self.lines.append(line.strip())
                if any(sign in line for sign in _LOSS):
                    self._lost(line.strip())


def end_process(wire: MessageChannel, event: str, why: str, code: int) -> None:
    """Report to the driver why this process ends, and end it."""
    wire.send({"event": event, "why": why})
    os._exit(code)


def cause(error: BaseException) -> str:
    """An exception's message on one line."""
    return " ".join(str(error).split()) or type(error).__name__


def main(arguments: list[str]) -> None:
    """Run a worker: its kind, then its setting as JSON."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with contextlib.suppress(OSError):  # where the system allows it
        os.setpriority(os.PRIO_PROCESS, 0, _PRIORITY)
    kind, setting = arguments[0], dict[str, Any](json.loads(arguments[1]))
    shared, wire = SharedState(setting["memory"]), MessageChannel.of(setting["wire"])
    try:
        run = import_module(f"wrenchbed.hardware.drivers.rtde.{kind}_worker").run
        run(setting, shared, wire)
    except BaseException as error:
        end_process(wire, "failed", cause(error), 1)
    os._exit(0)


if __name__ == "__main__":
    main(sys.argv[1:])
