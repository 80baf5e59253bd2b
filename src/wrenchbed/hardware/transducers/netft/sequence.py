"""The two counters of RDT records: new, late, doubled and lost records."""

from collections.abc import Sequence

from wrenchbed.hardware.transducers.device_clock import signed

_WINDOW = 64
"""How late a record may come [records]."""
_MISSING = 4096
"""Gaps remembered, to know a late record from a doubled one."""
_AFTER = 8
"""A jump is believed once a record follows it so closely."""


class Tracker:
    """Follows one stream of records; a far jump is believed only when the next record confirms it.

    Attributes:
        lost: records that never came, known from gaps.
        duplicates, late, implausible: records that were left out, or came out of order.
        jumps: of rdt_sequence, which starts again with every request.
        restarts: of the device, whose ft_sequence went back.
    """

    def __init__(self, rate: float, every: float) -> None:
        self._far = max(1000, round(rate))
        self._every = every
        self._last = (0, 0)
        self._begun = False
        self._asked = True
        self._jump: tuple[int, int] | None = None
        self._missing: dict[int, None] = {}
        self.lost = self.duplicates = self.late = self.implausible = 0
        self.jumps = self.restarts = 0

    @property
    def last(self) -> tuple[int, int]:
        """(rdt_sequence, ft_sequence) of the newest record."""
        return self._last

    def asked(self) -> None:
        """A new request was sent: the stream may begin again at 1."""
        self._asked = True

    def take(self, numbers: Sequence[tuple[int, int]]) -> list[int] | None:
        """Indices of the records to keep, in order; None when all are, one after the other."""
        first, n = self._last[0] + 1, len(numbers)
        if (
            self._begun
            and not self._asked
            and numbers[0][0] == first
            and all(rdt == first + k for k, (rdt, _) in enumerate(numbers))
        ):
            self._last = numbers[n - 1]
            self._jump = None
            return None
        return [k for k, pair in enumerate(numbers) if self._keep(pair)]

    def _keep(self, pair: tuple[int, int]) -> bool:
        ahead = signed(pair[0] - self._last[0])
        if self._asked and pair[0] == 1 and self._begun and ahead <= 0:
            self._begin(pair)
        elif 0 < ahead <= self._far:
            self._asked = self._asked and self._begun
            self._gap(self._last[0], ahead)
            self._last, self._begun, self._jump = pair, True, None
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
            samples = signed(pair[1] - self._last[1])
            if samples > 0:
                self.lost += max(0, round(samples / self._every) - 1)
            else:
                self.restarts += 1
        self.jumps += 1
        self._asked, self._begun = False, True
        self._last, self._jump = pair, None
        self._missing.clear()
