"""Connection to one UR robot: its options, the driver's heartbeat, and the two worker processes.

Workers are started with retries within a deadline, and replaced when they fail.
"""

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
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from wrenchbed import registry
from wrenchbed.errors import DriverError, LinkError, ParameterError, StoppedError
from wrenchbed.hardware.device import STALE_S, wait_until
from wrenchbed.hardware.drivers.rtde.outputs import NATIVE_HZ
from wrenchbed.hardware.drivers.rtde.shared_state import SharedState
from wrenchbed.hardware.drivers.rtde.worker import Closed, Message, pair
from wrenchbed.robots.motion_limits import Limits

PERIOD_S = 0.05
"""Period of the driver's heartbeat [s], a tenth of `control_worker.DRIVER_SILENT_S`."""
_JOINTS = 6
"""Of every UR robot."""
_FIRST_PAUSE_S = 0.1
"""Pause before the second attempt [s]; it doubles each time."""
_FRESH_S = 1.0
"""Time within which a connected worker must deliver a state [s], a hundred cycles."""
_LEAST_S = 1.0
"""Time that must remain for another attempt [s], in which a worker can start and connect."""
_LOOK = "check --host, power, cable, and that nothing blocks TCP 30004"
"""What to check when the robot cannot be reached."""
_REFUSALS: tuple[tuple[str, type[DriverError], str, bool], ...] = (
    ("already in use", DriverError, "another client controls this robot: close it", True),
    (
        "remote control",
        StoppedError,
        "the robot is in local control: switch it to remote control at its pendant",
        False,
    ),
    (
        "start control script",
        StoppedError,
        "the robot does not start the program that it was sent: look at its pendant",
        False,
    ),
)
"""Text of a worker, the error to raise, its message, and whether another attempt may help."""
_ROOT = str(Path(__file__).parents[4])
_POLL_S, _ANSWER_POLL_S = 0.01, 0.001
"""Time between two looks for the first event and for an answer [s]; a stop must not wait longer."""
_END_S = 5.0
"""Time that a killed process gets to end [s]; it ends at once unless the kernel is stuck."""


class Pulse:
    """The driver's heartbeat in shared memory; without it the control worker stops the robot."""

    def __init__(self, shared: SharedState) -> None:
        self._shared, self._stopped = shared, threading.Event()
        self._thread = threading.Thread(target=self._run, name="rtde-pulse", daemon=True)
        shared.beat("driver")
        self._thread.start()

    def stop(self) -> None:
        """End the heartbeat; may be called twice."""
        self._stopped.set()
        self._thread.join(1.0)

    def _run(self) -> None:
        while not self._stopped.wait(PERIOD_S):
            self._shared.beat("driver")


@dataclass(frozen=True)
class RtdeOptions:
    """Where the robot is and how it is used.

    Attributes:
        robot: registry name.
        host: address of the robot's controller; its ports are fixed (30004, 30003, 29999).
        sensor: empty or ``netft`` for a Net F/T at the robot's host,
            ``netft://HOST[:PORT][?http=PORT]`` for one elsewhere, ``rtde`` for the robot's own
            wrench.
        frequency: of states and of streamed targets [Hz]; None: the controller's own, 125 Hz on a
            CB3 and 500 Hz on an e-Series.
        watchdog_hz: the robot stops its program when it hears nothing for 1/watchdog_hz [Hz].
        limits: of its motion; a quarter of top speed anywhere if None.
        power_on: whether `activate` may switch the robot on and release its brakes.
        connect_s: deadline of `connect` and of each reconnection [s].
        attempts: how often a link is tried within that deadline.
        effort: ``current``: recordings keep motor currents i1… [A], and what the controller wants
            of its joints; ``off``: neither. A UR robot reports no joint torques.
        recoveries: how often `recover` may be called between `connect` and `close`.
    """

    robot: str = "ur5"
    host: str = ""
    sensor: str = ""
    frequency: float | None = 125.0
    watchdog_hz: float = 10.0
    limits: Limits | None = None
    power_on: bool = False
    connect_s: float = 8.0
    attempts: int = 5
    recoveries: int = 100
    effort: str = "current"

    def __post_init__(self) -> None:
        """Refuse what no controller can do."""
        units = [joint.unit for joint in registry.load("robots", self.robot).joints]
        if units != ["rad"] * _JOINTS:
            raise ParameterError(
                f"driver 'rtde' moves UR robots, which have six hinges, not {self.robot!r}: "
                "give another"
            )
        if self.frequency is not None and not 1.0 <= self.frequency <= 500.0:
            raise ParameterError(f"frequency {self.frequency:g} Hz must be from 1 to 500 Hz")
        if self.effort not in ("current", "off"):
            raise ParameterError(
                f"effort {self.effort!r}: a UR robot reports the currents of its motors, no "
                "torques: give current or off"
            )
        if not 1.0 <= self.watchdog_hz <= 50.0:
            raise ParameterError(f"watchdog_hz {self.watchdog_hz:g} Hz must be from 1 to 50 Hz")
        if not self.connect_s > 0.0 or self.attempts < 1 or self.recoveries < 0:
            raise ParameterError("connect_s and attempts must be above 0, recoveries at least 0")


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


