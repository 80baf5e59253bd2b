"""Connection to one UR robot: its options, the stream of states, and the process that commands.
ur_rtde can hang and crash, so it commands the robot in a process of its own. Stream and process
are started again on failure, within a deadline, and replaced when they fail later."""

import contextlib
import json
import signal
import subprocess
import sys
import threading
import time
import weakref
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from itertools import count, takewhile
from socket import AF_UNIX, SOCK_SEQPACKET, socketpair
from typing import Any, TypeVar

from wrenchbed import registry
from wrenchbed.errors import DriverError, LinkError, ParameterError, StoppedError
from wrenchbed.hardware.device_base import STALE_S, wait_until
from wrenchbed.hardware.drivers.rtde import control_worker
from wrenchbed.hardware.drivers.rtde.control_worker import Closed, MessageChannel, SharedNumbers
from wrenchbed.hardware.drivers.rtde.states import NATIVE_HZ, Snapshot, StateReceiver
from wrenchbed.robots.checked_moves import Limits

T = TypeVar("T")
PERIOD_S = 0.05
"""Period of the driver's heartbeat [s], a tenth of `control_worker.DRIVER_SILENT_S`."""
_JOINTS = 6
"""Number of joints of every UR robot."""
_FIRST_PAUSE_S = 0.1
"""Pause before the second attempt to connect [s]; it doubles after each attempt."""
_FRESH_S = 1.0
"""Time within which a new stream must deliver a state [s], a hundred cycles of a CB3."""
_LEAST_S = 1.0
"""Least time before the deadline for another attempt [s]: a process can start and connect in it."""
_LOOK = "check --host, power, cable, and that nothing blocks TCP 30004"
"""Remedy in errors when the robot cannot be reached."""
_IN_USE = "another client controls this robot: close it"
_LOCAL = "the robot is in local control: switch it to remote control at its pendant"
_NO_START = "the robot does not start the program that it was sent: look at its pendant"
_REFUSALS: tuple[tuple[str, type[DriverError], str], ...] = (
    ("already in use", DriverError, _IN_USE),
    ("remote control", StoppedError, _LOCAL),
    ("start control script", StoppedError, _NO_START),
)
"""Part of a text that ur_rtde prints, error to raise for it, and message of that error."""
_POLL_S, _ANSWER_POLL_S = 0.01, 0.001
"""Time between two checks for the first event and for an answer [s]; no stop must wait longer."""
_END_S = 5.0
"""Longest wait for a killed process to end [s]; it ends at once unless the kernel is stuck."""


@dataclass(frozen=True)
class RtdeOptions:
    """Options of the driver of UR robots over RTDE, their controllers' data link.

    Attributes:
        robot: registry name.
        host: address of the robot's controller; its ports are fixed (30004, 30003, 29999).
        sensor: empty or ``netft`` for a Net F/T box (ATI's electronics) at the robot's host,
            ``netft://HOST[:PORT][?http=PORT]`` elsewhere, ``rtde`` for the robot's own wrench.
        frequency: rate of states and streamed targets [Hz]; None: the controller's own, 125 Hz on a
            CB3 and 500 Hz on an e-Series.
        watchdog_hz: the robot stops its program if no signal of life comes for 1/watchdog_hz [s].
        limits: limits of the robot's motion; None: a quarter of top speed, anywhere.
        power_on: whether `activate` may switch the robot on and release its brakes.
        connect_s: deadline of `connect` and of each reconnection [s].
        effort: ``current``: recordings keep motor currents i1… [A] and the controller's targets of
            joints; ``off``: neither. A UR robot reports no joint torques.
    """

    robot: str = "ur5"
    host: str = ""
    sensor: str = ""
    frequency: float | None = 125.0
    watchdog_hz: float = 10.0
    limits: Limits | None = None
    power_on: bool = False
    connect_s: float = 8.0
    effort: str = "current"

    def __post_init__(self) -> None:
        """Check the options; a `ParameterError` names one that no controller can have."""
        units = [joint.unit for joint in registry.load("robots", self.robot).joints]
        effort = (
            f"effort {self.effort!r}: a UR robot reports the currents of its motors, no torques: "
            "give current or off"
        )
        six = f"driver 'rtde' moves UR robots, which have six hinges, not {self.robot!r}"
        rate, watchdog = self.frequency, self.watchdog_hz
        rules = (
            (units == ["rad"] * _JOINTS, f"{six}: give another"),
            (rate is None or 1.0 <= rate <= 500.0, f"frequency {rate} Hz must be from 1 to 500 Hz"),
            (self.effort in ("current", "off"), effort),
            (1.0 <= watchdog <= 50.0, f"watchdog_hz {watchdog:g} Hz must be from 1 to 50 Hz"),
            (self.connect_s > 0.0, f"connect_s {self.connect_s:g} s must be above 0"),
        )
        for holds, refusal in rules:
            if not holds:
                raise ParameterError(refusal)


