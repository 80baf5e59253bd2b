"""The worker that commands the robot, one call of ur_rtde at a time, and feeds its watchdog.

The robot-side watchdog is kicked only while the driver's heartbeat is young. Moves and their stops
are asynchronous, since the watchdog stops what blocks longer than its period. When the driver is
gone the robot is stopped, the kicks end, and so does this process.

The driver sends streamed targets ahead of their time; this worker passes each on when it is due.
"""

import math
import os
import signal
import threading
import time
from collections import deque
from importlib import import_module
from typing import Any

from wrenchbed.hardware.drivers.rtde.shared_state import SharedState
from wrenchbed.hardware.drivers.rtde.worker import (
    LOST,
    Closed,
    Message,
    MessageChannel,
    Printed,
    cause,
    end_process,
)

KICKS = 6.0
"""Kicks of the watchdog in its period: five of them may be late."""
DRIVER_SILENT_S = 0.5
"""Age of the driver's heartbeat at which the robot is stopped [s], ten heartbeats."""
BLIND_S = 1.0
"""Age of the newest state at which a robot that moves is stopped [s]: its link is lost then."""
_MOST = 256
"""Streamed targets that may wait: half a second at 500 Hz, more than the driver's lead."""
_PHASE_GAIN, _PHASE = 0.02, 0.4
"""Fraction of the phase error that a target corrects, so that the jitter of 50 targets averages;
phase of targets after a state as a fraction of the period, near its middle."""
_ALIKE = 0.01
"""Relative difference up to which the target period counts as the state period."""
_STUCK_S, _MIND_S = 0.4, 0.02
"""Time for a hanging call after the driver is gone, longer than any but a hanging one takes, and
period of that check [s]."""
_TICK_S = 1e-3
"""Resolution of the message channel's poll [s], by definition milliseconds."""
_REST = 5e-3
"""Fastest joint at rest [rad/s]: with less the noise of speeds is a motion, with more the next
motion begins before the last one ended."""
_REST_S, _LAST_S, _SERVO_S, _POLL_S = 2.0, 0.15, 0.4, 0.005
"""Deadlines of coming to rest: of any motion at `_SOFT`, of the end of a move, of a stream before
its stop; and time between two looks [s]."""
_SOFT, _HARD, _SERVO_SOFT, _SERVO_HARD = 3.0, 15.0, 4.0, 15.0
"""Decelerations; of the joints [rad/s²] or of the tool [m/s²], as the robot's script takes them: a
stop from 1 rad/s takes 0.3 s, and 0.07 s hard."""
_LOOKAHEAD_S, _GAIN = 0.1, 300.0
"""Arguments of ``servoj``; source: defaults of the URScript manual (0.1 s, 300)."""
_OVER = "the robot's program does not run"
_BEGINS_S = 0.05
"""Time in which a move or a stop surely reports that it is under way [s], six cycles of a CB3."""


class TargetStream:
    """Streamed targets that wait for their time, so that each reaches the robot in its own cycle.

    Where targets are as far apart as states, their times are shifted slowly until they lie between
    two states. Clocks that drift apart would otherwise put two targets into one cycle of the robot
    and none into the next.

    Args:
        period: between two states [s].
    """

    def __init__(self, period: float) -> None:
        self._period = period
        self._waiting: deque[tuple[float, list[float]]] = deque(maxlen=_MOST)
        self._last, self._locked, self._shift = -math.inf, False, 0.0

    @property
    def due(self) -> float:
        """When the next target is due (`time.monotonic`, [s]); never, if none waits."""
        return self._waiting[0][0] + self._shift if self._waiting else math.inf

    def add(self, q: list[float], at: float) -> None:
        """Add a target (6,) for a time (`time.monotonic`, [s])."""
        apart = at - self._last
        self._locked = abs(apart - self._period) < _ALIKE * self._period
        self._last = at
        self._waiting.append((at, q))

    def clear(self) -> None:
        """Drop all waiting targets."""
        self._waiting.clear()

    def take(self, now: float, state: float) -> list[float] | None:
        """The newest target that is due, None if none is.

        Args:
            now: `time.monotonic` [s].
            state: likewise, when the robot's newest state arrived.
        """
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


