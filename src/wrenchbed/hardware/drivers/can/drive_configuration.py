"""Configuration of the drives by CANopen SDO: identity, process data, periods and watchdogs.

Library canopen does the SDO transfers only; the one reader of the bus passes their answers to it.
The cyclic exchange is in ``cycle.py``, drives' states are in ``cia402.py``.

A drive must stop when its master falls silent. The deadline of its targets (event timer of RPDO1,
0x1400:5) is required and read back. Where a drive has them, these are set too: its reaction to a
broken connection (0x6007), its quick stop (0x605A), the expected heartbeat of the master (0x1016),
and its state after a communication error (0x1029). Sources of all object numbers: CiA 301, CiA 402.
"""

import contextlib
import logging
import struct
from collections.abc import Sequence
from typing import Any

from wrenchbed.errors import DriverError, LinkError
from wrenchbed.hardware.drivers.can import options as ids
from wrenchbed.hardware.drivers.can.bus import CanLink
from wrenchbed.hardware.drivers.can.options import HEARTBEAT_S, CanOptions
from wrenchbed.registry import require

ANSWER_S, TRIES = 0.3, 3
"""Deadline of an SDO answer [s], which takes a millisecond on a free bus, and number of attempts,
since a frame may be lost."""
TIMER, ABORT, QUICK, EXPECTED, AFTER = 0x1400, 0x6007, 0x605A, 0x1016, 0x1029
"""Objects by which a drive stops by itself: see the module's text."""
PRE_OPERATIONAL, START = 0x80, 0x01
"""NMT commands; source: CiA 301."""
_QUICK_STOP = 3
"""Value of 0x6007: quick stop when the connection breaks; source: CiA 402."""
_RAMPS = (2, 6)
"""Values of 0x605A: quick-stop ramp, then voltage off, or then QUICK STOP ACTIVE; CiA 402."""
_LONGER = 1.1
"""Factor by which a drive may round its deadline up; some count it in their own cycles."""
_BEATS = 3
"""Heartbeats of the master that may be missing beyond the watchdog: a stalled computer sends no
targets either, and their deadline is shorter."""
_OFF = 1 << 31
"""Bit of the word with a PDO's CAN id that switches the PDO off; source: CiA 301."""
_WRONG_STATE = 0x08000022
"""SDO abort code "not in this state of the device"; source: CiA 301."""
_CYCLIC, _PROFILE = 8, 402
"""Operation mode (cyclic synchronous position) and device profile number; source: CiA 402."""
_CONTROL, _TARGET = 0x60400010, 0x607A0020  # source: CiA 402
_STATUS, _ACTUAL = 0x60410010, 0x60640020
"""Objects that a PDO carries, as index, subindex and number of bits; source: CiA 402."""
_EFFORTS = {"torque": (0x60770010, 0x6076), "current": (0x60780010, 0x6075)}
"""Option ``effort`` → mapped object, and object of its rated value [1e-3 N·m, N or A]; CiA 402."""
_MS = 1e3  # by definition


class _RefusedError(DriverError):
    """A drive refused to read or write an object of its dictionary."""


