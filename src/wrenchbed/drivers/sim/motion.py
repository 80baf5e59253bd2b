"""A simulated move: polled, awaited or cancelled in simulated time."""

from collections.abc import Callable, Iterator

import numpy as np

from wrenchbed.drivers.base import Motion, Reached
from wrenchbed.errors import DriverError, LateError

CONTROL_S = 0.008
"""Period of the position targets in a move [s]."""


class SimMotion(Motion):
    """A move of a simulated robot; each `poll` takes one control period of simulated time.

    Args:
        goal: joint values (J,).
        steps: where it is after each period; the last one lasts longer than nothing.
        halt: brings the robot to rest after some time on the way [s].
    """

    def __init__(
        self, goal: np.ndarray, steps: Iterator[Reached], halt: Callable[[float], None]
    ) -> None:
        self.goal = goal
        self._steps, self._stop = steps, halt
        self._taken = 0
        self._end: Reached | DriverError | None = None

    def poll(self) -> Reached | None:
        if self._end is None:
            try:
                at = next(self._steps)
            except DriverError as error:
                self._end = error
            else:
                self._taken += 1
                self._end = at if at.duration > 0.0 else None
        if isinstance(self._end, DriverError):
            raise self._end
        return self._end

    def wait(self, timeout: float | None = None) -> Reached:
        while (end := self.poll()) is None:
            if timeout is not None and self._taken * CONTROL_S > timeout:
                self._halt(LateError(f"the move did not arrive within {timeout:g} s"))
        return end

    def cancel(self) -> None:
        if self._end is None:
            self._halt(DriverError("the move was cancelled"))

    def _halt(self, why: DriverError) -> None:
        self._stop(self._taken * CONTROL_S)
        self._end = why
