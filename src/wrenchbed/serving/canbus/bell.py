"""Wakes a thread that waits for sockets, from another thread."""

import contextlib
import socket


class Bell:
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
