"""The process that commands the robot, one call of ur_rtde at a time, and feeds its watchdog.

``control_worker.py SETTING`` with the setting as JSON; messages are JSON objects over a pair of
local sockets. The robot-side watchdog is kicked only while the driver's heartbeat is recent. Moves
and their stops are asynchronous, since the watchdog stops a call that blocks for its period. When
the driver is gone the robot is stopped, the kicks end, and so does this process.

The driver sends streamed targets ahead of their time; this process passes each on when it is due.
It ends by `os._exit`, since destructors of ur_rtde throw after the controller died, and imports the
standard library only, so that it starts quickly. A change moves or stops robots: run
tests/hardware/test_rtde_control.py and scripts/reactions.
"""

import contextlib
import json
import math
import mmap
import os
import select
import signal
import socket
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from importlib import import_module
from typing import Any, Self

Message = dict[str, Any]
_LONGEST = 4096
"""Most bytes of a message on the channel; the longest ones sent have some hundred."""
_MS = 1e3  # by definition
_PRIORITY = -10
"""Nice value of this process: ahead of other programs, behind real-time ones."""
LOST = 3
"""Exit code of this process after it lost the controller."""
_LOSS = ("Could not receive data", "Lost connection", "Reconnecting", "closed the connection")
"""Texts that ur_rtde prints before it reconnects by itself, which ends in a crash."""
_NUMBERS = ("driver", "control", "state", "speed")
KICKS = 6.0
"""Number of kicks within the watchdog's period: five of them may be late."""
DRIVER_SILENT_S = 0.5
"""Age of the driver's last heartbeat at which the robot is stopped [s], ten periods of it."""
BLIND_S = 1.0
"""Age of the newest state at which a moving robot is stopped [s]: its link counts as lost then."""
_MOST = 256
"""Most streamed targets that wait: half a second at 500 Hz, more than the driver's lead."""
_PHASE_GAIN, _PHASE = 0.02, 0.4
"""Fraction of the phase error that each target corrects (jitter of 50 targets averages), and wanted
phase of targets after a state in periods."""
_ALIKE = 0.01
"""Relative difference below which the periods of targets and of states count as equal."""
_STUCK_S, _MIND_S = 0.4, 0.02
"""Time that a hanging call gets after the driver is gone, longer than any other call takes, and
period of the check for that [s]."""
_TICK_S = 1e-3
"""Resolution of the message channel's poll [s], by definition milliseconds."""
_REST = 5e-3
"""Speed of the fastest joint of a robot at rest [rad/s]: noise of speeds is below it."""
_REST_S, _LAST_S, _SERVO_S, _POLL_S = 2.0, 0.15, 0.4, 0.005
"""Deadlines of rest: any motion, end of a move, stream before its stop; time between checks [s]."""
_SOFT, _HARD, _SERVO_SOFT, _SERVO_HARD = 3.0, 15.0, 4.0, 15.0
"""Decelerations of joints [rad/s²] or of the tool [m/s²], as the robot's script takes them: a stop
from 1 rad/s takes 0.3 s, a hard one 0.07 s."""
_LOOKAHEAD_S, _GAIN = 0.1, 300.0
"""Arguments of ``servoj``; source: defaults of the URScript manual (0.1 s, 300)."""
_OVER = "the robot's program does not run"
_BEGINS_S = 0.05
"""Time after which a move or stop surely reports that it is running [s], six cycles of a CB3."""


class Closed(Exception):  # noqa: N818
    """The process at the other end of the message channel is gone."""


