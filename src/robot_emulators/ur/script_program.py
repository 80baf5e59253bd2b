"""A program in URScript that plays: what its functions act on, and who of its threads moves."""

from collections import deque
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from robot_emulators.ur.links import Links
from robot_emulators.ur.messages import Event
from robot_emulators.ur.motions import ArmMotion
from robot_emulators.ur.urscript.machine import Machine
from robot_emulators.ur.urscript.translation import Code
from robot_emulators.ur.urscript.values import ProgramEndsError, ScriptFaultError

if TYPE_CHECKING:
    from robot_emulators.ur.arm import ControlledArm
    from robot_emulators.ur.controller import Controller

_HISTORY = 512
"""Control cycles whose joint values a program can ask for."""
PAUSE, STOP = "PAUSE", "STOP"
_AT_ONCE = "rtde_control"
"""ur_rtde's control script: clients that stream targets count on being heard in the same cycle."""


class ScriptProgram:
    """Plays a program.

    Attributes:
        name: of the program.
        secondary: it runs beside the program that plays.
        direct: what it commands is done in the same control cycle, else in the next.
        links: its TCP connections.
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
        """Take one control cycle; False at its end."""
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
        """Close all connections that the program opened."""
        self.links.close()

    def watch(self, name: str, frequency: float, action: str) -> None:
        """Pause or stop where an input is written less often [Hz].

        Raises:
            ScriptFaultError: there is no such input or action.
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
        """Move the arm while a thread waits for steps; a thread that is killed lets it brake.

        Raises:
            ScriptFaultError: another thread moves the arm.
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
        """Wait for a motion's end, or until another takes its place."""

        def lasting() -> Iterator[None]:
            while not motion.done and self.arm.moves_by(motion):
                yield

        yield from self.during(motion, lasting())

    def cycles(self, seconds: float) -> Iterator[None]:
        """Wait for a time, a control cycle at least."""
        for _ in range(max(1, round(seconds / self.controller.settings.cycle))):
            yield

    def refuse(self, error: Event, why: str) -> Iterator[None]:
        """A protective stop; the program cannot go on after it.

        Raises:
            ScriptFaultError: someone lets it go on.
        """
        self.controller.protective_stop(error)
        yield
        raise ScriptFaultError(why)
