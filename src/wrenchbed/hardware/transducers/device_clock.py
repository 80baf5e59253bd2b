"""The clock of a sensor's electronics: a 32-bit counter, unwrapped, beside this machine's clock."""

import math
from collections import deque
from itertools import islice

import numpy as np


def signed(difference: int) -> int:
    """A difference of 32-bit counters, −2³¹ … 2³¹ − 1."""
    return (difference + 2**31) % 2**32 - 2**31


_EVERY_S, _SPAN_S, _LEAST_S = 0.1, 20.0, 2.0
"""Time between marks, longest and shortest span of a fit [s]; estimates."""
_RECENT = 20
"""Marks among which the least delay is sought: clocks drift apart in a longer time; estimate."""
_HELD_S = 0.1
"""Greatest delay of a reading; beyond it the clocks have jumped [s]; estimate."""


class DeviceClock:
    """A device's clock: a 32-bit counter over its rate, unwrapped; drift by the earliest arrivals.

    Args:
        rate: of the counter [Hz].

    Attributes:
        ppm: how much faster than this machine's clock it runs [1e-6]; None until 2 s are known.
    """

    def __init__(self, rate: float) -> None:
        self._rate = rate
        self._stamp: int | None = None
        self._samples = 0
        self._marks: deque[tuple[float, float]] = deque(maxlen=round(_SPAN_S / _EVERY_S))
        self._best: tuple[float, float] | None = None
        self._next, self._least = 0.0, math.inf
        self.ppm: float | None = None

    def take(self, host: float, stamp: int) -> float:
        """Device time [s] of a reading that arrived at a host time [s]."""
        step = 0 if self._stamp is None else signed(stamp - self._stamp)
        if step < 0:
            self._samples = 0
            self._marks.clear()
            self._best, self._least = None, math.inf
        self._samples = stamp if self._stamp is None or step < 0 else self._samples + step
        self._stamp = stamp
        device = self._samples / self._rate
        if self._best is None or host - device < self._best[0] - self._best[1]:
            self._best = (host, device)
            self._least = min(self._least, host - device)
        if host >= self._next:
            self._marks.append(self._best)
            self._best, self._next = None, host + _EVERY_S
            self.ppm = self._fit()
            self._least = min(h - d for h, d in islice(reversed(self._marks), _RECENT))
        return device

    def punctual(self, host: float, stamp: int) -> float:
        """When a reading that arrived at a host time [s] would have arrived without extra delay.

        A busy machine or network makes datagrams late and never early: the least late one of the
        last two seconds gives the delay that all have.
        """
        if self._stamp is None:
            return host
        device = (self._samples + signed(stamp - self._stamp)) / self._rate
        return min(host, max(device + self._least, host - _HELD_S))

    def _fit(self) -> float | None:
        marks = np.array(self._marks)
        if len(marks) < 4 or marks[-1, 0] - marks[0, 0] < _LEAST_S:
            return None
        host, device = (marks - marks[0]).T
        return float((np.polyfit(host, device, 1)[0] - 1.0) * 1e6)
