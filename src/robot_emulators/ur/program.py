"""What a program is to the controller that plays it."""

from typing import Protocol

import numpy as np

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