class Drives:
    """Configures the drives of a CAN bus by CANopen's SDO, which reads and writes their objects.

    Attributes:
        unguarded: node → reason why a drive has no deadline for targets, so that it would not stop
            by itself when this program falls silent.
    """

    def __init__(self, link: CanLink, options: CanOptions) -> None:
        self.unguarded: dict[int, str] = {}
        self._lacking: dict[int, set[int]] = {}
        self._expecting: set[int] = set()
        canopen = require("canopen", "hil")
        logging.getLogger("canopen").addHandler(logging.NullHandler())
        self._link, self._options = link, options
        self._failure = canopen.SdoCommunicationError
        self._abort = canopen.SdoAbortedError
        self._network: Any = canopen.Network()
        self._network.send_message = lambda cob, data, remote=False: link.send(cob, bytes(data))
        self._nodes: dict[int, Any] = {}
        for node in options.nodes:
            remote = canopen.RemoteNode(node, canopen.ObjectDictionary())
            remote.sdo.RESPONSE_TIMEOUT = ANSWER_S
            remote.sdo.MAX_RETRIES = 1
            self._network.add_node(remote)
            self._nodes[node] = remote
        link.listen(self._received)

    def close(self) -> None:
        """Stop receiving the drives' answers to reads and writes of their objects (SDO)."""
        self._link.leave(self._received)

    def configure(self, nodes: Sequence[int]) -> None:
        """Configure the drives with these node ids for the cyclic exchange and start them. Raises a
        `DriverError` for one that lacks an object, profile or mode, a `LinkError` for a silent
        one."""
        for node in nodes:
            self._command(PRE_OPERATIONAL, node)
        for node in nodes:
            self._map(node)
            self._set(node)
        self.start(nodes)

    def start(self, nodes: Sequence[int]) -> None:
        """Set drives to OPERATIONAL. Again where they stay silent: no drive confirms it, and one
        that misses the heartbeat of a master that ended falls back to PRE-OPERATIONAL."""
        for node in nodes:
            self._command(START, node)

    def limits(self, node: int) -> tuple[int, int] | None:
        """Software position limits of a drive [count], None where it has none."""
        lower, upper = (self.optional(node, 0x607D, sub) for sub in (1, 2))
        return None if lower is None or upper is None or lower >= upper else (lower, upper)

    def error_code(self, node: int) -> int:
        """Error code of a drive (0x603F), 0 if it has none or does not report it."""
        return self.optional(node, 0x603F) or 0

    def rated(self, node: int) -> float:
        """Read a drive's rated torque [N·m or N], or current [A] if option ``effort`` is that."""
        return self.read(node, _EFFORTS[self._options.effort][1]) * 1e-3

    @property
    def counters(self) -> dict[str, float]:
        """Counters for `health`: ``without 0x…`` → number of drives without that object."""
        return {f"without 0x{index:04X}": float(len(n)) for index, n in self._lacking.items() if n}

    def release(self) -> None:
        """Switch off the drives' monitoring of this master's heartbeat, which is about to end."""
        with contextlib.suppress(DriverError):
            while self._expecting:
                self.write(self._expecting.pop(), EXPECTED, 1, 0, 4)

    def _command(self, order: int, node: int) -> None:
        self._link.send(0x000, bytes([order, node]))

    def _map(self, node: int) -> None:
        """Check a drive's profile, map its cyclic messages (PDOs) of targets and answers alone."""
        profile = self.read(node, 0x1000) & 0xFFFF
        if profile != _PROFILE:
            raise DriverError(f"node {node} has device profile {profile}, it is no CiA 402 drive")
        if not self.read(node, 0x6502) >> (_CYCLIC - 1) & 1:
            raise DriverError(f"drive {node} has no cyclic synchronous position mode (0x6502)")
        effort = _EFFORTS.get(self._options.effort, ())[:1]
        for index, can_id, entries in (
            (0x1400, ids.RPDO1 + node, (_CONTROL, _TARGET)),
            (0x1800, ids.TPDO1 + node, (_STATUS, _ACTUAL, *effort)),
        ):
            self.write(node, index, 1, _OFF | can_id, 4)
            self.write(node, index + 0x200, 0, 0, 1)
            for sub, entry in enumerate(entries, start=1):
                self.write(node, index + 0x200, sub, entry, 4)
            self.write(node, index + 0x200, 0, len(entries), 1)
            self.write(node, index, 2, 1, 1)
            if index == TIMER:
                self._guard(node)
            self.write(node, index, 1, can_id, 4)
            for further in (1, 2, 3):
                now = self.optional(node, index + further, 1)
                if now is not None:
                    self.write(node, index + further, 1, now % (1 << 32) | _OFF, 4)

    def _set(self, node: int) -> None:
        """Write a drive's mode and periods, and the objects (if it has them) by which it stops."""
        options = self._options
        ticks, power = options.interpolation or (0, 0)
        beats = round((options.watchdog + _BEATS * HEARTBEAT_S) * _MS)
        expected = ids.master(options.base, options.nodes) << 16 | beats
        for index, sub, value, size in (
            (0x6060, 0, _CYCLIC, 1),
            (0x60C2, 1, ticks, 1),
            (0x60C2, 2, power & 0xFF, 1),
            (0x1006, 0, round(1e6 / options.rate), 4),
            (0x1017, 0, round(HEARTBEAT_S * _MS), 2),
        ):
            self.write(node, index, sub, value, size)
        self._try(node, ABORT, 0, _QUICK_STOP, 2)
        if self.optional(node, QUICK) not in _RAMPS:
            self._try(node, QUICK, 0, _RAMPS[1], 2)
        self._try(node, AFTER, 1, 0, 1)
        if self._try(node, EXPECTED, 1, expected, 4):
            self._expecting.add(node)

    def _guard(self, node: int) -> None:
        """Set and read back the deadline of a drive's targets, with their message (RPDO1) off."""
        asked = round(self._options.watchdog * _MS)
        self.unguarded.pop(node, None)
        try:
            self.write(node, TIMER, 5, asked, 2)
            taken = self.read(node, TIMER, 5)
        except _RefusedError as error:
            self.unguarded[node] = str(error)
            return
        if not 0 < taken <= _LONGER * asked + 1.0:
            self.unguarded[node] = (
                f"drive {node}, object 0x1400:5: it was set to {asked} ms and has {taken} ms"
            )

    def _try(self, node: int, index: int, sub: int, value: int, size: int) -> bool:
        """Write ``value``, ``size`` bytes, to an object that a drive may lack; False if refused."""
        without = self._lacking.setdefault(index, set())
        without.discard(node)
        try:
            self.write(node, index, sub, value, size)
        except _RefusedError:
            without.add(node)
        return node not in without

    def read(self, node: int, index: int, sub: int = 0) -> int:
        """Read object (``index``, ``sub``) of a drive as a number. Raises a `LinkError` if the
        drive does not answer, a `DriverError` if it refuses."""
        raw = self._transfer(node, index, sub, None)
        return int.from_bytes(raw, "little", signed=index == 0x607D)

    def optional(self, node: int, index: int, sub: int = 0) -> int | None:
        """Read object (``index``, ``sub``) of a drive as a number; None if the drive refuses."""
        with contextlib.suppress(_RefusedError):
            return self.read(node, index, sub)
        return None

    def write(self, node: int, index: int, sub: int, value: int, size: int) -> None:
        """Write a number of ``size`` bytes to object (``index``, ``sub``) of a drive. Raises a
        `LinkError` if the drive does not answer, a `DriverError` if it refuses."""
        self._transfer(node, index, sub, struct.pack("<Q", value)[:size])

    def _transfer(self, node: int, index: int, sub: int, raw: bytes | None) -> bytes:
        sdo, where = self._nodes[node].sdo, f"drive {node}, object 0x{index:04X}:{sub}"
        for remaining in reversed(range(TRIES)):
            try:
                if raw is None:
                    return bytes(sdo.upload(index, sub))
                sdo.download(index, sub, raw)
                return b""
            except self._abort as error:
                if error.code == _WRONG_STATE and remaining:
                    self._command(PRE_OPERATIONAL, node)  # NMT frames are not confirmed: lost
                    continue
                raise _RefusedError(f"{where}: refused with 0x{error.code:08X}") from error
            except self._failure:
                continue
        raise LinkError(
            f"{where}: no answer; check its node id, bit rate, power and bus termination"
        )

    def _received(self, _: float, can_id: int, data: bytes) -> None:
        if can_id - 0x580 in self._nodes:
            self._network.notify(can_id, bytearray(data), 0.0)
