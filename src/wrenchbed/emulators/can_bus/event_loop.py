"""What is to be done in the hub's thread, soon or at a time; given from any thread.

Wakes a thread that waits for sockets, from another thread.

The socket at which a hub takes its clients.
"""

import contextlib
import heapq
import socket
from collections import deque
from collections.abc import Callable

from wrenchbed.errors import DriverError


class Wakeup:
    """A pair of sockets: ring one, and whoever selects `ear` wakes up."""

    def __init__(self) -> None:
        self._rope, self.ear = socket.socketpair()
        self._rope.setblocking(False)
        self.ear.setblocking(False)

    def ring(self) -> None:
        """Wake it; many rings are as good as one."""
        with contextlib.suppress(OSError):
            self._rope.send(b"!")

    def heard(self, _: object = None) -> None:
        """Be ready for the next ring."""
        with contextlib.suppress(OSError):
            self.ear.recv(4096)

    def close(self) -> None:
        """No further ring."""
        self._rope.close()
        self.ear.close()


def listening(host: str, port: int, clients: int) -> socket.socket:
    """A socket that waits for clients and does not block.

    Raises:
        DriverError: the port is taken or not allowed.
    """
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, port))
    except OSError as error:
        listener.close()
        raise DriverError(
            f"cannot serve CAN at {host}:{port}: {error.strerror}; "
            "end the other server or give another host or port"
        ) from error
    listener.listen(clients)
    listener.setblocking(False)
    return listener


Order = Callable[[], None]


class Orders:
    """A queue and a calendar.

    Args:
        failed: told every exception of an order; the next ones are done all the same.
    """

    def __init__(self, failed: Callable[[Exception], None]) -> None:
        self._failed = failed
        self._soon: deque[Order] = deque(maxlen=256)
        self._planned: list[tuple[float, int, Order]] = []
        self._number = 0

    def add(self, what: Order) -> None:
        """Do something soon."""
        self._soon.append(what)

    def plan(self, t: float, what: Order) -> None:
        """Do something at a time [s]."""
        self.add(lambda: self._enter(t, what))

    def wait(self, now: float) -> float | None:
        """How long there is nothing to do [s], None where nothing is planned."""
        if self._soon:
            return 0.0
        return max(0.0, self._planned[0][0] - now) if self._planned else None

    def do(self, now: float) -> None:
        """Do what is due; only the hub's thread calls it."""
        while self._planned and self._planned[0][0] <= now:
            self.add(heapq.heappop(self._planned)[2])
        while self._soon:
            try:
                self._soon.popleft()()
            except Exception as error:
                self._failed(error)

    def _enter(self, t: float, what: Order) -> None:
        self._number += 1
        heapq.heappush(self._planned, (t, self._number, what))
