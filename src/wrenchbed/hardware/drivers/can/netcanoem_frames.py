"""Frames of a NETCANOEM board, and gauge readings of two frames each.

Source: ATI 9610-05-1030, sections 7 and 10. The frames carry no number, so that at most one request
is sent at a time. A request without a complete answer is given up after `PATIENCE_S`; frames that
arrive after that and before the next request are dropped.
"""

import struct
from typing import Any, NamedTuple

GAUGES, ODD, MATRIX, SELECT, COUNTS, UNITS = 0, 1, 2, 6, 7, 8
"""Opcodes of requests and answers; a matrix row is answered by three frames, 2 to 4. Reset (0xC),
set base (0xD), set baud rate (0xE) are left out on purpose: the latter two outlast power."""
STATUS = (
    "watchdog reset", "converter high", "converter low", "artificial ground", "supply high",
    "supply low", "bad active calibration", "EEPROM", "configuration invalid", "", "",
    "temperature high", "temperature low", "", "CAN bus error", "any error",
)  # fmt: skip
"""Meaning of each bit of the board's status word, from bit 0."""
CRITICAL = 0b0001_1000_1111_1110
"""Status bits with which readings cannot be trusted, although the board sends them."""
BAD_CALIBRATION, WATCHDOG_RESET = 1 << 6, 1 << 0
PATIENCE_S = 0.02
"""Deadline of the two frames of an answer [s]; on the wire they take 0.3 ms at 1 Mbit/s, and a
stalled reader takes some milliseconds."""
_SHAPES = {
    GAUGES: struct.Struct(">Hhhh"), ODD: struct.Struct(">hhh"),
    MATRIX: struct.Struct(">ff"), 3: struct.Struct(">ff"), 4: struct.Struct(">ff"),
    SELECT: struct.Struct("B"), COUNTS: struct.Struct(">II"), UNITS: struct.Struct("BB"),
}  # fmt: skip
"""Opcode → layout of its answer: status word and gauges 0, 2, 4; gauges 1, 3, 5; two values of a
matrix row; slot of the active calibration; counts per unit of force and torque; codes of their
units."""
_OUTSTANDING = 250
"""Most unanswered requests that are counted: those of one second."""
_EXCESS_S, _EXCESS = 1.0, 2
"""Number of unrequested answers within a time [s] that reveal a second node; one may be late."""


class Reply(NamedTuple):
    """A reply frame of the sensor board: the opcode that it answers, and its values."""

    opcode: int
    values: tuple[Any, ...]


class GaugeReading(NamedTuple):
    """A complete gauge reading: arrival of its first frame [s], status word, gauges 0 … 5."""

    t: float
    status: int
    gauges: tuple[int, ...]


def parse(arbitration_id: int, data: bytes, base: int) -> Reply | None:
    """Decode a CAN frame as a reply of the board at ``base`` (upper seven id bits), None if
    none."""
    shape = _SHAPES.get(arbitration_id & 0xF)
    if arbitration_id >> 4 != base or shape is None or len(data) != shape.size:
        return None
    return Reply(arbitration_id & 0xF, shape.unpack(data))


def faults(status: int) -> tuple[str, ...]:
    """Describe the faults in the board's status word, one text each; empty without faults."""
    return tuple(name for bit, name in enumerate(STATUS[:15]) if name and status >> bit & 1) or (
        ("error without a name",) if status >> 15 & 1 else ()
    )


class Pairs:
    """Combines the two CAN frames of each gauge reading; counts lost or unexpected ones.

    Attributes:
        lost: requests without a complete answer.
        odd: frames that belong to no request or came in the wrong order.
    """

    def __init__(self) -> None:
        self.lost = self.odd = 0
        self._first: tuple[float, Reply] | None = None
        self._waiting = False
        self._outstanding = 0
        self._asked = 0.0
        self._excess: list[float] = []

    def poll(self, t: float) -> bool:
        """Whether to send a request at time t [s]; False while one is unanswered."""
        if self._waiting:
            if t - self._asked > PATIENCE_S:
                self.lost += 1
                self._waiting, self._first = False, None
            return False
        self._waiting, self._first, self._asked = True, None, t
        self._outstanding = min(self._outstanding + 1, _OUTSTANDING)
        return True

    def take(self, t: float, reply: Reply) -> GaugeReading | None:
        """Add a gauge frame (CAN) that arrived at t [s]; return the reading if it is complete."""
        if reply.opcode == GAUGES:
            self._count(t)
            if not self._waiting or self._first is not None:
                self.odd += 1
            if self._waiting:
                self._first = (t, reply)
            return None
        if self._first is None:
            self.odd += 1
            return None
        begun, first = self._first
        self._waiting, self._first = False, None
        (status, g0, g2, g4), (g1, g3, g5) = first.values, reply.values
        return GaugeReading(begun, status, (g0, g1, g2, g3, g4, g5))

    def clash(self, t: float) -> bool:
        """Whether answers outnumber requests at time t [s]: a second node uses the board's ids."""
        return sum(t - when < _EXCESS_S for when in self._excess) >= _EXCESS

    def _count(self, t: float) -> None:
        if self._outstanding > 0:
            self._outstanding -= 1
        else:
            self._excess = [*self._excess[-_EXCESS:], t]
