"""A worker process as the driver sees it: started under a deadline, commanded, and ended."""

import contextlib
import itertools
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
import weakref
from collections import deque
from pathlib import Path
from typing import Any

from wrenchbed.errors import LinkError
from wrenchbed.hardware.drivers.rtde.shared_state import SharedState
from wrenchbed.hardware.drivers.rtde.worker import Closed, Message, pair

_ROOT = str(Path(__file__).parents[4])
_POLL_S, _ANSWER_POLL_S = 0.01, 0.001
"""Time between two looks for the first event and for an answer [s]; estimates."""
_END_S = 5.0
"""Time that a killed process gets to end [s]; estimate."""


class Worker:
    """One process that uses ur_rtde.

    Args:
        kind: ``state`` or ``control``.
        setting: of the worker.
        shared: memory that it inherits.
    """

    def __init__(self, kind: str, setting: dict[str, Any], shared: SharedState) -> None:
        self.kind = kind
        self.wire, other = pair()
        self._lock = threading.Lock()
        self._ids = itertools.count(1)
        self._replies: dict[int, Message] = {}
        self.events: deque[Message] = deque(maxlen=16)
        self.refused = ""
        """Why the newest streamed target was refused."""
        self.program_ended = False
        self._why = ""
        with other:
            self._process = _spawn(kind, setting, shared, other)
        self._kill = weakref.finalize(self, _end, self._process)

    def wait_ready(self, deadline: float) -> Message:
        """The worker's first event; a worker without one by then is killed.

        Raises:
            LinkError: none came in time (`time.monotonic`, [s]).
        """
        begun = time.monotonic()
        while time.monotonic() < deadline:
            gone = self.gone()
            with self._lock:
                if self.events:
                    return self.events.popleft()
            if gone:
                raise LinkError(gone)
            time.sleep(_POLL_S)
        self.kill()
        waited = time.monotonic() - begun
        raise LinkError(f"the {self.kind} worker did not connect within {waited:.1f} s: killed")

    def send(self, do: str, **more: Any) -> bool:
        """Send a command that is not answered; whether it could be sent at once."""
        return self.wire.send({"do": do} | more)

    def ask(self, do: str, timeout: float, **more: Any) -> str:
        """Send a command; empty when it was done, else the reason.

        Raises:
            LinkError: the worker is gone or did not answer in time [s].
        """
        number = next(self._ids)
        if not self.wire.send({"do": do, "id": number} | more):
            raise LinkError(self.gone() or f"the {self.kind} worker takes no orders")
        end = time.monotonic() + timeout
        while True:
            gone = self.gone()
            with self._lock:
                reply = self._replies.pop(number, None)
            if reply is not None:
                return str(reply.get("why", ""))
            if gone:
                raise LinkError(gone)
            remaining = end - time.monotonic()
            if remaining <= 0.0:
                raise LinkError(f"the {self.kind} worker did not answer {do!r} in {timeout:g} s")
            time.sleep(min(remaining, _ANSWER_POLL_S))

    def gone(self) -> str:
        """Why the worker is gone; empty while it lives."""
        if self._why:
            return self._why
        code = self._process.poll()
        self._drain()
        if code is None:
            return ""
        for event in self.events:
            if event.get("event") in ("lost", "failed", "refused"):
                return f"the {self.kind} worker ended: {event.get('why')}"
        if code < 0:
            return f"the {self.kind} worker died by signal {-code} ({signal.Signals(-code).name})"
        return f"the {self.kind} worker ended with code {code}"

    def quit(self, timeout: float) -> None:
        """Ask it to end, kill it when it has not ended by then [s], and release it."""
        self.send("quit")
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout)
        self.kill()

    def kill(self, why: str = "") -> None:
        """End it at once, for a reason, and release it; may be called twice."""
        self._why = self._why or self.gone() or why
        self._kill()
        with self._lock:
            self.wire.close()

    def _drain(self) -> None:
        with self._lock, contextlib.suppress(Closed):
            while (message := self.wire.receive(0.0)) is not None:
                self._sort(message)

    def _sort(self, message: Message) -> None:
        number, event = message.get("id"), message.get("event")
        if number is not None:
            self._replies[number] = message
            while len(self._replies) > 8:  # answers that came after the deadline
                self._replies.pop(min(self._replies))
        elif event == "unsent":
            self.refused = str(message.get("why", ""))
        elif event == "ended":
            self.program_ended = True
        else:
            self.events.append(message)

    @property
    def pid(self) -> int:
        """Of the process."""
        return self._process.pid


def _spawn(
    kind: str, setting: dict[str, Any], shared: SharedState, other: socket.socket
) -> subprocess.Popen[bytes]:
    inherited = (shared.descriptor, other.fileno())
    arguments = json.dumps(setting | {"memory": inherited[0], "wire": inherited[1]})
    path = os.pathsep.join(p for p in (_ROOT, os.environ.get("PYTHONPATH", "")) if p)
    return subprocess.Popen(
        [sys.executable, "-P", "-m", "wrenchbed.hardware.drivers.rtde.worker", kind, arguments],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        pass_fds=inherited,
        process_group=0,
        env=os.environ | {"PYTHONPATH": path},
    )


def _end(process: subprocess.Popen[bytes]) -> None:
    if process.poll() is None:
        process.kill()
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(_END_S)
