"""The two frames of a gauge reading, put together: never from two requests.

The frames carry no number, so there is never more than one request under way. One without a whole
answer is given up after `PATIENCE_S`; what still comes until the turn after that is thrown away.
"""

from typing import NamedTuple

from wrenchbed.transducers.netcanoem.frames import EvenGauges, OddGauges

PATIENCE_S = 0.02
"""How long the two frames of an answer may take [s]; on the wire they take 0.3 ms at 1 Mbit/s."""
_OUTSTANDING = 250
_EXCESS_S = 1.0
_EXCESS = 2


class Reading(NamedTuple):
    """A whole reading: arrival of its first frame [s], status word, gauges 0 … 5."""

    t: float
    status: int
    gauges: tuple[int, ...]


class Pairs:
    """Counts what it drops.

    Attributes:
        lost: requests without a whole answer.
        odd: frames that belong to no request or came in the wrong order.
    """

    def __init__(self) -> None:
        self.polls = self.lost = self.odd = 0
        self._first: tuple[float, EvenGauges] | None = None
        self._waiting = False
        self._outstanding = 0
        self._asked = 0.0
        self._excess: list[float] = []

    def poll(self, t: float) -> bool:
        """It is time for a request, at a time [s]: whether to send one."""
        if self._waiting:
            if t - self._asked > PATIENCE_S:
                self.lost += 1
                self._waiting, self._first = False, None
            return False
        self.polls += 1
        self._waiting, self._first, self._asked = True, None, t
        self._outstanding = min(self._outstanding + 1, _OUTSTANDING)
        return True

    def take(self, t: float, frame: EvenGauges | OddGauges) -> Reading | None:
        """A frame that arrived at a time [s]; the reading that it completes."""
        if isinstance(frame, EvenGauges):
            self._count(t)
            if not self._waiting or self._first is not None:
                self.odd += 1
            if self._waiting:
                self._first = (t, frame)
            return None
        if self._first is None:
            self.odd += 1
            return None
        begun, first = self._first
        self._waiting, self._first = False, None
        (g0, g2, g4), (g1, g3, g5) = first.values, frame.values
        return Reading(begun, first.status, (g0, g1, g2, g3, g4, g5))

    def clash(self, t: float) -> bool:
        """Whether more answers came than were asked for: a second node uses the board's ids."""
        return sum(t - when < _EXCESS_S for when in self._excess) >= _EXCESS

    def _count(self, t: float) -> None:
        if self._outstanding > 0:
            self._outstanding -= 1
        else:
            self._excess = [*self._excess[-_EXCESS:], t]
