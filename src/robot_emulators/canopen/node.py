"""A CANopen node: NMT, SDO, process data, SYNC, heartbeats, errors.

`hear` runs in the bus's thread, `tick` in another; both hold the node's lock. Remote frames and
node guarding are not served: CiA 301 advises against both. Source: CiA 301 (communication
objects 7.5.2, NMT states 7.3.2, predefined connection set 7.3.5).
"""

import operator
import struct
import threading
from collections.abc import Callable, Sequence
from functools import reduce

from robot_emulators.can_bus import Frame
from robot_emulators.canopen.dictionary import Abort, AbortError, Key, Objects, SdoServer
from robot_emulators.canopen.pdo import Pdo

BOOT, STOPPED, OPERATIONAL, PRE_OPERATIONAL = 0x00, 0x04, 0x05, 0x7F
HEARTBEAT_LOST = 0x8130
"""Error code of a lost heartbeat or guarding; source: CiA 301, 7.2.7.1."""
_NMT = {0x01: OPERATIONAL, 0x02: STOPPED, 0x80: PRE_OPERATIONAL}
"""NMT command → state that the node enters."""
_RESET_NODE, _RESET_COMMUNICATION = 0x81, 0x82
_COMMUNICATION = range(0x1000, 0x2000)
_ALL = range(0x1000, 0x10000)
_OFF = 1 << 31
_REGISTER = {0x2: 0x02, 0x3: 0x04, 0x4: 0x08, 0x8: 0x10}
"""First digit of an error code → bit of the error register (0x1001); source: CiA 301, 7.5.2.2."""
_POSITIONING = (0x84, 0x85, 0x86)
"""First two digits of error codes that set the bit of the device profile, 0x20."""


def _register(code: int) -> int:
    """Bits of the error register (object 0x1001) that a CiA 301 error code sets."""
    return 0x01 | (0x20 if code >> 8 in _POSITIONING else _REGISTER.get(code >> 12, 0))


