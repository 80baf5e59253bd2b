"""A move under way: polled, awaited with a deadline, or cancelled."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Reached:
    """What a move really did: joint values (J,) and duration [s]."""

    q: np.ndarray
    duration: float


class Motion(ABC):
    """A move of a robot towards ``goal`` (J,)."""

    goal: np.ndarray

    @abstractmethod
    def poll(self) -> Reached | None:
        """Where it ended, None while it moves; never blocks.

        Raises:
            DriverError: it failed or was cancelled; the robot was told to stop.
        """

    @abstractmethod
    def wait(self, timeout: float | None = None) -> Reached:
        """Block until it ends; the move's own deadline if no timeout [s] is given.

        Raises:
            LateError: it did not arrive in time; the robot was told to stop.
            DriverError: it failed or was cancelled.
        """

    @abstractmethod
    def cancel(self) -> None:
        """Stop here and come to rest; harmless when it has ended."""
