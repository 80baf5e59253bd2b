"""When an emulated sensor reports what its body computed, on this machine's clock."""


class Timeline:
    """The simulated time that a sensor reports at a time of this machine.

    A reading between two states is known only when the later one exists. The reported time is
    therefore one cycle behind, at least 8 ms (a block of samples at a time costs least), and 2 ms
    more because steps are not punctual. The delay is constant; a later state is waited for.
    """

    _SHORTEST_S, _SLACK_S = 8e-3, 2e-3

    def __init__(self, cycle: float) -> None:
        self._lag = max(cycle, self._SHORTEST_S) + self._SLACK_S
        self._offset = 0.0

    def observe(self, due: float, newest: float) -> None:
        """Take in the simulated time of the newest state, and when it was due here [s]."""
        self._offset = due - newest

    def simulated(self, host: float) -> float:
        """Simulated time reported at a time of this machine [s]."""
        return host - self._offset - self._lag
