"""A CANopen node: object dictionary, NMT, expedited SDO server, heartbeat and emergency.

Values have one to four bytes. All methods run in the bus's thread except `beat`, which the plant's
thread calls. Sources: CiA 301 (communication objects, predefined connection set, abort codes) and
CiA 402 (drive objects).
"""

import struct
from collections.abc import Callable
from dataclasses import dataclass

from wrenchbed.emulators.can_bus.wire import Frame

Key = tuple[int, int]
"""Index and subindex."""

NO_OBJECT, NO_SUBINDEX, READ_ONLY = 0x06020000, 0x06090011, 0x06010002
WRONG_LENGTH, WRONG_VALUE, WRONG_STATE = 0x06070010, 0x06090030, 0x08000022
NOT_MAPPABLE, TOO_LONG, BAD_COMMAND = 0x06040041, 0x06040042, 0x05040001


class AbortError(Exception):
    """An SDO transfer that the drive refuses, with CiA 301's code."""

    def __init__(self, code: int) -> None:
        super().__init__(f"0x{code:08X}")
        self.code = code


@dataclass
class Entry:
    """One value: its size [byte], sign, access, whether a PDO may carry it, and a check that runs
    before it is written."""

    value: int
    size: int
    signed: bool = False
    writable: bool = True
    mappable: bool = False
    check: Callable[[int], None] | None = None

    def read(self, raw: bytes) -> int:
        """The value that some bytes would make it.

        Raises:
            AbortError: it may not have that value.
        """
        value = int.from_bytes(raw, "little", signed=self.signed)
        if self.check is not None:
            self.check(value)
        return value


class Objects:
    """The dictionary of one node."""

    def __init__(self) -> None:
        self._entries: dict[Key, Entry] = {}

    def add(
        self,
        index: int,
        sub: int,
        value: int,
        size: int,
        *,
        signed: bool = False,
        writable: bool = True,
        mappable: bool = False,
        check: Callable[[int], None] | None = None,
    ) -> None:
        """Define a value of 1, 2 or 4 bytes, or make it anew."""
        self._entries[index, sub] = Entry(value, size, signed, writable, mappable, check)

    def __getitem__(self, key: Key) -> int:
        return self._entries[key].value

    def __setitem__(self, key: Key, value: int) -> None:
        self._entries[key].value = value

    def size(self, key: Key) -> int | None:
        """Bytes of a value, None where there is none."""
        entry = self._entries.get(key)
        return None if entry is None else entry.size

    def pack(self, key: Key) -> bytes:
        """A value as it goes over the bus, little endian.

        Raises:
            AbortError: there is none.
        """
        entry = self._find(key)
        span = 1 << 8 * entry.size
        return (entry.value % span).to_bytes(entry.size, "little")

    def carried(self, key: Key, writing: bool) -> int | None:
        """Bits of a value that a PDO may carry, None where it may not.

        Args:
            key: of the value.
            writing: whether the PDO would write it.
        """
        entry = self._entries.get(key)
        if entry is None or not entry.mappable or (writing and not entry.writable):
            return None
        return 8 * entry.size

    def read(self, key: Key, raw: bytes) -> int:
        """The value that some bytes of a PDO would make it.

        Raises:
            AbortError: there is no such value, or it may not be that.
        """
        return self._find(key).read(raw)

    def write(self, key: Key, raw: bytes) -> None:
        """Take a value from an SDO client.

        Raises:
            AbortError: it may not be written, or not so.
        """
        entry = self._find(key)
        if not entry.writable:
            raise AbortError(READ_ONLY)
        if len(raw) != entry.size:
            raise AbortError(WRONG_LENGTH)
        entry.value = entry.read(raw)

    def _find(self, key: Key) -> Entry:
        if key in self._entries:
            return self._entries[key]
        known = any(index == key[0] for index, _ in self._entries)
        raise AbortError(NO_SUBINDEX if known else NO_OBJECT)


BOOT, STOPPED, OPERATIONAL, PRE_OPERATIONAL = 0x00, 0x04, 0x05, 0x7F
_LOCKED = (0x1600, 0x1A00, 0x1400, 0x1800)
SYNC = 0x080


