"""Real time for a twin's cycle: deadlines on an absolute grid, real-time scheduling on request."""

import os
import time

GIVE_UP_S = 1.0
"""Lag beyond which lost cycles are not made up for [s]."""


class Clock:
    """Deadlines every ``period`` seconds of `time.monotonic`, without drift.

    A loop that is late gets the deadlines that it missed at once, one after the other, until it
    has caught up; after more than `GIVE_UP_S` the rest is forgotten and counted in `lost`.
    """

    def __init__(self, period: float) -> None:
        self.period = period
        self.lost = 0.0
        self._start = time.monotonic()
        self._cycles = 0

    @property
    def due(self) -> float:
        """Deadline of the next cycle [s]."""
        return self._start + (self._cycles + 1) * self.period

    @property
    def remaining(self) -> float:
        """Time until the next deadline [s], 0 where it has passed."""
        return max(0.0, self.due - time.monotonic())

    def advance(self) -> int:
        """Count one cycle as done; how many more deadlines have passed already."""
        self._cycles += 1
        behind = time.monotonic() - self._start - self._cycles * self.period
        if behind > GIVE_UP_S:
            self._start += behind
            self.lost += behind
            return 0
        return max(0, int(behind / self.period))


def take_priority(priority: int = 50) -> bool:
    """Give the calling thread the real-time policy SCHED_FIFO; whether the system allowed it."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except (OSError, AttributeError):
        return False
    return True
