"""What makes a drive stop by itself when its master falls silent.

Needed is the deadline of its targets (event timer of RPDO1, 0x1400:5); it is read back. The rest is
set where a drive has it: what it does when the connection breaks (0x6007), how it quick-stops
(0x605A), the master's heartbeat that it expects (0x1016), and that it takes no more targets after
a communication error (0x1029). Sources: CiA 301, CiA 402.
"""

import contextlib
from typing import Protocol

from wrenchbed.drivers.can import ids
from wrenchbed.drivers.can.options import HEARTBEAT_S, Options
from wrenchbed.errors import DriverError, LinkError

TIMER, ABORT, QUICK, EXPECTED, AFTER = 0x1400, 0x6007, 0x605A, 0x1016, 0x1029
_QUICK_STOP = 3
_RAMPS = (2, 6)
"""Options of 0x605A: the quick-stop ramp, then voltage off, or staying in QUICK STOP ACTIVE."""
_BEATS = 3


class Dictionary(Protocol):
    """Objects of drives, by node, index and subindex."""

    def read(self, node: int, index: int, sub: int) -> int:
        """A value; DriverError where the drive refuses, LinkError where it is silent."""

    def write(self, node: int, index: int, sub: int, value: int, size: int) -> None:
        """Likewise, of some bytes."""


class Guards:
    """Sets them, and knows who lacks what.

    Args:
        objects: of the drives.
        options: watchdog, ids.

    Attributes:
        unguarded: nodes whose targets have no deadline, with the reason.
        lacking: objects that nodes do not have or do not take.
    """

    def __init__(self, objects: Dictionary, options: Options) -> None:
        self._objects = objects
        self._watchdog = round(options.watchdog * 1000.0)
        beats = self._watchdog + round(_BEATS * HEARTBEAT_S * 1000.0)
        self._expected = ids.master(options.base, options.nodes) << 16 | beats
        self.unguarded: dict[int, str] = {}
        self.lacking: dict[int, set[int]] = {}
        self._expecting: set[int] = set()

    def deadline(self, node: int) -> None:
        """Set and check the deadline of a drive's targets, while its RPDO1 is switched off."""
        asked = self._watchdog
        self.unguarded.pop(node, None)
        try:
            self._objects.write(node, TIMER, 5, asked, 2)
            taken = self._objects.read(node, TIMER, 5)
        except LinkError:
            raise
        except DriverError as error:
            self.unguarded[node] = str(error)
            return
        if not 0 < taken <= 1.1 * asked + 1.0:
            self.unguarded[node] = (
                f"drive {node}, object 0x1400:5: it was told {asked} ms and has {taken} ms"
            )

    def further(self, node: int) -> None:
        """Set what else a drive has."""
        self._set(node, ABORT, 0, _QUICK_STOP, 2)
        if self._get(node, QUICK) not in _RAMPS:
            self._set(node, QUICK, 0, _RAMPS[1], 2)
        self._set(node, AFTER, 1, 0, 1)
        if self._set(node, EXPECTED, 1, self._expected, 4):
            self._expecting.add(node)

    def release(self) -> None:
        """Let no drive miss a heartbeat that ends as it should."""
        with contextlib.suppress(DriverError):
            while self._expecting:
                self._objects.write(self._expecting.pop(), EXPECTED, 1, 0, 4)

    @property
    def counters(self) -> dict[str, float]:
        """For health: how many drives are without an object."""
        return {f"without 0x{index:04X}": float(len(n)) for index, n in self.lacking.items() if n}

    def _get(self, node: int, index: int) -> int | None:
        try:
            return self._objects.read(node, index, 0)
        except LinkError:
            raise
        except DriverError:
            return None

    def _set(self, node: int, index: int, sub: int, value: int, size: int) -> bool:
        without = self.lacking.setdefault(index, set())
        without.discard(node)
        try:
            self._objects.write(node, index, sub, value, size)
        except LinkError:
            raise
        except DriverError:
            without.add(node)
            return False
        return True