class MessageChannel:
    """One end of a local channel that transfers whole JSON messages in order."""

    def __init__(self, end: socket.socket) -> None:
        self._end = end
        self._end.setblocking(False)
        self._poll = select.poll()
        self._poll.register(end.fileno(), select.POLLIN)

    def send(self, message: Message) -> bool:
        """Send a message without waiting; return False if the other end does not accept it."""
        with contextlib.suppress(OSError):
            self._end.send(json.dumps(message).encode()[:_LONGEST])
            return True
        return False

    def receive(self, timeout: float) -> Message | None:
        """Receive the next message; None if none arrives within ``timeout`` [s]. Raises `Closed` if
        the other end is gone.
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
        """Close this end of the channel; may be called twice."""
        self._end.close()


class SharedNumbers:
    """Named numbers in memory that the driver and the control process share; each has one writer.
    ``driver`` and ``control`` are heartbeats, ``state`` is when the newest state arrived (all
    `time.monotonic` [s]), ``speed`` is the speed of the fastest joint [rad/s]. ``descriptor`` is
    the file descriptor of the memory."""

    def __init__(self, descriptor: int) -> None:
        self.descriptor = descriptor
        self._memory = mmap.mmap(descriptor, 8 * len(_NUMBERS))
        self._numbers = memoryview(self._memory).cast("d")  # read and written by one copy each

    @classmethod
    def create(cls) -> Self:
        """Create the shared memory; it is freed when the last process that uses it ends."""
        descriptor = os.memfd_create("wrenchbed-rtde")
        os.ftruncate(descriptor, 8 * len(_NUMBERS))
        return cls(descriptor)

    def close(self) -> None:
        """Release this process's view of the memory; may be called twice."""
        if self.descriptor >= 0:
            self._numbers.release()
            self._memory.close()
            os.close(self.descriptor)
            self.descriptor = -1

    def put(self, name: str, value: float) -> None:
        """Write the number called ``name``."""
        self._numbers[_NUMBERS.index(name)] = value

    def get(self, name: str) -> float:
        """Read the number called ``name``; 0 if it was never written."""
        return self._numbers[_NUMBERS.index(name)]

    def beat(self, name: str) -> None:
        """Write the present `time.monotonic` time [s] as the number called ``name``."""
        self.put(name, time.monotonic())

    def silence(self, name: str) -> float:
        """Time [s] since the `time.monotonic` time that the number called ``name`` holds."""
        then = self.get(name)  # first: the clock is later
        return time.monotonic() - then


def printed(lost: Callable[[str], None]) -> deque[str]:
    """Capture what the library ur_rtde prints; return a deque of its last lines. ``lost`` is called
    with a line that reports a lost link."""
    last: deque[str] = deque(maxlen=8)
    out, into = os.pipe()
    for standard in (1, 2):
        os.dup2(into, standard)
    os.close(into)

    def read() -> None:
        with os.fdopen(out, "r", errors="replace") as lines:
            for line in lines:
                last.append(line.strip())
                if any(sign in line for sign in _LOSS):
                    lost(line.strip())

    threading.Thread(target=read, daemon=True).start()
    return last


class TargetStream:
    """Holds streamed targets until their time, so that each reaches the robot in its own cycle.
    If targets and states have the same ``period`` [s], the targets' times are slowly shifted until
    they lie between two states. Clocks that drift apart would otherwise put two targets into one
    cycle of the robot and none into the next."""

    def __init__(self, period: float) -> None:
        self._period = period
        self._waiting: deque[tuple[float, list[float]]] = deque(maxlen=_MOST)
        self._last, self._locked, self._shift = -math.inf, False, 0.0

    @property
    def due(self) -> float:
        """`time.monotonic` time at which the next target is due [s]; infinite if none waits."""
        return self._waiting[0][0] + self._shift if self._waiting else math.inf

    def add(self, q: list[float], at: float) -> None:
        """Store a target (6,) [rad] to be sent at a `time.monotonic` time [s]."""
        apart = at - self._last
        self._locked = abs(apart - self._period) < _ALIKE * self._period
        self._last = at
        self._waiting.append((at, q))

    def clear(self) -> None:
        """Drop all targets not yet sent."""
        self._waiting.clear()

    def take(self, now: float, state: float) -> list[float] | None:
        """Return the newest target (6,) due at ``now`` [s], and drop it and earlier ones; None if
        none is due. ``state`` is the arrival of the robot's newest state [s]."""
        q = None
        while self.due <= now:
            q = self._waiting.popleft()[1]
        if q is not None and self._locked:
            self._follow((now - state) % self._period)
        return q

    def _follow(self, phase: float) -> None:
        period = self._period
        error = (_PHASE * period - phase + 0.5 * period) % period - 0.5 * period
        self._shift += _PHASE_GAIN * error
        if abs(self._shift) > 0.5 * period:
            self._shift -= math.copysign(period, self._shift)


