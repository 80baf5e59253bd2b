"""Real time for an emulator's cycle: deadlines on an absolute grid; threads that yield to it."""

import gc
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

GIVE_UP_S = 1.0
"""Lag beyond which lost cycles are not made up for [s]."""
_SWITCH_S = 2e-3
"""Longest that another thread keeps Python's lock from a real-time thread [s], half a cycle; a
tenth of it makes late answers more frequent."""
_JOIN_S = 2.0


class CycleClock:
    """Deadlines every ``period`` seconds of `time.monotonic`, without drift.

    A loop that is late gets the deadlines that it missed at once, one after the other, until it
    has caught up; after more than ``give_up`` seconds the lag is forgotten and counted in `lost`.
    """

    def __init__(self, period: float, give_up: float = GIVE_UP_S) -> None:
        self.period = period
        self.lost = 0.0
        self._give_up = give_up
        self._begun = time.monotonic()
        self._cycles = 0

    @property
    def due(self) -> float:
        """Deadline of the next cycle, in `time.monotonic` seconds."""
        return self._begun + (self._cycles + 1) * self.period

    @property
    def remaining(self) -> float:
        """Time until the next deadline [s], 0 if it has passed."""
        return max(0.0, self.due - time.monotonic())

    def advance(self) -> int:
        """Count a cycle as done; return how many later deadlines have passed already."""
        self._cycles += 1
        behind = time.monotonic() - self._begun - self._cycles * self.period
        if behind > self._give_up:
            self._begun += behind
            self.lost += behind
            return 0
        return max(0, int(behind / self.period))


class CycleThread:
    """A thread that calls ``step(due)`` every ``period`` [s], due at a `time.monotonic` time. Calls
    missed by more than ``give_up`` [s] are left out; ``failed`` gets an error that ends it."""

    def __init__(
        self,
        name: str,
        period: float,
        give_up: float,
        step: Callable[[float], None],
        failed: Callable[[Exception], None],
    ) -> None:
        self._period, self._give_up = period, give_up
        self._step, self._failed = step, failed
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        """Stop and join the thread; may be called twice."""
        self._stopped.set()
        if self._thread.is_alive():
            self._thread.join(_JOIN_S)

    def _run(self) -> None:
        try:
            clock = CycleClock(self._period, self._give_up)
            while not self._stopped.is_set():
                time.sleep(clock.remaining)
                clock.advance()
                self._step(clock.due - self._period)
        except Exception as error:
            self._failed(error)


@contextmanager
def given_way() -> Iterator[None]:
    """Keep other Python code from delaying this process's real-time threads during the block.

    Threads switch more often, and objects that exist already are left out of garbage collection: a
    full collection of this package's modules stops every thread for some 50 ms.
    """
    before = sys.getswitchinterval()
    sys.setswitchinterval(_SWITCH_S)
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()
        sys.setswitchinterval(before)
