"""A device's clock against this machine's: delays make readings late and never early, so of each
stretch of time only the least late reading counts."""

import math
from collections import deque

import numpy as np

SPAN_S, LEAST_S = 5.0, 2.0
"""Longest and shortest time of which a drift is fitted [s]: within 5 s the drift of a quartz is
steady; over 2 s a delay of 1 ms in one mark changes it by 500 ppm."""
_FEW = 4
"""Marks below which only the offset of the clocks is known: a slope through fewer is noise."""


class ClockFit:
    """Fits a line through the least late readings of the last `SPAN_S`.

    Args:
        stretch: of which one reading counts [s], so long that one of its readings is in time.
    """

    def __init__(self, stretch: float) -> None:
        self._stretch = stretch
        self._marks: deque[tuple[float, float]] = deque(maxlen=max(_FEW, round(SPAN_S / stretch)))
        self.clear()

    def clear(self) -> None:
        """Begin anew: the device's clock was set or restarted."""
        self._marks.clear()
        self._best: tuple[float, float] | None = None
        self._ends = -math.inf
        self._from = self._slope = 0.0
        self._offset = math.inf

    def add(self, device: float, host: float) -> None:
        """Take in a reading: its time on the device's clock and when it arrived, both [s]."""
        late = host - device
        if self._best is None or late < self._best[1]:
            self._best = (device, late)
        if len(self._marks) < _FEW:
            self._offset = min(self._offset, late)
        if device >= self._ends:
            self._marks.append(self._best)
            self._best, self._ends = None, device + self._stretch
            if len(self._marks) >= _FEW:
                marks = np.array(self._marks)
                self._from = float(marks[0, 0])
                line = np.polyfit(marks[:, 0] - self._from, marks[:, 1], 1)
                self._slope, self._offset = float(line[0]), float(line[1])

    def host(self, device: float) -> float:
        """When a reading of a time of the device arrives without extra delay [s]."""
        return device + self._offset + self._slope * (device - self._from)

    @property
    def ppm(self) -> float | None:
        """How much faster than this machine's clock it runs [1e-6]; None until `LEAST_S`."""
        long = len(self._marks) >= _FEW and self._marks[-1][0] - self._marks[0][0] >= LEAST_S
        return -1e6 * self._slope if long else None
