"""What a program is to the controller that plays it, and the controller to a program."""

from collections.abc import Callable
from typing import Protocol

import numpy as np

from robot_emulators.ur.arm import ControlledArm
from robot_emulators.ur.inputs import Inputs, Terminals
from robot_emulators.ur.messages import PROTECTIVE_STOP, Event
from robot_emulators.ur.packets import Values
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

    def protective_stop(self, error: Event = PROTECTIVE_STOP) -> None:
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
