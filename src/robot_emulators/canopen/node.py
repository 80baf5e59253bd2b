"""A CANopen node: NMT, SDO, process data, SYNC, heartbeats, guarding, errors, stored parameters.

`hear` runs in the bus's thread, `tick` in another; both hold the node's lock. Source: CiA 301
(communication objects 7.5.2, NMT states 7.3.2, predefined connection set 7.3.5).
"""

import struct
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from robot_emulators.can_bus.wire import Frame
from robot_emulators.canopen.dictionary import (
    TEXT,
    U8,
    U16,
    U32,
    Abort,
    AbortError,
    Entry,
    Key,
    Objects,
)
from robot_emulators.canopen.pdo import Pdo, check_free
from robot_emulators.canopen.sdo import SdoServer

BOOT, STOPPED, OPERATIONAL, PRE_OPERATIONAL = 0x00, 0x04, 0x05, 0x7F
SYNC = 0x080
HEARTBEAT_LOST, SHORT_PDO, LONG_PDO = 0x8130, 0x8210, 0x8220
"""Error codes of the communication; source: CiA 301, 7.2.7.1."""
_SAVE, _LOAD = 0x65766173, 0x64616F6C
_HISTORY, _CONSUMERS = 8, 2
_INHIBIT_S = 1e-4
_OFF = 1 << 31


@dataclass(frozen=True)
class Identity:
    """Who a node says it is.

    Attributes:
        device: type and profile (0x1000).
        name: 0x1008.
        hardware: version, 0x1009.
        software: version, 0x100A.
        vendor: number, 0x1018:1.
        product: number, 0x1018:2.
        revision: number, 0x1018:3.
    """

    device: int
    name: str
    hardware: str
    software: str
    vendor: int
    product: int
    revision: int


def _register(code: int) -> int:
    """Bits of the error register (0x1001) that an error code sets."""
    kinds = {0x2: 0x02, 0x3: 0x04, 0x4: 0x08, 0x8: 0x10}
    more = 0x20 if code >> 8 in (0x84, 0x85, 0x86) else kinds.get(code >> 12, 0)
    return 0x01 | more