class ControlProcess:
    """The child process that commands a UR robot by the library ur_rtde.

    Attributes:
        pid: process id.
        ready: whether the process controls the robot.
        refused: why the newest streamed target was refused.
        program_ended: whether the process saw that its program on the robot has ended.
    """

    def __init__(self, setting: dict[str, Any], shared: SharedNumbers) -> None:
        mine, other = socketpair(AF_UNIX, SOCK_SEQPACKET)
        self._wire, self._lock = MessageChannel(mine), threading.Lock()
        self._numbers = count(1)
        self._replies: dict[int, str] = {}
        self.ready = self.program_ended = False
        self.refused = self._last_words = self._why = ""
        inherited = {"memory": shared.descriptor, "wire": other.fileno()}
        with other:
            self._process = subprocess.Popen(
                [sys.executable, "-P", control_worker.__file__, json.dumps(setting | inherited)],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                pass_fds=tuple(inherited.values()),
                process_group=0,
            )
        self.pid = self._process.pid
        self._kill = weakref.finalize(self, _end, self._process)

    def wait_ready(self, seconds: float) -> None:
        """Wait until the process controls the robot; kill it if that takes over ``seconds``. Raises
        a `LinkError` if it is late or cannot reach the robot, a `DriverError` if the robot
        refuses."""
        if not wait_until(
            lambda: bool(self.gone()) or self.ready or bool(self._last_words), seconds, _POLL_S
        ):
            self.kill()
            raise LinkError(f"the control process did not connect within {seconds:.1f} s: killed")
        if why := self._last_words or self.gone():
            for sign, error, meaning in _REFUSALS:
                if sign in why:
                    raise error(meaning)
            raise LinkError(why)

    def send(self, do: str, **more: Any) -> bool:
        """Send the process command ``do`` with values ``more``; return False if the channel is
        full."""
        return self._wire.send({"do": do} | more)

    def ask(self, do: str, timeout: float, **more: Any) -> str:
        """Send command ``do`` with its values ``more``; return its answer: empty on success, else
        the reason for refusal. A `LinkError` if the process is gone, or silent for ``timeout``
        [s]."""
        number = next(self._numbers)
        if not self.send(do, id=number, **more):
            raise LinkError(self.gone() or "the control process takes no orders")

        def ended() -> bool:
            return bool(self.gone()) or number in self._replies

        if wait_until(ended, timeout, _ANSWER_POLL_S) and number in self._replies:
            return self._replies.pop(number)
        raise LinkError(
            self.gone() or f"the control process did not answer {do!r} in {timeout:g} s"
        )

    def gone(self) -> str:
        """Reason why the process has ended; empty while it runs."""
        if self._why:
            return self._why
        code = self._process.poll()
        self._drain()
        if code is None:
            return ""
        if self._last_words:
            return f"the control process ended: {self._last_words}"
        if code < 0:
            return f"the control process died by signal {-code} ({signal.Signals(-code).name})"
        return f"the control process ended with code {code}"

    def quit(self, timeout: float) -> None:
        """Ask the control process to end, kill it after the timeout [s], release its resources."""
        self.send("quit")
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout)
        self.kill()

    def kill(self, why: str = "") -> None:
        """Kill the control process, note why, and release its resources; may be called twice."""
        self._why = self._why or self.gone() or why
        self._kill()
        with self._lock:
            self._wire.close()

    def _drain(self) -> None:
        """Read the messages that the control process sent; store the last eight answers."""
        with self._lock, contextlib.suppress(Closed):
            while (message := self._wire.receive(0.0)) is not None:
                why = str(message.get("why", ""))
                match message.get("event"):
                    case None:
                        self._replies[message["id"]] = why
                        self._replies.pop(message["id"] - 8, None)
                    case "unsent":
                        self.refused = why
                    case "ended":
                        self.program_ended = True
                    case "ready":
                        self.ready = True
                    case _:
                        self._last_words = why


def _end(process: subprocess.Popen[bytes]) -> None:
    if process.poll() is None:
        process.kill()
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(_END_S)


