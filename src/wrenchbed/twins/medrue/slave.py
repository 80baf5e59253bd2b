"""A CANopen node: NMT, an expedited SDO server, heartbeat, emergency, and SYNC handed on.

Source: CiA 301 and its predefined connection set. Everything here runs in the bus's thread, but
`beat`, which the plant's thread calls.
"""

import struct
from collections.abc import Callable

from wrenchbed.serving.canbus.wire import Frame
from wrenchbed.twins.medrue.objects import BAD_COMMAND, WRONG_STATE, AbortError, Objects

BOOT, STOPPED, OPERATIONAL, PRE_OPERATIONAL = 0x00, 0x04, 0x05, 0x7F
_LOCKED = (0x1600, 0x1A00, 0x1400, 0x1800)
SYNC = 0x080


class Slave:
    """A node without its purpose.

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

    def boot(self, whole: bool = True) -> None:
        """Come up: say so and wait in PRE-OPERATIONAL.

        Args:
            whole: the node; else its communication alone.
        """
        self._define_communication()
        self.on_reset_communication()
        if whole:
            self.on_reset()
        self.state = PRE_OPERATIONAL
        self.send(0x700 + self.node, bytes([BOOT]))

    def emergency(self, code: int, register: int) -> None:
        """Tell an error code, 0 where it is gone."""
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
            self.boot(whole=command == 0x81)

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