class Node:
    """A node without a device profile.

    Args:
        node: id, 1 … 127.
        send: puts a frame on the bus.
        identity: what it answers to who asks.
        lock: held while it acts.
        listen: told the ids that it hears, whenever they change.
    """

    def __init__(
        self, node: int, send: Callable[[Frame], None], identity: Identity, lock: threading.RLock,
        listen: Callable[[frozenset[int]], None] = lambda ids: None,
    ) -> None:  # fmt: skip
        self.node, self.identity, self.lock = node, identity, lock
        self.objects = Objects()
        self.state = PRE_OPERATIONAL
        self.mute = False
        self.heartbeat_off_until = 0.0
        self.now = 0.0
        self.rpdos: list[Pdo] = []
        self.tpdos: list[Pdo] = []
        self._send, self._listen = send, listen
        self._by_id: dict[int, Pdo] = {}
        self._sdo = SdoServer(self.objects, self._locked, self._sdo_written)
        self._stored: dict[Key, int | bytes] = {}
        self._beat_due = self._guarded = 0.0
        self._toggle = 0
        self._errors: dict[int, int] = {}
        self._emergencies: list[bytes] = []
        self._emergency_due = 0.0
        self._heard: dict[int, float] = {}
        self._lost: set[int] = set()

    def pdos(self) -> tuple[list[Pdo], list[Pdo]]:
        """RPDOs and TPDOs with what they are after a reset, made anew."""
        return [], []

    def on_reset(self) -> None:
        """Back to what it is after power-up."""

    def on_reset_communication(self) -> None:
        """The communication is back to what it is after power-up."""

    def on_sync(self, t: float) -> None:
        """A SYNC at a time [s] while operational, after its RPDOs were taken."""

    def on_written(self, keys: Sequence[Key]) -> None:
        """Objects of the profile were written, in this order."""

    def on_connection_lost(self, code: int) -> None:
        """The master fell silent, or this node left OPERATIONAL."""

    def refresh(self, t: float) -> None:
        """Update what changes by itself, at a time [s]."""

    def boot(self, everything: bool = True) -> None:
        """Boot: send the boot-up message and wait in PRE-OPERATIONAL.

        Args:
            everything: the node; else its communication alone.
        """
        with self.lock:
            if not everything:
                self._leave_operational()
            self._define()
            if everything:
                self.on_reset()
            self.rpdos, self.tpdos = self.pdos()
            area = range(0x1000, 0x10000 if everything else 0x2000)
            self.objects.restore({k: v for k, v in self._stored.items() if k[0] in area})
            self._errors.clear()
            self._emergencies.clear()
            self._beat_due = self._guarded = 0.0
            self._toggle = 0
            self._heard.clear()
            self._lost.clear()
            self.on_reset_communication()
            self.state = PRE_OPERATIONAL
            self._tune()
            self.send(0x700 + self.node, bytes([BOOT]))

    def send(self, can_id: int, data: bytes) -> None:
        """Put a frame on the bus, unless the node is mute."""
        if not self.mute:
            self._send(Frame(can_id, data))

    def hear(self, t: float, frame: Frame) -> None:
        """Take a frame from the bus at a time [s]."""
        if frame.extended or self.mute:
            return
        with self.lock:
            self.now = t
            self._take(t, frame)

    def tick(self, t: float) -> None:
        """Do what is due at a time [s]: heartbeat, events, errors."""
        with self.lock:
            self.now = t
            if self.state != STOPPED:
                for answer in self._sdo.expired(t):
                    self.send(0x580 + self.node, answer)
            self._watch_others(t)
            if self.state == OPERATIONAL:
                self._transmit_events(t)
            self._flush(t)
            self._beat(t)

    def error(self, code: int, register: int | None = None) -> None:
        """An error came: it is sent, kept, and shown in the error register."""
        self._errors[code] = _register(code) if register is None else register
        self._show_errors()
        depth = self.objects[0x1003, 0]
        for k in range(min(depth, _HISTORY - 1), 0, -1):
            self.objects[0x1003, k + 1] = self.objects[0x1003, k]
        self.objects[0x1003, 1], self.objects[0x1003, 0] = code, min(depth + 1, _HISTORY)
        self._emergency(code)

    def clear(self, *codes: int) -> None:
        """Errors are gone; the end is sent with the last one."""
        gone = [self._errors.pop(code) for code in codes if code in self._errors]
        self._show_errors()
        if gone and not self._errors:
            self._emergency(0)

    def _show_errors(self) -> None:
        register = 0
        for bits in self._errors.values():
            register |= bits
        self.objects[0x1001, 0] = register

    def _emergency(self, code: int) -> None:
        register = self.objects[0x1001, 0]
        self._emergencies.append(struct.pack("<HB5x", code, register))
        self._flush(self.now)

    def _flush(self, t: float) -> None:
        """Send what the inhibit time of EMCY has held back."""
        inhibit = self.objects[0x1015, 0] * _INHIBIT_S
        while self._emergencies and t >= self._emergency_due:
            data = self._emergencies.pop(0)
            if self.state != STOPPED and not self.objects[0x1014, 0] & _OFF:
                self.send(self.objects[0x1014, 0] & 0x7FF, data)
            self._emergency_due = t + inhibit

    def _define(self) -> None:
        """The communication area as it is after power-up."""
        objects, node, who = self.objects, self.node, self.identity

        def add(index: int, entry: Entry) -> None:
            objects.add(index, entry)

        add(0x1000, Entry("Device type", U32, who.device, "const"))
        add(0x1001, Entry("Error register", U8, 0, mapped=True))
        entries = {k: Entry(f"Standard error field {k}", U32, 0) for k in range(1, _HISTORY + 1)}
        count = Entry("Number of errors", U8, 0, "rw", check=self._clear_history, kept=False)
        objects.record(0x1003, "Pre-defined error field", entries, array=True, count=count)
        add(0x1005, Entry("COB-ID SYNC message", U32, SYNC, "rw", check=self._check_sync))
        add(0x1006, Entry("Communication cycle period", U32, 0, "rw"))
        add(0x1007, Entry("Synchronous window length", U32, 0, "rw"))
        for index, name, text in (
            (0x1008, "Manufacturer device name", who.name),
            (0x1009, "Manufacturer hardware version", who.hardware),
            (0x100A, "Manufacturer software version", who.software),
        ):
            add(index, Entry(name, TEXT, text.encode("ascii"), "const"))
        add(0x100C, Entry("Guard time", U16, 0, "rw"))
        add(0x100D, Entry("Life time factor", U8, 0, "rw"))
        for index, name, word, act in (
            (0x1010, "Store parameters", _SAVE, self._store),
            (0x1011, "Restore default parameters", _LOAD, self._restore),
        ):
            kinds = ("all", "communication", "application")
            objects.record(
                index, name,
                {
                    k: Entry(
                        f"{name}: {kind}", U32, 1, "rw", kept=False,
                        check=_signed_off(word, act, k),
                    )
                    for k, kind in enumerate(kinds, start=1)
                },
                array=True,
            )  # fmt: skip
        emergency = Entry("COB-ID EMCY", U32, 0x80 + node, "rw", check=self._check_emergency)
        emergency.of_node = True
        add(0x1014, emergency)
        add(0x1015, Entry("Inhibit time EMCY", U16, 0, "rw"))
        consumers = {
            k: Entry(f"Consumer heartbeat time {k}", U32, 0, "rw", check=self._check_consumer(k))
            for k in range(1, _CONSUMERS + 1)
        }
        objects.record(0x1016, "Consumer heartbeat time", consumers, array=True)
        add(0x1017, Entry("Producer heartbeat time", U16, 0, "rw"))
        numbers = (who.vendor, who.product, who.revision, node)
        names = ("Vendor-ID", "Product code", "Revision number", "Serial number")
        objects.record(
            0x1018, "Identity object",
            {
                k: Entry(name, U32, value, of_node=k == 4)
                for k, (name, value) in enumerate(zip(names, numbers, strict=True), start=1)
            },
        )  # fmt: skip
        behaviour = Entry("Communication error", U8, 0, "rw", high=2)
        objects.record(0x1029, "Error behaviour", {1: behaviour}, array=True)
        to_server = Entry("COB-ID client to server", U32, 0x600 + node, "const", of_node=True)
        to_client = Entry("COB-ID server to client", U32, 0x580 + node, "const", of_node=True)
        objects.record(0x1200, "SDO server parameter", {1: to_server, 2: to_client})

    def _take(self, t: float, frame: Frame) -> None:
        can_id = frame.can_id
        if frame.remote:
            self._asked(t, can_id)
        elif can_id == 0x000:
            self._nmt(frame.data)
        elif can_id == 0x600 + self.node:
            if self.state != STOPPED:
                self.refresh(t)
                for answer in self._sdo.answer(t, frame.data):
                    self.send(0x580 + self.node, answer)
        elif can_id == self.objects[0x1005, 0] & 0x7FF:
            if self.state == OPERATIONAL:
                self._synchronize(t)
        elif can_id - 0x700 in self._heard:
            self._others(t, can_id - 0x700)
        elif self.state == OPERATIONAL and can_id in self._by_id:
            self._receive(t, self._by_id[can_id], frame.data)

    def _synchronize(self, t: float) -> None:
        for rpdo in self.rpdos:
            if rpdo.waiting is not None:
                values, rpdo.waiting = rpdo.waiting, None
                self._apply(values)
        self.on_sync(t)
        self.refresh(t)
        for tpdo in self.tpdos:
            data = tpdo.at_sync()
            if data is not None:
                self.send(int(tpdo.can_id or 0), data)

    def _receive(self, t: float, rpdo: Pdo, data: bytes) -> None:
        values = rpdo.unpack(data)
        if values is None:
            if SHORT_PDO not in self._errors:
                self.error(SHORT_PDO)
            return
        self.clear(SHORT_PDO)
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

    def _transmit_events(self, t: float) -> None:
        for tpdo in self.tpdos:
            data = tpdo.at_event(t)
            if data is not None:
                self.send(int(tpdo.can_id or 0), data)

    def _asked(self, t: float, can_id: int) -> None:
        """A remote frame: guarding, or a TPDO."""
        if can_id == 0x700 + self.node:
            if not self.objects[0x1017, 0]:
                self.send(can_id, bytes([self._toggle | self.state]))
                self._toggle ^= 0x80
            self._guarded = t
            self.clear(HEARTBEAT_LOST)
        elif self.state == OPERATIONAL:
            for tpdo in self.tpdos:
                if tpdo.can_id == can_id and (data := tpdo.asked()) is not None:
                    self.send(can_id, data)

    def _nmt(self, data: bytes) -> None:
        if len(data) != 2 or data[1] not in (0, self.node):
            return
        command = data[0]
        states = {0x01: OPERATIONAL, 0x02: STOPPED, 0x80: PRE_OPERATIONAL}
        if command in states:
            self.change(states[command])
        elif command in (0x81, 0x82):
            self.boot(everything=command == 0x81)

    def change(self, state: int) -> None:
        """Enter an NMT state."""
        if state == self.state:
            return
        self._leave_operational()
        self.state = state
        for pdo in (*self.rpdos, *self.tpdos):
            pdo.forget()

    def _leave_operational(self) -> None:
        if self.state == OPERATIONAL:
            self.on_connection_lost(0)

    def _beat(self, t: float) -> None:
        period = self.objects[0x1017, 0] / 1000.0
        if period and t >= self._beat_due:
            self._beat_due = self._beat_due + period if t - self._beat_due < period else t + period
            if t >= self.heartbeat_off_until:
                self.send(0x700 + self.node, bytes([self.state]))

    def _others(self, t: float, node: int) -> None:
        """A heartbeat that this node consumes."""
        self._heard[node] = t
        if node in self._lost:
            self._lost.discard(node)
            if not self._lost:
                self.clear(HEARTBEAT_LOST)

    def _watch_others(self, t: float) -> None:
        for k in range(1, _CONSUMERS + 1):
            word = self.objects[0x1016, k]
            node, period = word >> 16 & 0x7F, (word & 0xFFFF) / 1000.0
            heard = self._heard.get(node, 0.0)
            if heard and period and t - heard > period and node not in self._lost:
                self._lost.add(node)
                self._lose_connection()
        life = self.objects[0x100C, 0] * self.objects[0x100D, 0] / 1000.0
        if self._guarded and life and t - self._guarded > life:
            self._guarded = 0.0
            self._lose_connection()

    def _lose_connection(self) -> None:
        """A heartbeat or guarding event."""
        self.error(HEARTBEAT_LOST)
        self.on_connection_lost(HEARTBEAT_LOST)
        behaviour = self.objects[0x1029, 1]
        if behaviour == 2:
            self.change(STOPPED)
        elif behaviour == 0 and self.state == OPERATIONAL:
            self.change(PRE_OPERATIONAL)

    def _tune(self) -> None:
        """Ids and consumers may have changed."""
        words = [self.objects[0x1016, k] for k in range(1, _CONSUMERS + 1)]
        nodes = {w >> 16 & 0x7F for w in words if w & 0xFFFF and 0 < w >> 16 & 0xFF < 0x80}
        self._heard = {n: self._heard.get(n, 0.0) for n in nodes}
        self._lost &= nodes
        self._by_id = {p.can_id: p for p in reversed(self.rpdos) if p.can_id is not None}
        asked = {p.can_id for p in self.tpdos if p.can_id is not None}
        sync = self.objects[0x1005, 0] & 0x7FF
        own = {0x000, sync, 0x600 + self.node, 0x700 + self.node}
        self._listen(frozenset(own | asked | set(self._by_id) | {0x700 + n for n in nodes}))

    def _locked(self, key: Key) -> None:
        """Process data are configured before OPERATIONAL, save for their event timers."""
        if 0x1400 <= key[0] < 0x1C00 and self.state == OPERATIONAL and key[1] != 5:
            raise AbortError(Abort.STATE)

    def _sdo_written(self, key: Key) -> None:
        if key[0] < 0x2000:
            if key[0] == 0x1017:
                self._beat_due = 0.0
            if key[0] in (0x1010, 0x1011):
                self.objects[key] = 1
            self._tune()
        else:
            self.on_written([key])

    @staticmethod
    def _clear_history(value: int) -> None:
        if value:
            raise AbortError(Abort.VALUE)

    def _check_sync(self, value: int) -> None:
        if value & ~0x7FF:
            raise AbortError(Abort.VALUE)
        check_free(value)

    def _check_emergency(self, value: int) -> None:
        if value & 0x7FFFF800:
            raise AbortError(Abort.VALUE)
        old = self.objects[0x1014, 0]
        if not (value | old) & _OFF and value != old:
            raise AbortError(Abort.STATE)
        if not value & _OFF:
            check_free(value)

    def _check_consumer(self, k: int) -> Callable[[int], None]:
        def check(word: int) -> None:
            node, period = word >> 16 & 0xFF, word & 0xFFFF
            others = [self.objects[0x1016, n] for n in range(1, _CONSUMERS + 1) if n != k]
            if period and any(w & 0xFFFF and w >> 16 & 0xFF == node for w in others):
                raise AbortError(Abort.INCOMPATIBLE)

        return check

    def _store(self, kind: int) -> None:
        self._stored |= {k: v for k, v in self.objects.kept().items() if k[0] in _area(kind)}

    def _restore(self, kind: int) -> None:
        """Defaults count from the next reset on."""
        self._stored = {k: v for k, v in self._stored.items() if k[0] not in _area(kind)}


def _area(kind: int) -> range:
    """Indices of all parameters (1), those of the communication (2), of the application (3)."""
    return range(0x2000 if kind == 3 else 0x1000, 0x2000 if kind == 2 else 0x10000)


def _signed_off(word: int, act: Callable[[int], None], kind: int) -> Callable[[int], None]:
    """A check that acts where the signature is right."""

    def check(value: int) -> None:
        if value != word:
            raise AbortError(Abort.NOT_STORED)
        act(kind)

    return check