class Links:
    """Connections to one robot: state stream, control processes, shared memory and heartbeat."""

    def __init__(self, options: RtdeOptions) -> None:
        self.shared = SharedNumbers.create()
        self.restarts = 0
        self._options = options
        self._receiver: StateReceiver | None = None
        self._closed = threading.Event()
        self.shared.beat("driver")
        self._thread = threading.Thread(target=self._beat, name="rtde pulse", daemon=True)
        self._thread.start()

    @property
    def state(self) -> Snapshot | None:
        """Newest state of the robot; None before the first."""
        newest = self._receiver.newest if self._receiver else None
        return newest if newest and newest.t > 0.0 else None

    def since(self, t: float) -> list[Snapshot]:
        """States of the robot that arrived after a `time.monotonic` time [s], oldest first."""
        recent = self._receiver.recent.copy() if self._receiver else deque[Snapshot]()
        return [*takewhile(lambda state: state.t > t, reversed(recent))][::-1]

    @property
    def ended(self) -> str:
        """Reason why no more states will come; empty while the stream runs."""
        return self._receiver.ended if self._receiver else "the stream of states was not opened"

    def open_state(self) -> None:
        """Connect to the robot and start receiving its states. Raises a `LinkError` if it cannot be
        reached by the deadline, a `DriverError` if its answer cannot be used."""
        before = self._receiver.newest if self._receiver else Snapshot()

        def attempt(_: float) -> None:
            options = self._options
            receiver = StateReceiver(options.host, options.frequency, before, self._published)
            self._receiver = receiver
            wait_until(lambda: receiver.newest.t > 0.0 or bool(receiver.ended), _FRESH_S)
            if receiver.ended or receiver.newest.t == 0.0:
                receiver.close()
                raise LinkError(receiver.ended or "the controller sends no states")

        self._try(attempt)

    def renew_state(self) -> None:
        """Reconnect if the stream delivers no fresh states. Raises a `LinkError` if the robot
        cannot be reached within the deadline, a `DriverError` if its answer cannot be used."""
        state = self.state
        silent = state is None or time.monotonic() - state.t > STALE_S or state.back > 0.0
        if silent or self.ended:
            if self._receiver is not None:
                self._receiver.close()
            self.restarts += 1
            self.open_state()

    def open_control(self) -> ControlProcess:
        """Start and return a process that controls the robot, with the robot's watchdog on. A
        `StoppedError` if the robot accepts no program, a `DriverError` if another client controls
        it, a `LinkError` if it cannot be reached by the deadline."""
        options, state = self._options, self.state
        native = NATIVE_HZ[state is not None and state.major > 3]
        setting = {
            "host": options.host, "frequency": options.frequency,
            "alarm": int(options.connect_s) + 2, "watchdog_hz": options.watchdog_hz,
            "period": 1.0 / (options.frequency or native),
        }  # fmt: skip

        def attempt(deadline: float) -> ControlProcess:
            process = ControlProcess(setting, self.shared)
            try:
                process.wait_ready(deadline - time.monotonic())
            except BaseException:
                process.kill()
                raise
            return process

        return self._try(attempt)

    def close(self) -> None:
        """End the stream of states and the heartbeat; may be called twice."""
        if self._receiver is not None:
            self._receiver.close()
        self._receiver = None
        self._closed.set()
        self._thread.join(1.0)
        self.shared.close()

    def _published(self, state: Snapshot) -> None:
        self.shared.put("speed", max(map(abs, state.qd)))
        self.shared.put("state", state.t)

    def _beat(self) -> None:
        """Write the heartbeat to shared memory; without it the control process stops the robot."""
        while not self._closed.wait(PERIOD_S):
            self.shared.beat("driver")

    def _try(self, attempt: Callable[[float], T]) -> T:
        """Call ``attempt`` with its deadline (`time.monotonic` [s]) and return its result; call it
        again after a transient failure, until that deadline."""
        options = self._options
        deadline, pause = time.monotonic() + options.connect_s, _FIRST_PAUSE_S
        failure: DriverError | None = None
        while True:
            try:
                return attempt(deadline)
            except DriverError as error:
                passes = isinstance(error, LinkError) or str(error) == _IN_USE
                if failure is None or not isinstance(error, LinkError):
                    failure = error  # a refusal says more than a later silence
            if not passes or time.monotonic() + pause + _LEAST_S > deadline:
                break
            time.sleep(pause)
            pause *= 2.0
        look = f": {_LOOK}" if isinstance(failure, LinkError) else ""
        raise type(failure)(f"robot at {options.host}: {failure}{look}") from failure
