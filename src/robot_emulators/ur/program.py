"""Programs on the controller, and the one that is not interpreted: ur_rtde's control script.

The control script is a loop that reads a command from an input register in each control cycle,
and threads that move the arm. Here a command is a generator that yields once a cycle until it is
done. Only one thread may move the arm; a second one ends the program.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import Protocol

import numpy as np

from robot_emulators.ur.arm import ControlledArm
from robot_emulators.ur.inputs import Inputs, Terminals
from robot_emulators.ur.messages import PROTECTIVE_STOP, Error, Event
from robot_emulators.ur.motions import ArmMotion
from robot_emulators.ur.packets import Values
from robot_emulators.ur.script import MOST, ScriptMove
from robot_emulators.ur.settings import ControllerSettings
from robot_emulators.ur.tool_wrench import ExternalWrench, WrenchEstimate

CONTACT_FORCE = 10.0
"""Force against the direction of motion from which the tool touches something [N]."""
_CYCLES_BACK = 3


def touching(wrench: np.ndarray, direction: np.ndarray) -> int:
    """Cycles since something began to push against a direction; 0 where nothing does.

    Args:
        wrench: at the tool, base axes (6,) [N, N·m].
        direction: of the base axes, any length; its first three of (6,) count.
    """
    length = float(np.linalg.norm(direction[:3]))
    if length < 1e-9:
        return 0
    against = -float(wrench[:3] @ direction[:3]) / length
    return _CYCLES_BACK if against > CONTACT_FORCE else 0


READY, DONE = 1, 2
STOP_SCRIPT = 255
AT_ONCE = frozenset((6, 9, 10, 11, 24, 25, 26, 27, 38, 58, *range(66, 72)))
"""Commands that the script carries out in every cycle in which it reads them."""
_RUNNING = 1 << 15
_CONTACT_FOUND = 254

Steps = Iterator[None]
"""A command under way: one `next` a control cycle."""
Command = Callable[["ControlProgram"], Steps | None]


class ProgramError(Exception):
    """A runtime error of the script, which ends it.

    Attributes:
        line, column: of its text, from 1; 0 where nobody knows.
    """

    def __init__(self, text: str, line: int = 0, column: int = 0) -> None:
        super().__init__(text)
        self.line, self.column = line, column


class Host(Protocol):
    """What a program reads and does on the controller that plays it."""

    settings: ControllerSettings
    arm: ControlledArm
    estimate: WrenchEstimate
    inputs: Inputs
    fields: dict[str, str]
    values: dict[str, Values]
    terminals: Terminals
    external: ExternalWrench
    announce: Callable[[Event], None]
    address: str
    now: float
    popup: bool
    freedrive: bool

    def set_output(self, kind: str, number: int, value: float) -> None:
        """Write an output register."""
        ...

    def protective_stop(self, error: Error = PROTECTIVE_STOP) -> None:
        """Brake at once."""
        ...

    def pause(self) -> bool:
        """Brake and hold the program."""
        ...


class Program(Protocol):
    """A program that plays.

    Attributes:
        name: as it is reported.
        direct: what it commands is done in the same control cycle, else in the next.
    """

    name: str
    direct: bool

    def cycle(self, now: float) -> bool:
        """Take one control cycle; False at its end.

        Raises:
            ProgramError: it cannot go on.
        """
        ...

    def close(self) -> None:
        """It is over."""
        ...


class ControlProgram:
    """ur_rtde's control script as a state machine on registers.

    Args:
        controller: it plays there.
        commands: number → what it does.
        offset: of its registers.
        path: moves that a client put into it.
    """

    name, direct = "rtde_control", True

    def __init__(
        self,
        controller: Host,
        commands: Mapping[int, Command],
        offset: int,
        path: tuple[ScriptMove, ...],
    ) -> None:
        self.controller, self.arm = controller, controller.arm
        self.path = path
        self.streaming: ArmMotion | None = None
        """What a side thread drives until it is stopped: servoj, speedj, jog."""
        self.contact_direction: np.ndarray | None = None
        self.contact_back = 0
        self._commands = commands
        self._offset = offset
        self._writes = self._operations = 0
        self._executing = False
        self._main: Steps | None = None
        self._side: Steps | None = None
        self._side_motion: ArmMotion | None = None
        self._watchdog: tuple[float, float] | None = None
        self._started = False

    @property
    def _command_register(self) -> str:
        return f"input_int_register_{self._offset}"

    def cycle(self, now: float) -> bool:
        """Take one control cycle; False where the script ends."""
        if not self._started:
            self._started = True
            self.progress(-1)
            self._say(READY)
        if self._timed_out(now):
            return False
        if self._side is not None and next(self._side, "over") == "over":
            self._side = self._side_motion = None
            self.progress(-1)
        if self._main is not None:
            if next(self._main, "over") != "over":
                return True
            self._main = None
            self._say(DONE)
        return self._hear()

    def close(self) -> None:
        """Nothing is held."""

    def _hear(self) -> bool:
        command = self.integer(0)
        if command == 0:
            self._executing = False
            if self._touched():
                self._main = self._process(_CONTACT_FOUND)
                return True
            self._say(READY)
            return True
        if command in AT_ONCE:
            self._process(command)
            self._say(READY)
            return True
        if self._executing:
            return True
        self._executing = True
        if command == STOP_SCRIPT:
            return False
        self._main = self._process(command)
        if self._main is None:
            self._say(DONE)
        elif next(self._main, "over") == "over":
            self._main = None
            self._say(DONE)
        return True

    def _touched(self) -> bool:
        """Whether the contact thread sees something now; it ends with it."""
        if self.contact_direction is None:
            return False
        direction = self.contact_direction
        if not direction.any():
            direction = self.arm.kinematics.jacobian(self.arm.q, self.arm.tcp) @ self.arm.qd
        back = touching(self.controller.estimate.wrench, direction)
        if back:
            self.contact_direction, self.contact_back = None, back
        return back > 0

    def _process(self, command: int) -> Steps | None:
        handler = self._commands.get(command)
        return None if handler is None else handler(self)

    def integer(self, number: int) -> int:
        """An input integer register.

        Raises:
            ProgramError: there is no such register.
        """
        return int(self._input("int", number))

    def doubles(self, first: int, count: int = 6) -> np.ndarray:
        """Input double registers (count,).

        Raises:
            ProgramError: one does not exist, or holds what no quantity of a robot can be.
        """
        values = [self._input("double", first + k) for k in range(count)]
        if not all(abs(value) <= MOST for value in values):
            raise ProgramError(f"input double registers hold {values}")
        return np.array(values)

    def answer(self, values: np.ndarray) -> None:
        """Write output double registers from 0 on."""
        for k, value in enumerate(values.tolist()):
            self.controller.set_output("double", k + self._offset, value)

    def answer_integer(self, value: int) -> None:
        """Write the result register."""
        self.controller.set_output("int", 1 + self._offset, value)

    def progress(self, value: int) -> None:
        """Write the status of asynchronous operations; 0 starts one, −1 ends it."""
        self._writes = (self._writes + 1) % 128
        if value == 0:
            self._operations = (self._operations + 1) % 128
        word = self._writes << 16 | self._operations << 24
        if value >= 0:
            word += min(value, _RUNNING - 1) + _RUNNING
        self.controller.set_output("int", 2 + self._offset, word)

    def take_control(self, motion: ArmMotion) -> None:
        """Let the main thread or a side thread move the arm.

        Raises:
            ProgramError: another thread moves it.
        """
        if self.streaming is not None:
            raise ProgramError("another thread is already controlling the robot")
        self.arm.start(motion)

    def stream(self, kind: type[ArmMotion], make: Callable[[], ArmMotion]) -> ArmMotion:
        """The motion that a side thread drives, started on first use.

        Raises:
            ProgramError: another thread moves the arm.
        """
        if isinstance(self.streaming, kind) and type(self.streaming) is kind:
            return self.streaming
        if self.streaming is not None or self._side is not None:
            raise ProgramError("another thread is already controlling the robot")
        self.streaming = make()
        return self.streaming

    def side(self, steps: Steps) -> None:
        """Go on with an asynchronous operation beside the main loop."""
        self.progress(0)
        self._side = steps

    def drives(self, motion: ArmMotion) -> None:
        """The asynchronous operation drives this motion now."""
        self._side_motion = motion

    def end_side(self) -> None:
        """Kill the asynchronous operation, if one is under way."""
        if self._side is not None:
            self._side = None
            self.arm.release(self._side_motion)
            self._side_motion = None
            self.progress(-1)

    def watch(self, frequency: float) -> None:
        """Stop the program when the command register is written less often [Hz]; 0: never."""
        start = self.controller.now
        self._watchdog = (1.0 / frequency, start) if frequency > 0.0 else None

    def _timed_out(self, now: float) -> bool:
        if self._watchdog is None:
            return False
        patience, since = self._watchdog
        last = max(since, self.controller.inputs.at.get(self._command_register, since))
        return now - last > patience

    def _say(self, state: int) -> None:
        self.controller.set_output("int", self._offset, state)

    def _input(self, kind: str, number: int) -> float:
        name = f"input_{kind}_register_{number + self._offset}"
        value = self.controller.inputs.values.get(name)
        if value is None:
            raise ProgramError(f"there is no {name}")
        return float(value[0])