class Control:
    """Executes the driver's commands in the process that controls a UR; `serve` makes all calls of
    the library ur_rtde. ``hz``: rate of the robot's watchdog, ``period``: that of targets [s]."""

    def __init__(
        self, robot: Any, shared: SharedNumbers, wire: MessageChannel, hz: float, period: float
    ) -> None:
        self._robot, self._shared, self._wire = robot, shared, wire
        self._pause, self._period = 1.0 / (KICKS * hz), period
        self._kick_due, self._stream = 0.0, TargetStream(period)
        self._playing, self._servoing, self._moving = True, False, False
        self._began, self._hard = 0.0, False

    def serve(self) -> None:
        """Execute commands and kick the watchdog until ``quit`` or until the driver is gone."""
        try:
            while self._alive():
                self._kick()
                self._release()
                message = self._wire.receive(self._idle())
                while message is not None:
                    self._obey(message)
                    message = self._wire.receive(0.0)
        except Closed:
            pass
        self._halt(hard=True)
        os._exit(0)

    def mind(self) -> None:
        """Watch, in a thread, for the driver's end; then end this process even if `serve` hangs."""
        while self._shared.silence("driver") < DRIVER_SILENT_S:
            time.sleep(_MIND_S)
        time.sleep(_STUCK_S)
        os._exit(LOST)

    def _alive(self) -> bool:
        self._shared.beat("control")
        return self._shared.silence("driver") < DRIVER_SILENT_S

    def _kick(self) -> None:
        now = time.monotonic()
        if now < self._kick_due:
            return
        self._kick_due = now + self._pause
        if self._playing and self._blind():
            self._brake(hard=False)
            self._ended()  # no further kicks: the watchdog ends the program
        elif self._playing and not self._robot.kickWatchdog():
            self._ended()

    def _idle(self) -> float:
        """Longest wait of `serve` for a message [s]; the channel polls in whole milliseconds."""
        idle = min(self._kick_due, self._stream.due) - time.monotonic()
        if idle < _TICK_S:
            time.sleep(max(0.0, idle))
        return idle - _TICK_S

    def _release(self) -> None:
        """Send the newest due target to the robot."""
        q = self._stream.take(time.monotonic(), self._shared.get("state"))
        if q is not None and (why := self._servo(q)):
            self._wire.send({"event": "unsent", "why": why})

    def _blind(self) -> bool:
        """Whether the robot moves while no recent state shows where it is."""
        silent = self._shared.silence("state") > BLIND_S
        return silent and (self._servoing or self._under_way())

    def _ended(self) -> None:
        """Note, and report to the driver, that the program on the robot has ended."""
        self._stream.clear()
        self._playing = self._servoing = self._moving = False
        self._wire.send({"event": "ended"})

    def _obey(self, message: Message) -> None:
        do = message.get("do")
        if do == "servo":
            return self._stream.add(message["q"], message["at"])
        self._stream.clear()
        if do == "quit":
            self._halt(hard=False)
            self._rest()
            self._robot.stopScript()
            os._exit(0)
        why = self._move(message) if do == "move" else self._halt(message.get("kind") == "hard")
        self._wire.send({"id": message["id"], "why": why})

    def _servo(self, q: list[float]) -> str:
        """Send a streamed target (6,) [rad] to the robot; return why it was refused, else ""."""
        if not self._playing:
            return _OVER
        if not is_six_numbers(q):
            return "a target must be 6 finite angles"
        if self._under_way() and not self._rest(_LAST_S):
            return "a move is under way"
        self._servoing = True
        self._kick_due = time.monotonic() + self._pause
        if not self._robot.servoJ(q, 0.5, 0.5, self._period, _LOOKAHEAD_S, _GAIN):
            self._ended()
            return _OVER
        return ""

    def _move(self, message: Message) -> str:
        """Start the move that ``message`` has (q, speed, acceleration) after any other motion is
        over; return why it was refused, else ""."""
        q, speed, acceleration = message["q"], message["speed"], message["acceleration"]
        if not is_six_numbers(q) or not math.isfinite(speed + acceleration):
            return "a goal must be 6 finite angles"
        if self._servoing or (self._under_way() and not self._rest(_LAST_S)):
            self._halt(hard=False)
            if not self._rest():
                return "the robot does not come to rest"
        if not self._robot.moveJ(q, speed, acceleration, True):
            self._ended()
            return "the robot did not take the move: its program does not run"
        self._moving, self._hard, self._began = True, False, time.monotonic()
        return ""

    def _halt(self, hard: bool) -> str:
        """Begin to brake, hard or softly; return "" without waiting for rest."""
        self._stream.clear()
        if not self._playing:
            return ""
        if self._servoing and not hard:
            self._rest(_SERVO_S)
        self._brake(hard)
        return ""

    def _brake(self, hard: bool) -> None:
        """Send the stop command; a soft one would soften a hard stop and is left out then."""
        if self._servoing:
            self._servoing = False
            if not self._robot.servoStop(_SERVO_HARD if hard else _SERVO_SOFT):
                self._ended()
        elif hard or (self._under_way() and not self._hard):
            self._robot.stopJ(_HARD if hard else _SOFT, True)
            self._moving, self._hard, self._began = True, hard, time.monotonic()

    def _under_way(self) -> bool:
        """Whether a move or the stop of a move is in progress."""
        if not self._moving or time.monotonic() - self._began < _BEGINS_S:
            return self._moving
        if not self._robot.getAsyncOperationProgressEx().isAsyncOperationRunning():
            self._moving = self._hard = False
        return self._moving

    def _rest(self, within: float = _REST_S) -> bool:
        """Wait until the robot rests, kicking the watchdog; return False after ``within`` [s]."""
        end = time.monotonic() + within
        while time.monotonic() < end and self._alive() and self._playing:
            self._kick()
            if self._shared.get("speed") < _REST and (self._servoing or not self._under_way()):
                return True
            time.sleep(_POLL_S)
        return not self._playing


