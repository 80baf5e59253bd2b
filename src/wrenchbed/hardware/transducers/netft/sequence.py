"""The two counters of RDT records: lost, late and doubled records, and the clock of the box."""

import math
from collections import deque
from collections.abc import Sequence
from itertools import islice

import numpy as np

_WINDOW = 64
"""How late a record may come [records]; a network swaps neighbours."""
_MISSING = 4096
"""Numbers of missing records that are remembered, to tell a late record from a doubled one."""
_AFTER = 8
"""Records within which another one must follow a jump before it is believed."""
_MARK_S, _SPAN_S, _LEAST_S = 0.1, 20.0, 2.0
"""Time between two marks of a clock, longest and shortest span of the fit through them [s]: over
2 s a delay of 1 ms in one mark changes the drift by 500 ppm, over 20 s by 50 ppm."""
_RECENT = 20
"""Marks among which the least delay is sought: in these 2 s clocks drift apart by microseconds."""
_HELD_S = 0.1
"""Greatest delay of a reading [s]; where the clocks are further apart one of them has jumped."""


def signed(difference: int) -> int:
    """A difference of 32-bit counters, −2³¹ … 2³¹ − 1."""
    return (difference + 2**31) % 2**32 - 2**31


class Tracker:
    """Follows one stream of records; a far jump is believed only when the next record confirms it.

    Args:
        rate: of the records [Hz].
        every: samples of the box from one record to the next.

    Attributes:
        last: (rdt_sequence, ft_sequence) of the newest record.
        lost: records that never came, known from gaps.
        duplicates, late, implausible: records that were left out, or came out of order.
        jumps: of rdt_sequence, which starts again with every request.
        restarts: of the device, whose ft_sequence went back.
    """

    def __init__(self, rate: float, every: float) -> None:
        self.last = (0, 0)
        self.lost = self.duplicates = self.late = self.implausible = 0
        self.jumps = self.restarts = 0
        self._far = max(1000, round(rate))
        self._every = every
        self._begun = False
        self._asked = True
        self._jump: tuple[int, int] | None = None
        self._missing: dict[int, None] = {}

    def asked(self) -> None:
        """A new request was sent: the stream may begin again at 1."""
        self._asked = True

    def take(self, numbers: Sequence[tuple[int, int]]) -> list[int] | None:
        """Indices of the records to keep, in order; None when all are, one after the other."""
        first = self.last[0] + 1
        if (
            self._begun
            and not self._asked
            and numbers[0][0] == first
            and all(rdt == first + k for k, (rdt, _) in enumerate(numbers))
        ):
            self.last = numbers[-1]
            self._jump = None
            return None
        return [k for k, pair in enumerate(numbers) if self._keep(pair)]

    def _keep(self, pair: tuple[int, int]) -> bool:
        ahead = signed(pair[0] - self.last[0])
        if self._asked and pair[0] == 1 and self._begun and ahead <= 0:
            self._begin(pair)
        elif 0 < ahead <= self._far:
            self._asked = self._asked and self._begun
            self._gap(self.last[0], ahead)
            self.last, self._begun, self._jump = pair, True, None
        elif -_WINDOW <= ahead <= 0:
            if pair[0] not in self._missing:
                self.duplicates += 1
                return False
            del self._missing[pair[0]]
            self.lost -= 1
            self.late += 1
        elif self._jump is not None and 0 < signed(pair[0] - self._jump[0]) <= _AFTER:
            self.implausible -= 1
            self._begin(self._jump)
            return self._keep(pair)
        else:
            self._jump = pair
            self.implausible += 1
            return False
        return True

    def _gap(self, last: int, ahead: int) -> None:
        self.lost += ahead - 1
        for k in range(max(1, ahead - _WINDOW), ahead):
            self._missing[(last + k) % 2**32] = None
        while len(self._missing) > _MISSING:
            del self._missing[next(iter(self._missing))]

    def _begin(self, pair: tuple[int, int]) -> None:
        """The stream goes on elsewhere; the device's own clock tells what was lost between."""
        if self._begun:
            samples = signed(pair[1] - self.last[1])
            if samples > 0:
                self.lost += max(0, round(samples / self._every) - 1)
            else:
                self.restarts += 1
        self.jumps += 1
        self._asked, self._begun = False, True
        self.last, self._jump = pair, None
        self._missing.clear()


class DeviceClock:
    """A device's clock: a 32-bit counter over its rate, unwrapped; drift by the earliest arrivals.

    Args:
        rate: of the counter [Hz].

    Attributes:
        ppm: how much faster than this machine's clock it runs [1e-6]; None until 2 s are known.
    """

    def __init__(self, rate: float) -> None:
        self.ppm: float | None = None
        self._rate = rate
        self._stamp: int | None = None
        self._samples = 0
        self._marks: deque[tuple[float, float]] = deque(maxlen=round(_SPAN_S / _MARK_S))
        self._best: tuple[float, float] | None = None
        self._next, self._least = 0.0, math.inf

    def take(self, host: float, stamp: int) -> float:
        """Device time [s] of a reading that arrived at a host time [s]."""
        step = 0 if self._stamp is None else signed(stamp - self._stamp)
        if step < 0:
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
            self._best, self._next = None, host + _MARK_S
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
