"""A URScript program that plays: what its functions act on, and which of its threads moves the arm.

An External Control node fetches its program from a computer as the maker's URCap does: the computer
serves TCP, the robot sends ``request_program`` and a line's end, and gets a text. It has no length;
it ends with a marker, with the connection, or with silence.
"""

from collections import deque
from collections.abc import Generator, Iterator
from typing import TYPE_CHECKING

import numpy as np

from robot_emulators.ur.messages import Event
from robot_emulators.ur.motions import ArmMotion
from robot_emulators.ur.program_sockets import Link, Links
from robot_emulators.ur.urscript.machine import LONGEST, Machine
from robot_emulators.ur.urscript.translation import Code
from robot_emulators.ur.urscript.values import ProgramEndsError, ScriptFaultError

if TYPE_CHECKING:
    from robot_emulators.ur.arm import ControlledArm
    from robot_emulators.ur.controller import Controller

_HISTORY = 512
"""Number of control cycles whose joint values are stored for the program."""
PAUSE, STOP = "PAUSE", "STOP"
DIAL_S = 2.0
"""Longest time until a connection is open [s]."""
_REQUEST = b"request_program\n"
_END = b"# NODE_CONTROL_LOOP_ENDS"
_ANSWER_S, _SILENT_S = 5.0, 0.5
"""Longest wait for the computer's answer, and silence that ends its text [s]."""
_AT_ONCE = "rtde_control"
"""Name of ur_rtde's control script, whose commands act in the cycle in which they arrive."""


class ScriptProgram:
    """A URScript program that runs in the controller.

    Attributes:
        name: name of the program.
        secondary: whether it runs beside the main program.
        direct: whether its commands act in the same control cycle, else in the next.
        links: its TCP/IP connections.
    """

    def __init__(self, controller: "Controller", code: Code) -> None:
        self.controller = controller
        self.arm: ControlledArm = controller.arm
        self._machine = Machine(code, self)
        self.name, self.secondary = code.name, code.secondary
        self.direct = code.name == _AT_ONCE
        self.links = Links(controller.address)
        self.history: deque[np.ndarray] = deque(maxlen=_HISTORY)
        self._mover: int | None = None
        self._watchdogs: dict[str, tuple[float, float, str]] = {}

    def cycle(self, now: float) -> bool:
        """Run the program for the control cycle at ``now`` [s]; return False when it has ended."""
        self.history.appendleft(self.arm.plant.q)
        late = self._late(now)
        if late == PAUSE:
            self._watchdogs.clear()
            self.controller.pause()
        if late:
            return late != STOP
        try:
            return self._machine.cycle()
        except ProgramEndsError:
            return False

    def close(self) -> None:
        """Close all TCP/IP connections that the program opened."""
        self.links.close()

    def watch(self, name: str, frequency: float, action: str) -> None:
        """Set a watchdog: if RTDE clients write the input called ``name`` less often than
        ``frequency`` [Hz], pause or stop the program (``action``: pause, stop; ignore: no
        watchdog). Raises a `ScriptFaultError` if there is no such input or action.
        """
        if name not in self.controller.inputs.fields:
            raise ScriptFaultError(f"there is no input {name}")
        if action.upper() not in (PAUSE, STOP, "IGNORE"):
            raise ScriptFaultError(f"no action {action} of a watchdog: PAUSE, STOP or IGNORE")
        self._watchdogs.pop(name, None)
        if action.upper() != "IGNORE":
            patience = 1.0 / max(frequency, 1e-3)
            self._watchdogs[name] = (patience, self.controller.now, action.upper())

    def _late(self, now: float) -> str:
        for name, (patience, since, action) in self._watchdogs.items():
            if now - max(since, self.controller.inputs.at.get(name, since)) > patience:
                return action
        return ""

    def during(self, motion: ArmMotion, steps: Iterator[None]) -> Iterator[None]:
        """Start a motion and run ``steps`` of the calling thread; if it is killed, the arm brakes.
        Raises a `ScriptFaultError` if another thread moves the arm.
        """
        thread = self._machine.current
        if self._mover is not None and self._mover != thread:
            raise ScriptFaultError("another thread is already controlling the robot")
        self._mover = thread
        try:
            if self.arm.motion is not motion:
                self.arm.start(motion)
            yield from steps
        except GeneratorExit:
            self.arm.release(motion)
            raise
        finally:
            self._mover = None

    def until_done(self, motion: ArmMotion) -> Iterator[None]:
        """Start a motion and wait until it ends or another one replaces it."""

        def lasting() -> Iterator[None]:
            while not motion.done and self.arm.moves_by(motion):
                yield

        yield from self.during(motion, lasting())

    def cycles(self, seconds: float) -> Iterator[None]:
        """Wait for a time [s], but at least one control cycle."""
        for _ in range(max(1, round(seconds / self.controller.settings.cycle))):
            yield

    def refuse(self, error: Event, why: str) -> Iterator[None]:
        """Trigger a protective stop with message ``error``; the program cannot continue after it.

        Raises:
            ScriptFaultError: with text ``why``; the stop was unlocked and the program played on.
        """
        self.controller.protective_stop(error)
        yield
        raise ScriptFaultError(why)


def dialled(
    controller: "Controller", links: Links, host: str, port: int, name: str
) -> Generator[None, None, Link | None]:
    """Open connection ``name`` of ``links`` and wait for it; None if not open within `DIAL_S`."""
    link, end = links.dial(host, port, name), controller.now + DIAL_S
    while link is not None and not (link.open or link.lost) and controller.now < end:
        yield
    return link if link is not None and link.open else None


class ExternalControl:
    """A program (External Control) whose URScript is fetched from a computer when it starts."""

    direct = False
    name = "external_control"

    def __init__(self, controller: "Controller") -> None:
        self._controller = controller
        self._links = Links(controller.address)
        self._steps = self._fetch()
        self._program: ScriptProgram | None = None

    def cycle(self, now: float) -> bool:
        """Fetch or run the program for the cycle at ``now`` [s]; return False when it has ended."""
        if self._program is None:
            next(self._steps, None)
            return True
        return self._program.cycle(now)

    def close(self) -> None:
        """End the program and close all its connections."""
        self._links.close()
        if self._program is not None:
            self._program.close()

    def _fetch(self) -> Iterator[None]:
        controller, (host, port) = self._controller, self._controller.settings.computer
        link = yield from dialled(controller, self._links, host, port, "program")
        if link is None or not link.send(_REQUEST):
            raise ScriptFaultError(f"External Control: no connection to {host}:{port}")
        text, heard, end = bytearray(), controller.now, controller.now + _ANSWER_S
        while not text or (not link.lost and controller.now - heard < _SILENT_S):
            data = link.all()
            if data:
                text += data
                heard = controller.now
            if _END in text or len(text) > 4 * LONGEST:
                break
            if not text and (link.lost or controller.now > end):
                raise ScriptFaultError(f"External Control: {host}:{port} sends no program")
            yield
        self._links.close()
        code = controller.compiling(text.decode("utf-8", "replace"))
        while not code.done():
            yield
        self._program = ScriptProgram(controller, code.result())