class Slave:
    """A node without a device profile.

    Args:
        node: id, 1 … 127.
        send: puts a frame on the bus.
    """

    def __init__(self, node: int, send: Callable[[Frame], None]) -> None:
        self.node = node
        self.objects = Objects()
        self.state = PRE_OPERATIONAL
        self.mute = False
        self.heartbeat_off_until = 0.0
        self._send = send
        self._beat_due = 0.0
        self._define_communication()

    def _define_communication(self) -> None:
        """The communication area as it is after power-up."""
        add, node = self.objects.add, self.node
        add(0x1000, 0, 0x00020192, 4, writable=False)
        add(0x1001, 0, 0, 1, writable=False, mappable=True)
        add(0x1005, 0, SYNC, 4)
        add(0x1006, 0, 0, 4)
        add(0x1014, 0, 0x80 + node, 4, writable=False)
        add(0x1017, 0, 0, 2)
        add(0x1018, 0, 4, 1, writable=False)
        for sub, value in enumerate((0, 0x402, 1, node), start=1):
            add(0x1018, sub, value, 4, writable=False)

    def send(self, can_id: int, data: bytes) -> None:
        """Put a frame on the bus, unless the node is mute."""
        if not self.mute:
            self._send(Frame(can_id, data))

    def hear(self, t: float, frame: Frame) -> None:
        """Take a frame from the bus."""
        if frame.extended or self.mute:
            return
        if frame.can_id == 0x000:
            self._nmt(frame.data)
        elif frame.can_id == 0x600 + self.node and self.state != STOPPED:
            self._sdo(frame.data)
        elif self.state == OPERATIONAL:
            if frame.can_id == SYNC:
                self.on_sync(t)
            else:
                self.on_frame(t, frame)

    def on_sync(self, t: float) -> None:
        """A SYNC at a time [s] while operational."""

    def on_frame(self, t: float, frame: Frame) -> None:
        """Any other frame while operational."""

    def on_reset(self) -> None:
        """Back to what it is after power-up."""

    def on_reset_communication(self) -> None:
        """The process data back to what they are after power-up."""

    def boot(self, everything: bool = True) -> None:
        """Boot: send the boot-up message and wait in PRE-OPERATIONAL.

        Args:
            everything: the node; else its communication alone.
        """
        self._define_communication()
        self.on_reset_communication()
        if everything:
            self.on_reset()
        self.state = PRE_OPERATIONAL
        self.send(0x700 + self.node, bytes([BOOT]))

    def emergency(self, code: int, register: int) -> None:
        """Send an error code, 0 where it is gone."""
        self.objects[0x1001, 0] = register
        self.send(0x80 + self.node, struct.pack("<HB5x", code, register))

    def beat(self, t: float) -> None:
        """Send the heartbeat where it is due at a time [s]."""
        period = self.objects[0x1017, 0] / 1000.0
        if period and t >= self._beat_due:
            self._beat_due = max(self._beat_due + period, t)
            if t >= self.heartbeat_off_until:
                self.send(0x700 + self.node, bytes([self.state]))

    def _nmt(self, data: bytes) -> None:
        if len(data) < 2 or data[1] not in (0, self.node):
            return
        command = data[0]
        states = {0x01: OPERATIONAL, 0x02: STOPPED, 0x80: PRE_OPERATIONAL}
        if command in states:
            self.state = states[command]
        elif command in (0x81, 0x82):
            self.boot(everything=command == 0x81)

    def _sdo(self, data: bytes) -> None:
        if len(data) < 8:
            return
        command, index, sub = struct.unpack_from("<BHB", data)
        try:
            answer = self._transfer(command, index, sub, data[4:8])
        except AbortError as abort:
            answer = struct.pack("<BHBI", 0x80, index, sub, abort.code)
        if answer:
            self.send(0x580 + self.node, answer)

    def _transfer(self, command: int, index: int, sub: int, raw: bytes) -> bytes:
        if command >> 5 == 2:
            value = self.objects.pack((index, sub))
            first = 0x43 | (4 - len(value)) << 2
            return struct.pack("<BHB", first, index, sub) + value.ljust(4, b"\0")
        if command >> 5 == 1 and command & 0x02:
            length = 4 - (command >> 2 & 3) if command & 0x01 else 4
            if index & 0xFF00 in _LOCKED and self.state == OPERATIONAL and sub != 5:
                raise AbortError(WRONG_STATE)
            self.objects.write((index, sub), raw[:length])
            return struct.pack("<BHB4x", 0x60, index, sub)
        if command == 0x80:
            return b""
        raise AbortError(BAD_COMMAND)