class Node:
    """A CANopen node without a device profile.

    Args:
        node: CANopen node id, 1 … 127.
        send: puts a frame on the bus.
        sheet: text of the node's EDS file, which defines its objects.
        lock: held while the node handles a frame or a tick.
    """

    def __init__(
        self, node: int, send: Callable[[Frame], None], sheet: str, lock: threading.RLock
    ) -> None:
        self.node, self.lock = node, lock
        objects = self.objects = Objects(sheet, node)
        self.rpdos, self.tpdos = (
            [Pdo(objects, k) for k in range(first, first + 0x200) if (k, 1) in objects]
            for first in (0x1400, 0x1800)
        )
        self.state = PRE_OPERATIONAL
        self.fails: Callable[[str], bool] = lambda kind: False
        """Whether this node has a kind of fault now: ``mute``, ``heartbeat_loss``, a profile's."""
        self.now = 0.0
        self._send = send
        self._ids = frozenset[int]()
        self._by_id: dict[int, Pdo] = {}
        self._sdo = SdoServer(objects, self._check_state, self._sdo_written)
        self._consumers = [k for k in objects if k[0] == 0x1016 and k[1]]
        self._forget()

    def on_reset(self) -> None:
        """Hook: the node was reset and all objects have their defaults again."""

    def on_reset_communication(self) -> None:
        """Hook: communication was reset; its objects have their defaults again."""

    def on_sync(self, t: float) -> None:
        """Hook: a cycle's SYNC came at t [s] in OPERATIONAL; values of received PDOs are set."""

    def on_written(self, keys: Sequence[Key]) -> None:
        """Hook: a client wrote these objects (index, subindex) of the device profile, in order."""

    def on_connection_lost(self, code: int) -> None:
        """Hook: the master went silent (``code``: error code), or the node left OPERATIONAL (0)."""

    def refresh(self, t: float) -> None:
        """Hook: update, at time t [s], objects that change by themselves, before they are sent."""

    def boot(self, everything: bool = True) -> None:
        """Reset all objects (``everything``) or the communication's alone; boot to the CANopen
        state PRE-OPERATIONAL."""
        with self.lock:
            if not everything and self.state == OPERATIONAL:
                self.on_connection_lost(0)
            self.objects.reset(_ALL if everything else _COMMUNICATION)
            if everything:
                self.on_reset()
            self._forget()
            self.on_reset_communication()
            self.state = PRE_OPERATIONAL
            self._derive_ids()
            self.send(0x700 + self.node, bytes([BOOT]))

    def send(self, can_id: int, data: bytes) -> None:
        """Put a frame on the CAN bus, unless the fault ``mute`` silences this node."""
        if not self.fails("mute"):
            self._send(Frame(can_id, data))

    def hear(self, t: float, frame: Frame) -> None:
        """Handle a CAN frame from the bus that arrives at time t [s]."""
        if frame.can_id not in self._ids or frame.extended or self.fails("mute"):
            return
        with self.lock:
            self.now = t
            self._take(t, frame)

    def tick(self, t: float) -> None:
        """Send what is due at t [s] (heartbeat, cyclic messages); check other nodes' heartbeats."""
        with self.lock:
            self.now = t
            self._watch_others(t)
            for tpdo in self.tpdos if self.state == OPERATIONAL else ():
                self._transmit(tpdo, tpdo.at_event(t))
            self._beat(t)

    def error(self, code: int) -> None:
        """Send an emergency message with a CiA 301 error code; enter it in the error objects."""
        self._errors.add(code)
        self._show_errors()
        self._emergency(code)

    def clear(self, *codes: int) -> None:
        """Clear these CiA 301 error codes; if none is left, send emergency message "no error"."""
        gone = self._errors & set(codes)
        self._errors -= gone
        self._show_errors()
        if gone and not self._errors:
            self._emergency(0)

    def change(self, state: int) -> None:
        """Enter a CANopen network state (NMT, CiA 301), such as `OPERATIONAL`."""
        if state == self.state:
            return
        if self.state == OPERATIONAL:
            self.on_connection_lost(0)
        self.state = state
        for pdo in (*self.rpdos, *self.tpdos):
            pdo.forget()

    def _forget(self) -> None:
        """Forget all errors, other nodes' heartbeats and messages' timers, as after power-up."""
        self._errors: set[int] = set()
        self._beat_due = 0.0
        self._heard: dict[int, float] = {}
        self._lost: set[int] = set()
        for pdo in (*self.rpdos, *self.tpdos):
            pdo.forget()

    def _show_errors(self) -> None:
        bits = [_register(code) for code in self._errors]
        self.objects[0x1001, 0] = reduce(operator.or_, bits, 0)

    def _emergency(self, code: int) -> None:
        if self.state != STOPPED and not self.objects[0x1014, 0] & _OFF:
            data = struct.pack("<HB5x", code, self.objects[0x1001, 0])
            self.send(self.objects[0x1014, 0] & 0x7FF, data)

    def _take(self, t: float, frame: Frame) -> None:
        can_id = frame.can_id
        if can_id == 0x000:
            self._nmt(frame.data)
        elif can_id == 0x600 + self.node:
            if self.state != STOPPED:
                self.refresh(t)
                for answer in self._sdo.answer(frame.data):
                    self.send(0x580 + self.node, answer)
        elif can_id == self.objects[0x1005, 0] & 0x7FF:
            if self.state == OPERATIONAL:
                self._synchronize(t)
        elif can_id - 0x700 in self._heard:
            self._others(t, can_id - 0x700)
        elif self.state == OPERATIONAL and can_id in self._by_id:
            self._receive(t, self._by_id[can_id], frame.data)

    def _nmt(self, data: bytes) -> None:
        if len(data) != 2 or data[1] not in (0, self.node):
            return
        if data[0] in _NMT:
            self.change(_NMT[data[0]])
        elif data[0] in (_RESET_NODE, _RESET_COMMUNICATION):
            self.boot(everything=data[0] == _RESET_NODE)

    def _synchronize(self, t: float) -> None:
        for rpdo in self.rpdos:
            if rpdo.waiting is not None:
                values, rpdo.waiting = rpdo.waiting, None
                self._apply(values)
        self.on_sync(t)
        self.refresh(t)
        for tpdo in self.tpdos:
            self._transmit(tpdo, tpdo.at_sync())

    def _transmit(self, tpdo: Pdo, data: bytes | None) -> None:
        if data is not None:
            self.send(int(tpdo.can_id or 0), data)

    def _receive(self, t: float, rpdo: Pdo, data: bytes) -> None:
        values = rpdo.unpack(data)
        if not values:
            return
        rpdo.heard = t
        if rpdo.synchronous:
            rpdo.waiting = values
        else:
            self._apply(values)

    def _apply(self, values: Sequence[tuple[Key, int]]) -> None:
        for key, value in values:
            self.objects[key] = value
        self.on_written([key for key, _ in values])

    def _beat(self, t: float) -> None:
        period = self.objects[0x1017, 0] / 1000.0
        if period and t >= self._beat_due:
            self._beat_due = self._beat_due + period if t - self._beat_due < period else t + period
            if not self.fails("heartbeat_loss"):
                self.send(0x700 + self.node, bytes([self.state]))

    def _others(self, t: float, node: int) -> None:
        self._heard[node] = t
        if node in self._lost:
            self._lost.discard(node)
            if not self._lost:
                self.clear(HEARTBEAT_LOST)

    def _watch_others(self, t: float) -> None:
        for key in self._consumers:
            word = self.objects[key]
            node, period = word >> 16 & 0x7F, (word & 0xFFFF) / 1000.0
            heard = self._heard.get(node, 0.0)
            if heard and period and t - heard > period and node not in self._lost:
                self._lost.add(node)
                self._lose_connection()

    def _lose_connection(self) -> None:
        self.error(HEARTBEAT_LOST)
        self.on_connection_lost(HEARTBEAT_LOST)
        behaviour = self.objects[0x1029, 1]
        if behaviour == 2:
            self.change(STOPPED)
        elif behaviour == 0 and self.state == OPERATIONAL:
            self.change(PRE_OPERATIONAL)

    def _derive_ids(self) -> None:
        """Derive watched heartbeats (0x1016), CAN id → RPDO and accepted ids from the objects."""
        words = [self.objects[key] for key in self._consumers]
        nodes = {w >> 16 & 0x7F for w in words if w & 0xFFFF and 0 < w >> 16 & 0xFF < 0x80}
        self._heard = {n: self._heard.get(n, 0.0) for n in nodes}
        self._lost &= nodes
        self._by_id = {p.can_id: p for p in reversed(self.rpdos) if p.can_id is not None}
        sync = self.objects[0x1005, 0] & 0x7FF
        always = {0x000, sync, 0x600 + self.node}
        self._ids = frozenset(always | set(self._by_id) | {0x700 + n for n in nodes})

    def _check_state(self, key: Key) -> None:
        """Raise `AbortError` in state OPERATIONAL if ``key`` sets up a PDO, except event timers."""
        if 0x1400 <= key[0] < 0x1C00 and self.state == OPERATIONAL and key[1] != 5:
            raise AbortError(Abort.STATE)

    def _sdo_written(self, key: Key) -> None:
        if key[0] not in _COMMUNICATION:
            self.on_written([key])
            return
        if key[0] == 0x1017:
            self._beat_due = 0.0
        self._derive_ids()
