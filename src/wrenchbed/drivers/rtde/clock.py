"""How fast the controller's clock runs against this machine's; only the standard library.

States arrive late by what the network and this machine add, never early: of each half second the
one that was least late counts.
"""

from collections import deque

_BIN_S = 0.5
_BINS, _LEAST_BINS = 60, 8


class Clock:
    """Least squares over the last half minute of (arrival, stamp) [s]."""

    def __init__(self) -> None:
        self._best: deque[tuple[float, float]] = deque(maxlen=_BINS)
        self._begun: float | None = None
        self._least = (0.0, 0.0)

    def add(self, t: float, stamp: float) -> bool:
        """Take in a state; whether another half second is complete."""
        jump = abs((stamp - self._least[1]) - (t - self._least[0]))
        if self._begun is None or jump > _BIN_S:
            self._best.clear()
            self._begun, self._least = t, (t, stamp)
            return False
        if t - self._begun < _BIN_S:
            if t - stamp < self._least[0] - self._least[1]:
                self._least = (t, stamp)
            return False
        self._best.append(self._least)
        self._begun, self._least = t, (t, stamp)
        return True

    def drift(self) -> float:
        """Parts per million by which the controller's clock is faster; NaN for too short a time."""
        n = len(self._best)
        if n < _LEAST_BINS:
            return float("nan")
        t0, s0 = self._best[0]
        x = [t - t0 for t, _ in self._best]
        y = [(s - s0) - (t - t0) for t, s in self._best]
        mean_x, mean_y = sum(x) / n, sum(y) / n
        spread = sum((a - mean_x) ** 2 for a in x)
        return 1e6 * sum((a - mean_x) * (b - mean_y) for a, b in zip(x, y, strict=True)) / spread