def run(setting: dict[str, Any], shared: SharedState, wire: MessageChannel) -> None:
    """Take control, report it, and obey until ``quit`` or until the driver is gone."""
    printed = Printed(lambda why: end_process(wire, "lost", why, LOST))
    control = import_module("rtde_control").RTDEControlInterface
    frequency = setting["frequency"]
    signal.alarm(setting["alarm"])  # a constructor that hangs holds Python's lock
    try:
        robot = control(setting["host"], -1.0 if frequency is None else frequency)
        if not robot.setWatchdog(setting["watchdog_hz"]):
            raise RuntimeError("the robot's script does not take the watchdog")
    except Exception as error:
        return end_process(wire, "failed", f"{cause(error)} {' '.join(printed.lines)}".strip(), 1)
    signal.alarm(0)
    serving = Control(robot, shared, wire, setting["watchdog_hz"], setting["period"])
    threading.Thread(target=serving.mind, daemon=True).start()
    wire.send({"event": "ready"})
    serving.serve()


class Control:
    """Obeys the driver; all calls of ur_rtde are made in the thread of `serve`."""

    def __init__(
        self,
        robot: Any,
        shared: SharedState,
        wire: MessageChannel,
        watchdog_hz: float,
        period: float,
    ) -> None:
        self._robot, self._shared, self._wire = robot, shared, wire
        self._pause, self._period = 1.0 / (KICKS * watchdog_hz), period
        self._kick_due, self._stream = 0.0, TargetStream(period)
        self._playing, self._servoing, self._moving = True, False, False
        self._began, self._hard = 0.0, False

    def serve(self) -> None:
        """Obey and kick until ``quit``; stop the robot when the driver is gone."""
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
        """End this process when the driver is gone and `serve` hangs in a call."""
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
        """How long to wait for a message [s]; the channel polls in integer milliseconds."""
        idle = min(self._kick_due, self._stream.due) - time.monotonic()
        if idle < _TICK_S:
            time.sleep(max(0.0, idle))
        return idle - _TICK_S

    def _release(self) -> None:
        """Send the newest target that is due."""
        now, state = time.monotonic(), self._shared.read() if self._stream.due < math.inf else None
        q = self._stream.take(now, now if state is None else state.t)
        if q is not None and (why := self._servo(q)):
            self._wire.send({"event": "unsent", "why": why})

    def _blind(self) -> bool:
        """Whether the robot moves and no recent state shows where."""
        state = self._shared.read()
        silent = state is None or time.monotonic() - state.t > BLIND_S
        return silent and (self._servoing or self._under_way())

    def _ended(self) -> None:
        """The program on the robot does not run any more."""
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
        """Stream one target; the reason if it is refused."""
        if not self._playing:
            return _OVER
        if not sound(q):
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
        """Start a move after any other motion has come to rest; the reason if it is refused."""
        q, speed, acceleration = message["q"], message["speed"], message["acceleration"]
        if not sound(q) or not math.isfinite(speed + acceleration):
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
        """Brake; returns before the robot rests, with an empty reason.

        A hard stop under way stays hard: the robot's script would brake anew, more softly.
        """
        self._stream.clear()
        if not self._playing:
            return ""
        if self._servoing and not hard:
            self._rest(_SERVO_S)
        self._brake(hard)
        return ""

    def _brake(self, hard: bool) -> None:
        if self._servoing:
            self._servoing = False
            if not self._robot.servoStop(_SERVO_HARD if hard else _SERVO_SOFT):
                self._ended()
        elif hard or (self._under_way() and not self._hard):
            self._robot.stopJ(_HARD if hard else _SOFT, True)
            self._moving, self._hard, self._began = True, hard, time.monotonic()

    def _under_way(self) -> bool:
        """Whether a move or its stop goes on."""
        if not self._moving or time.monotonic() - self._began < _BEGINS_S:
            return self._moving
        if not self._robot.getAsyncOperationProgressEx().isAsyncOperationRunning():
            self._moving = self._hard = False
        return self._moving

    def _rest(self, within: float = _REST_S) -> bool:
        """Kick until the joints rest and no operation runs; False if they do not in time [s]."""
        end = time.monotonic() + within
        while time.monotonic() < end and self._alive() and self._playing:
            self._kick()
            state = self._shared.read()
            still = state is not None and max(abs(v) for v in state.qd) < _REST
            if still and (self._servoing or not self._under_way()):
                return True
            time.sleep(_POLL_S)
        return not self._playing


def sound(q: object) -> bool:
    """Whether these are six finite numbers; ur_rtde checks nothing and waits 300 s if not."""
    return (
        isinstance(q, list)
        and len(q) == 6
        and all(isinstance(v, int | float) and math.isfinite(v) for v in q)
    )
