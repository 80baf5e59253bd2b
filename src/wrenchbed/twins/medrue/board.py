"""The NETCANOEM board: six gauges of a Mini40 behind CAN requests. Source: ATI 9610-05-1030.

Everything is big endian; an id is the board's base (7 bits) and an opcode (4 bits). The board sends
gauges, never wrenches: those come from the matrix of its active calibration, which is volatile.
"""

import struct
from collections.abc import Callable

import numpy as np

from wrenchbed.sensors.ati_mini40 import MATRIX
from wrenchbed.serving.canbus.wire import Frame

COUNTS_PER_VOLT = 3276.8
"""A 16-bit converter of ±10 V."""
NEWTON, NEWTON_METRE = 2, 3
SLOTS = 16
BAD_CALIBRATION, ANY_ERROR = 1 << 6, 1 << 15
_OTHER_GAIN = 0.8
BOOT_S = 0.1
"""How long it is silent after a reset [s]; an estimate."""


class Board:
    """The board at an address of the bus.

    Args:
        send: puts a frame on the bus.
        base: upper seven bits of its ids.
        slot: where the calibration of the mounted Mini40 is.
        counts: per N and per N·m.
        wrench: the load that the gauges feel at a time [s] → (6,).
    """

    def __init__(
        self, send: Callable[[Frame], None], base: int, slot: int, counts: int,
        wrench: Callable[[float], np.ndarray],
    ) -> None:  # fmt: skip
        self._send, self._wrench = send, wrench
        self.base = self._next_base = base
        self.slot, self.counts = slot, counts
        self.active = self.status = 0
        self.silent_until = 0.0
        self.mute = False
        self.railed: dict[int, float] = {}
        """Gauge → until when it is at the end of its range [s]."""
        self.spoil: Callable[[list[tuple[int, bytes]]], list[tuple[int, bytes]]] = lambda pair: pair
        """What happens to the two frames of a gauge reading on their way out."""
        self._gauges = np.linalg.inv(MATRIX) * COUNTS_PER_VOLT

    def matrix(self) -> np.ndarray:
        """Matrix (6, 6) of the active calibration, counts of unit per gauge count."""
        true = MATRIX / COUNTS_PER_VOLT * self.counts
        return np.asarray(true if self.active == self.slot else 0.5 * true, dtype=np.float32)

    def reset(self, now: float) -> None:
        """Restart: calibration 0 is active, and a new base takes effect."""
        self.active = self.status = 0
        self.base = self._next_base
        self.silent_until = now + BOOT_S

    def hear(self, t: float, frame: Frame) -> None:
        """Take a frame from the bus at a time [s]."""
        if frame.extended or frame.can_id >> 4 != self.base or self.mute or t < self.silent_until:
            return
        opcode, data = frame.can_id & 0xF, frame.data
        for op, reply in self._answer(t, opcode, data):
            self._send(Frame(self.base << 4 | op, reply))

    def gauges(self, t: float) -> np.ndarray:
        """What the converter reads (6,), −32768 … 32767."""
        gain = 1.0 if self.active == self.slot else _OTHER_GAIN
        counts = np.rint(gain * self._gauges @ self._wrench(t))
        for gauge, until in self.railed.items():
            if t < until:
                counts[gauge] = 32767
        return np.asarray(np.clip(counts, -32768, 32767), dtype=int)

    def _answer(self, t: float, opcode: int, data: bytes) -> list[tuple[int, bytes]]:
        match opcode:
            case 0x0:
                g = [int(v) for v in self.gauges(t)]
                first = struct.pack(">Hhhh", self._word(), g[0], g[2], g[4])
                return self.spoil([(0, first), (1, struct.pack(">hhh", g[1], g[3], g[5]))])
            case 0x2 if len(data) == 1 and data[0] < 6:
                row = self.matrix()[data[0]].astype(">f4").tobytes()
                return [(2 + k, row[8 * k : 8 * k + 8]) for k in range(3)]
            case 0x5:
                return [(5, b"FT12288\0")]
            case 0x6 if len(data) == 1 and data[0] < SLOTS:
                self._select(data[0])
                return [(6, data)]
            case 0x7:
                return [(7, struct.pack(">II", self.counts, self.counts))]
            case 0x8:
                return [(8, bytes([NEWTON, NEWTON_METRE]))]
            case 0x9 if len(data) == 1 and data[0] < 5:
                return [(9, struct.pack(">H", (2048, 1900, 2480, 2048, 0)[data[0]]))]
            case 0xC:
                self.reset(t)
                return []
            case 0xD if len(data) == 1 and data[0] < 0x80:
                self._next_base = data[0]
                return [(0xD, b"")]
            case 0xE if len(data) == 1:
                return [(0xE, b"")]
            case 0xF:
                return [(0xF, struct.pack(">BBH", 3, 8, 17))]
        return []

    def _select(self, slot: int) -> None:
        self.active = slot
        self.status &= ~BAD_CALIBRATION
        if slot not in (0, self.slot):
            self.status |= BAD_CALIBRATION

    def _word(self) -> int:
        return self.status | (ANY_ERROR if self.status & ~1 else 0)
