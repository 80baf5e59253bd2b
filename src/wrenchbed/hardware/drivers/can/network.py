"""Power-up by CANopen: identity, process data, periods and watchdogs of each drive, through SDO.

canopen does the SDO transfers only; the bus's one reader hands it their answers. The cyclic
exchange, the states and the heartbeats are not its business.

What makes a drive stop by itself when its master falls silent.

Needed is the deadline of its targets (event timer of RPDO1, 0x1400:5); it is read back. The rest is
set where a drive has it: what it does when the connection breaks (0x6007), how it quick-stops
(0x605A), the master's heartbeat that it expects (0x1016), and that it takes no more targets after
a communication error (0x1029). Sources: CiA 301, CiA 402.
"""

import contextlib
import logging
import struct
from collections.abc import Sequence
from typing import Any, Protocol

from wrenchbed.errors import DriverError, LinkError
from wrenchbed.errors import LinkError as SilentError
from wrenchbed.hardware.drivers.can import options as ids
from wrenchbed.hardware.drivers.can.options import HEARTBEAT_S, CanOptions
from wrenchbed.hardware.transducers.netcanoem.link import CanLink
from wrenchbed.registry import require

TIMER, ABORT, QUICK, EXPECTED, AFTER = 0x1400, 0x6007, 0x605A, 0x1016, 0x1029
_QUICK_STOP = 3
_RAMPS = (2, 6)
"""Options of 0x605A: the quick-stop ramp, then voltage off, or staying in QUICK STOP ACTIVE."""
_BEATS = 3


class ObjectDictionary(Protocol):
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

    def __init__(self, objects: ObjectDictionary, options: CanOptions) -> None:
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


ANSWER_S = 0.3
"""How long an answer may take [s]; a question is asked `TRIES` times."""
TRIES = 3
PRE_OPERATIONAL, START = 0x80, 0x01
_OFF = 1 << 31
_WRONG_STATE = 0x08000022
_CYCLIC = 8
_PROFILE = 402
_CONTROL, _TARGET = 0x60400010, 0x607A0020
_STATUS, _ACTUAL, _TORQUE = 0x60410010, 0x60640020, 0x60770010


