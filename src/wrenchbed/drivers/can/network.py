"""Power-up by CANopen: identity, process data, periods and watchdogs of each drive, through SDO.

canopen does the SDO transfers only; the bus's one reader hands it their answers. The cyclic
exchange, the states and the heartbeats are not its business.
"""

import logging
import struct
from collections.abc import Sequence
from typing import Any

from wrenchbed.drivers.can.guards import Guards
from wrenchbed.drivers.can.options import HEARTBEAT_S, Options
from wrenchbed.errors import DriverError
from wrenchbed.errors import LinkError as SilentError
from wrenchbed.registry import require
from wrenchbed.transducers.netcanoem.link import Link

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

    def __init__(self, link: Link, options: Options) -> None:
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
