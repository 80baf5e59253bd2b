"""Looks at the box's own page now and then: was its scaling changed, did it take the new zero?"""

import threading
from collections.abc import Callable

from wrenchbed.errors import DriverError
from wrenchbed.transducers.netft.configuration import Configuration

EVERY_S = 5.0
"""Time between two looks [s]."""
_AFTER_ZERO_S = 0.1


class Watch:
    """A thread that compares what the box says with what it said at connect.

    Attributes:
        failures: looks that got no page.
        wrong: what is wrong in words, empty if nothing is.
    """

    def __init__(self, first: Configuration, look: Callable[[], Configuration]) -> None:
        self._first, self._look = first, look
        self._bias = first.bias
        self._zeroed = False
        self.failures = 0
        self.wrong = ""
        self._wake, self._ended = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run, name="netft watch", daemon=True)

    def start(self) -> None:
        """Look from now on."""
        self._thread.start()

    def stop(self) -> None:
        """End the thread."""
        self._ended.set()
        self._wake.set()
        if self._thread.is_alive():
            self._thread.join(2.0)

    def zeroed(self) -> None:
        """A new zero was asked for: look soon whether the box has it."""
        self._zeroed = True
        self._wake.set()

    def _run(self) -> None:
        while not self._ended.is_set():
            if self._wake.wait(EVERY_S):
                self._wake.clear()
                if self._ended.wait(_AFTER_ZERO_S):
                    return
            self._compare()

    def _compare(self) -> None:
        try:
            now = self._look()
        except DriverError:
            self.failures += 1
            return
        asked, self._zeroed = self._zeroed, False
        self.wrong = now.differs(self._first)
        if asked and now.bias and now.bias == self._bias and not self.wrong:
            self.wrong = "the box did not take the new zero: call zero() again"
        self._bias = now.bias
