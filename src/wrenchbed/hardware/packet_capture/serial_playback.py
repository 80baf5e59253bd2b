"""A kept serial line played to a driver again, over a pseudo terminal.

The sensor answers each request as it did, after the same time; where a request was made several
times, the next answer that was kept is given, and after the last the first again. A request that
was not kept is not answered.
"""

import contextlib
import os
import select
import sys
import threading
import time
from collections.abc import Sequence

from wrenchbed.errors import RecordingError
from wrenchbed.hardware.packet_capture.capture import Packet

if sys.platform == "linux":
    import tty

_LOOK_S = 0.05
"""Longest wait for a request [s]; estimate."""
_CHUNK = 4096
"""Bytes that are read at a time, and kept while no request is in them; estimate."""


class SerialPlayback:
    """Serves one line.

    Attributes:
        path: of the port that a driver opens.

    Args:
        talk: packets of the line, both directions, as they came.
        stop: set when it is to end.
        done: set when the last packet was played.

    Raises:
        RecordingError: this system has no pseudo terminals as Linux has.
    """

    def __init__(
        self, talk: Sequence[Packet], stop: threading.Event, done: threading.Event
    ) -> None:
        if sys.platform != "linux":
            raise RecordingError("a kept serial line is played on Linux only: run replay there")
        self._talk, self._stop, self._done = talk, stop, done
        self._device, self._client = os.openpty()
        tty.setraw(self._client)
        os.set_blocking(self._device, False)
        self.path = os.ttyname(self._client)
        self._at: int | None = None
        self._last = -1
        self._behind = 0.0
        self._held = b""

    def serve(self) -> None:
        """Answer until the end is asked for, then close the port."""
        poll = select.poll()
        poll.register(self._device, select.POLLIN)
        while not self._stop.is_set():
            wait = _LOOK_S if self._at is None else self._due(self._at) - time.monotonic()
            if poll.poll(1e3 * min(max(wait, 0.0), _LOOK_S)):
                self._listen()
            self._play()
        os.close(self._device)
        os.close(self._client)

    def _due(self, at: int) -> float:
        return self._talk[at].t + self._behind

    def _listen(self) -> None:
        with contextlib.suppress(OSError):
            self._held = (self._held + os.read(self._device, _CHUNK))[-_CHUNK:]
        while (found := self._request()) is not None:
            self._last, self._at = found, found + 1
            self._behind = time.monotonic() - self._talk[found].t

    def _request(self) -> int | None:
        """The next request that was kept and has come again; its bytes are taken."""
        n = len(self._talk)
        for k in range(1, n + 1):
            packet = self._talk[(self._last + k) % n]
            if packet.sent and packet.data in self._held:
                self._held = self._held.partition(packet.data)[2]
                return (self._last + k) % n
        return None

    def _play(self) -> None:
        while self._at is not None:
            if self._at >= len(self._talk):
                self._at = None
                self._done.set()
            elif self._talk[self._at].sent:
                self._finish(self._at)
            elif self._due(self._at) > time.monotonic():
                return
            else:
                with contextlib.suppress(OSError):  # nobody reads
                    os.write(self._device, self._talk[self._at].data)
                self._at += 1

    def _finish(self, at: int) -> None:
        """Wait for the request at a place; with nothing but requests behind it all is played."""
        self._at = None
        if all(packet.sent for packet in self._talk[at:]):
            self._done.set()
