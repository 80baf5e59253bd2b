"""This machine's time → simulated time of a body that someone else steps in real time."""


class Timeline:
    """Follows a body's clock from below, so that the times it shows exist already.

    A body has states at whole cycles. What it shows between two of them is known only when the
    later one exists, so the time shown is one cycle behind, at least 8 ms (a block of samples at
    a time costs least), and 1 ms more since nobody steps punctually: up to 7 ms where the
    stepping is late again and again.
    """

    _CREEP = 1e-3
    _JUMP_S = 0.1
    _SHORTEST_S = 8e-3
    _SLACK_S, _MORE_S, _MOST_S = 1e-3, 5e-4, 7e-3
    _RELAX = 1e-4

    def __init__(self, cycle: float) -> None:
        self._lag = max(cycle, self._SHORTEST_S)
        self._slack = self._SLACK_S
        self._offset: float | None = None

    def observe(self, now: float, newest: float) -> None:
        """Take in that the newest state has a simulated time, at a time of this machine [s]."""
        seen = now - newest
        if self._offset is None or seen < self._offset or seen > self._offset + self._JUMP_S:
            self._offset = seen
        else:
            self._offset += self._CREEP * (seen - self._offset)
        self._slack += self._RELAX * (self._SLACK_S - self._slack)

    def late(self) -> None:
        """A time was shown before its state existed: keep more distance for a while."""
        self._slack = min(self._slack + self._MORE_S, self._MOST_S)

    def shown(self, host: float) -> float:
        """Simulated time shown at a time of this machine [s]."""
        return host - (self._offset or 0.0) - self._lag - self._slack