class Drives:
    """The drives of a bus as CANopen nodes.

    Args:
        link: the bus.
        options: ids, rate, watchdog.

    Attributes:
        guards: what makes a drive stop when this program falls silent.
    """

    def __init__(self, link: CanLink, options: CanOptions) -> None:
        canopen = require("canopen", "hil")
        logging.getLogger("canopen").addHandler(logging.NullHandler())
        self._link, self._options = link, options
        self._failure = canopen.SdoCommunicationError
        self._abort = canopen.SdoAbortedError
        self._network: Any = canopen.Network()
        self._network.send_message = self._send
        self._nodes: dict[int, Any] = {}
        self.guards = Guards(self, options)
        for node in options.nodes:
            remote = canopen.RemoteNode(node, canopen.ObjectDictionary())
            remote.sdo.RESPONSE_TIMEOUT = ANSWER_S
            remote.sdo.MAX_RETRIES = 1
            self._network.add_node(remote)
            self._nodes[node] = remote
        link.listen(self._heard)

    def close(self) -> None:
        """Listen no more."""
        self._link.leave(self._heard)

    def command(self, order: int, node: int = 0) -> None:
        """Send an NMT command, to all nodes unless one is named.

        Raises:
            LinkError: the bus is gone.
        """
        self._link.send(0x000, bytes([order, node]))

    def configure(self, nodes: Sequence[int]) -> None:
        """Make drives ready for the cyclic exchange and start them.

        Raises:
            LinkError: one does not answer.
            DriverError: one cannot do what is needed; says what.
        """
        for node in nodes:
            self.command(PRE_OPERATIONAL, node)
        for node in nodes:
            self._check(node)
            self._map(node)
            self._set(node)
        for node in nodes:
            self.command(START, node)

    def limits(self, node: int) -> tuple[int, int] | None:
        """Software position limits of a drive [count], None where it has none."""
        lower, upper = (self._maybe(node, 0x607D, sub) for sub in (1, 2))
        if lower is None or upper is None or lower >= upper:
            return None
        return lower, upper

    def error_code(self, node: int) -> int:
        """Error code that a drive has (0x603F), 0 where it has none or does not tell."""
        return self._maybe(node, 0x603F, 0) or 0

    def rated_torque(self, node: int) -> float:
        """Rated torque [N·m or N] of a drive.

        Raises:
            DriverError: it does not tell.
        """
        return self.read(node, 0x6076, 0) * 1e-3

    def _check(self, node: int) -> None:
        profile = self.read(node, 0x1000, 0) & 0xFFFF
        if profile != _PROFILE:
            raise DriverError(f"node {node} has device profile {profile}, it is no CiA 402 drive")
        if not self.read(node, 0x6502, 0) >> (_CYCLIC - 1) & 1:
            raise DriverError(f"drive {node} has no cyclic synchronous position mode (0x6502)")

    def _map(self, node: int) -> None:
        carried = (_STATUS, _ACTUAL) + ((_TORQUE,) if self._options.torque else ())
        for index, can_id, entries in (
            (0x1400, 0x200 + node, (_CONTROL, _TARGET)),
            (0x1800, 0x180 + node, carried),
        ):
            self.write(node, index, 1, _OFF | can_id, 4)
            self.write(node, index + 0x200, 0, 0, 1)
            for sub, entry in enumerate(entries, start=1):
                self.write(node, index + 0x200, sub, entry, 4)
            self.write(node, index + 0x200, 0, len(entries), 1)
            self.write(node, index, 2, 1, 1)
            if index == 0x1400:
                self.guards.deadline(node)
            self.write(node, index, 1, can_id, 4)
            for further in (1, 2, 3):
                self._switch_off(node, index + further)

    def _set(self, node: int) -> None:
        ticks, power = self._options.interpolation or (0, 0)
        self.write(node, 0x6060, 0, _CYCLIC, 1)
        self.write(node, 0x60C2, 1, ticks, 1)
        self.write(node, 0x60C2, 2, power & 0xFF, 1)
        self.write(node, 0x1006, 0, round(1e6 / self._options.rate), 4)
        self.write(node, 0x1017, 0, round(HEARTBEAT_S * 1000), 2)
        self.guards.further(node)

    def _switch_off(self, node: int, index: int) -> None:
        """Silence a PDO that nobody asked for, where there is one."""
        now = self._maybe(node, index, 1)
        if now is not None:
            self.write(node, index, 1, now % (1 << 32) | _OFF, 4)

    def _maybe(self, node: int, index: int, sub: int) -> int | None:
        try:
            return self.read(node, index, sub)
        except SilentError:
            raise
        except DriverError:
            return None

    def read(self, node: int, index: int, sub: int) -> int:
        """A value of a drive's dictionary.

        Raises:
            LinkError: it does not answer.
            DriverError: it refuses.
        """
        raw = self._transfer(node, index, sub, None)
        return int.from_bytes(raw, "little", signed=index in (0x607D,))

    def write(self, node: int, index: int, sub: int, value: int, size: int) -> None:
        """Write a value of some bytes; raises as `read` does."""
        self._transfer(node, index, sub, struct.pack("<Q", value)[:size])

    def _transfer(self, node: int, index: int, sub: int, raw: bytes | None) -> bytes:
        sdo, where = self._nodes[node].sdo, f"drive {node}, object 0x{index:04X}:{sub}"
        for left in reversed(range(TRIES)):
            try:
                if raw is None:
                    return bytes(sdo.upload(index, sub))
                sdo.download(index, sub, raw)
                return b""
            except self._abort as error:
                if error.code == _WRONG_STATE and left:
                    self.command(PRE_OPERATIONAL, node)  # nobody tells that such a frame was lost
                    continue
                raise DriverError(f"{where}: refused with 0x{error.code:08X}") from error
            except self._failure:
                continue
        raise SilentError(
            f"{where}: no answer; check its node id, bit rate, power and bus termination"
        )

    def _send(self, can_id: int, data: bytes, remote: bool = False) -> None:
        self._link.send(can_id, bytes(data))

    def _heard(self, _: float, can_id: int, data: bytes) -> None:
        if can_id - 0x580 in self._nodes:
            self._network.notify(can_id, bytearray(data), 0.0)
