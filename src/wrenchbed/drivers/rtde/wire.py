"""Messages between the driver and a worker: JSON objects over a pair of local sockets.

Only the standard library, since the workers import this.
"""

import contextlib
import json
import select
import socket
from typing import Any

Message = dict[str, Any]
_LONGEST = 4096


class Closed(Exception):  # noqa: N818
    """The other end is gone."""


class Wire:
    """One end. Messages keep their borders and order."""

    def __init__(self, end: socket.socket) -> None:
        self._end = end
        self._end.setblocking(False)
        self._poll = select.poll()
        self._poll.register(end.fileno(), select.POLLIN)

    @classmethod
    def of(cls, descriptor: int) -> "Wire":
        """The end that a process inherited."""
        return cls(socket.socket(fileno=descriptor))

    def send(self, message: Message) -> bool:
        """Send at once, or say that the other end does not take it."""
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
            if not self._poll.poll(max(0.0, timeout) * 1e3):
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
        """Let go of it; may be called twice."""
        self._end.close()


def pair() -> tuple[Wire, socket.socket]:
    """One end for this process, and the other for a child to inherit."""
    mine, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    return Wire(mine), other
