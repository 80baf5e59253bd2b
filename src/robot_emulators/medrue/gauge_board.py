"""The NETCANOEM board: six gauges of a Mini40 behind CAN requests. Source: ATI 9610-05-1030.

Everything is big endian; a CAN id is the board's base (7 bits) and an opcode (4 bits). The board
sends gauges, never wrenches: clients multiply them by the matrix of its active calibration, which
a reset changes. Of a request longer than expected the first byte counts: where the board's ids are
also those of a drive, that drive's targets act as requests.
"""

import random
import struct
from collections.abc import Callable, Mapping

import numpy as np

from robot_emulators.can_bus import Frame

COUNTS_PER_VOLT = 3276.8
"""Counts per volt of a 16-bit converter of ±10 V."""
NEWTON, NEWTON_METRE = 2, 3
SELECT, RESET, SET_BASE, SET_BITRATE = 0x6, 0xC, 0xD, 0xE
"""Opcodes of requests that change calibration, reset the board, change its ids or its bit rate."""
SLOTS = 16
BAD_CALIBRATION, ANY_ERROR = 1 << 6, 1 << 15
_OTHER_GAIN = 0.8
"""Factor on all gauges while another calibration than the mounted sensor's is active."""
_NOTHING = 0x100
"""Value that stands for the first byte of a request without data."""
BOOT_S = 0.1
"""Time in which the board is silent after a reset [s]; the manual states none."""
ActiveFault = Callable[[str], Mapping[str, float] | None]
"""Function of a kind of fault: its argument values while it is active, else None."""


class BoardEmulator:
    """Emulated NETCANOEM, ATI's sensor board, which answers gauge requests on a CAN bus.

    Args:
        send: puts a frame on the bus.
        base: upper seven bits of the board's CAN ids.
        slot: number, 0 … 15, of the calibration that is the mounted Mini40's.
        counts: counts per N and per N·m.
        wrench: function of the time [s] that returns the load on the gauges (6,) [N, N·m].
        gauges: matrix (6, 6) from gauges [V] to wrenches; None: 10 N or N·m per volt each.
        fault: function of a kind of fault: its argument values while it is active, else None.
    """

    def __init__(
        self, send: Callable[[Frame], None], base: int, slot: int, counts: int,
        wrench: Callable[[float], np.ndarray], gauges: np.ndarray | None = None,
        fault: ActiveFault = lambda kind: None,
    ) -> None:  # fmt: skip
        self._send, self._wrench, self._fault = send, wrench, fault
        self.base = self._next_base = base
        self.slot, self.counts = slot, counts
        self.active = self.status = 0
        self.silent_until = 0.0
        self._random = random.Random(0)
        self._matrix = 10.0 * np.eye(6) if gauges is None else gauges
        self._gauges = np.linalg.inv(self._matrix) * COUNTS_PER_VOLT

    def matrix(self) -> np.ndarray:
        """Active calibration (6, 6): maps gauge counts (6,) to counts of force and torque."""
        true = self._matrix / COUNTS_PER_VOLT * self.counts
        return np.asarray(true if self.active == self.slot else 0.5 * true, dtype=np.float32)

    def reset(self, now: float) -> None:
        """Restart at time ``now`` [s]: calibration 0 is active, a new base of ids takes effect."""
        self.active = self.status = 0
        self.base = self._next_base
        self.silent_until = now + BOOT_S

    def hear(self, t: float, frame: Frame) -> None:
        """Handle a CAN frame that arrives at time t [s]; requests to the board are answered."""
        if frame.extended or frame.can_id >> 4 != self.base:
            return
        if t < self.silent_until or self._fault("mute_board") is not None:
            return
        for op, reply in self._answer(t, frame.can_id & 0xF, frame.data):
            self._send(Frame(self.base << 4 | op, reply))

    def gauges(self, t: float) -> np.ndarray:
        """Gauge readings (6,) of the A/D converter at time t [s], −32768 … 32767 counts."""
        gain = 1.0 if self.active == self.slot else _OTHER_GAIN
        counts = np.rint(gain * self._gauges @ self._wrench(t))
        if (rail := self._fault("saturated_gauge")) is not None:
            counts[int(rail["gauge"])] = 32767
        return np.asarray(np.clip(counts, -32768, 32767), dtype=int)

    def _answer(self, t: float, opcode: int, data: bytes) -> list[tuple[int, bytes]]:
        first = data[0] if data else _NOTHING
        match opcode:
            case 0x0:
                return self._pair(self.gauges(t))
            case 0x2 if first < 6:
                row = self.matrix()[first].astype(">f4").tobytes()
                return [(2 + k, row[8 * k : 8 * k + 8]) for k in range(3)]
            case 0x6 if first < SLOTS:
                self._select(first)
                return [(6, data[:1])]
            case 0x7:
                return [(7, struct.pack(">II", self.counts, self.counts))]
            case 0x8:
                return [(8, bytes([NEWTON, NEWTON_METRE]))]
            case 0xC:
                self.reset(t)
                return []
            case 0xD if first < 0x80:
                self._next_base = first
                return [(0xD, b"")]
        return []

    def _select(self, slot: int) -> None:
        self.active = slot
        self.status &= ~BAD_CALIBRATION
        if slot not in (0, self.slot):
            self.status |= BAD_CALIBRATION

    def _pair(self, gauges: np.ndarray) -> list[tuple[int, bytes]]:
        """Opcode and data of the two frames that carry gauges (6,): the status word with gauges 0,
        2, 4, then gauges 1, 3, 5."""
        bits = self._fault("status")
        status = self.status | (int(bits["bits"]) if bits else 0)
        word = status | (ANY_ERROR if status & ~1 else 0)
        pair = [
            (0, struct.pack(">Hhhh", word, *map(int, gauges[::2]))),
            (1, struct.pack(">hhh", *map(int, gauges[1::2]))),
        ]
        lost = self._fault("second_frame_lost")
        if lost is not None and self._random.random() < lost["share"]:
            pair.pop()
        return pair[::-1] if self._fault("swapped_pair") is not None else pair