class Links:
    """Shared memory, heartbeat and state worker of one robot; starts control workers."""

    def __init__(self, options: RtdeOptions) -> None:
        self.shared = SharedState.create()
        self.restarts = 0
        self._options = options
        self._pulse = Pulse(self.shared)
        self._state: Worker | None = None

    def open_state(self) -> None:
        """Start receiving states.

        Raises:
            LinkError: the robot cannot be reached within the deadline.
            DriverError: its answer cannot be used.
        """
        begun = time.monotonic()
        self._state = self._open("state", {})

        def fresh() -> bool:
            state = self.shared.read()
            return (state is not None and state.t >= begun) or bool(self.state_gone())

        if not wait_until(fresh, _FRESH_S) or self.state_gone():
            gone = self.state_gone()
            raise LinkError(gone or f"{self._options.host}: the controller sends no states")

    def renew_state(self) -> None:
        """Replace a state worker that delivers no fresh states.

        Raises:
            LinkError: the robot cannot be reached within the deadline.
            DriverError: its answer cannot be used.
        """
        state = self.shared.read()
        silent = state is None or time.monotonic() - state.t > STALE_S or state.back > 0.0
        if not silent and not self.state_gone():
            return
        if self._state is not None:
            self._state.kill()
        self.restarts += 1
        self.open_state()

    def state_gone(self) -> str:
        """Why the state worker is gone; empty while it lives."""
        return self._state.gone() if self._state else "the state worker was not started"

    def open_control(self) -> Worker:
        """A worker that controls the robot, with the robot's watchdog on.

        Raises:
            StoppedError: the robot does not take a program.
            DriverError: someone else controls it.
            LinkError: it cannot be reached within the deadline.
        """
        state = self.shared.read()
        native = NATIVE_HZ[state is not None and state.major > 3]
        period = 1.0 / (self._options.frequency or native)
        more = {"watchdog_hz": self._options.watchdog_hz, "period": period}
        return self._open("control", more)

    def close(self) -> None:
        """End the state worker; may be called twice."""
        if self._state is not None:
            self._state.kill()
        self._state = None
        self._pulse.stop()
        self.shared.close()

    def _open(self, kind: str, more: dict[str, Any]) -> Worker:
        options = self._options
        setting = {
            "host": options.host, "frequency": options.frequency,
            "alarm": int(options.connect_s) + 2,
        }  # fmt: skip
        deadline, pause = time.monotonic() + options.connect_s, _FIRST_PAUSE_S
        failure: DriverError | None = None
        for _ in range(options.attempts):
            worker = Worker(kind, setting | more, self.shared)
            try:
                event = worker.wait_ready(deadline)
                if event.get("event") == "ready":
                    return worker
                failure, passes = _refusal(kind, event)
            except LinkError as error:
                failure, passes = failure or error, True
            except BaseException:
                worker.kill()
                raise
            worker.kill()
            if not passes or time.monotonic() + pause + _LEAST_S > deadline:
                break
            time.sleep(pause)
            pause *= 2.0
        failure = failure or LinkError("not tried")
        look = f": {_LOOK}" if isinstance(failure, LinkError) else ""
        raise type(failure)(f"robot at {options.host}: {failure}{look}") from failure


def _refusal(kind: str, event: Message) -> tuple[DriverError, bool]:
    """Why a worker ended, and whether another attempt may help."""
    why = str(event.get("why", ""))
    for sign, error, meaning, passes in _REFUSALS:
        if sign in why:
            return error(meaning), passes
    if kind == "state" and event.get("event") == "failed":
        return DriverError(why), False
    return LinkError(why), True
