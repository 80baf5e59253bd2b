"""This machine's time → simulated time of a body that someone else steps in real time."""


class Timeline:
    """The simulated time that a sensor shows at a time of this machine.

    What a body shows between two states is known only when the later one exists, so the time shown
    is one cycle behind, at least 8 ms (a block of samples at a time costs least), and 2 ms more
    since nobody steps punctually. The delay is constant: what comes later still is waited for.
    """

    _SHORTEST_S, _SLACK_S = 8e-3, 2e-3

    def __init__(self, cycle: float) -> None:
        self._lag = max(cycle, self._SHORTEST_S) + self._SLACK_S
        self._offset = 0.0

    def observe(self, due: float, newest: float) -> None:
        """Take in the simulated time of the newest state, and when it was due here [s]."""
        self._offset = due - newest

    def shown(self, host: float) -> float:
        """Simulated time shown at a time of this machine [s]."""
        return host - self._offset - self._lag