def is_six_numbers(q: object) -> bool:
    """Whether q is six finite numbers; ur_rtde does not check and waits 300 s for others."""
    return (
        isinstance(q, list)
        and len(q) == 6
        and all(isinstance(v, int | float) and math.isfinite(v) for v in q)
    )


def serve(setting: dict[str, Any], shared: SharedNumbers, wire: MessageChannel) -> None:
    """Control the robot: execute commands from ``wire`` until ``quit`` or the driver's end.
    ``setting`` has host, frequency [Hz], watchdog_hz, period [s] of targets, and alarm [s] for
    connecting."""

    def end(event: str, why: str, code: int) -> None:
        wire.send({"event": event, "why": why})
        os._exit(code)

    lines = printed(lambda why: end("lost", why, LOST))
    try:
        signal.alarm(setting["alarm"])  # a constructor that hangs holds Python's lock
        control = import_module("rtde_control").RTDEControlInterface
        robot = control(setting["host"], setting["frequency"] or -1.0)
        if not robot.setWatchdog(setting["watchdog_hz"]):
            raise RuntimeError("the robot's script does not take the watchdog")
        signal.alarm(0)
        serving = Control(robot, shared, wire, setting["watchdog_hz"], setting["period"])
        threading.Thread(target=serving.mind, daemon=True).start()
        wire.send({"event": "ready"})
        serving.serve()
    except BaseException as error:
        why = " ".join(str(error).split()) or type(error).__name__
        end("failed", " ".join((why, *lines)), 1)


def main(argument: str) -> None:
    """Run the control process; ``argument``: JSON of `serve`'s setting and two descriptors."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with contextlib.suppress(OSError):  # where the system allows it
        os.setpriority(os.PRIO_PROCESS, 0, _PRIORITY)
    setting = dict[str, Any](json.loads(argument))
    wire = MessageChannel(socket.socket(fileno=setting["wire"]))
    serve(setting, SharedNumbers(setting["memory"]), wire)


if __name__ == "__main__":
    main(sys.argv[1])
