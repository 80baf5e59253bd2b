"""A CAN bus as a server: clients of socketcand, over TCP, and devices of this process hear each
other's frames.

One thread does everything. A device's callback runs in it and must return at once. Frames pass at
once and in the order of arrival. An exception of a device or a task is reported and the bus goes
on. An error of the bus itself is reported too; it closes the port and every connection.

Commands and answers of socketcand are enclosed in ``<`` and ``>``, with single spaces between
words. Ids and data are hexadecimal: three digits for an 11-bit id, eight for one of 29 bits.
Source: doc/protocol.md of linux-can/socketcand.
"""

import asyncio
import contextlib
import time
import warnings
from collections import Counter, deque
from collections.abc import Callable
from typing import NamedTuple

from robot_emulators.base.event_loop import Connection, Listener, LoopThread
from robot_emulators.errors import EmulatorWarning

LONGEST = 256
"""Longest command that a client may send [byte]; a frame of 8 bytes with a 29-bit id has 46."""
_BUS_ERROR, _BUS_OFF = 0x80, 0x40
"""Classes of CAN error frames in SocketCAN's numbers: bus error, bus off."""
MOST = 16
"""Largest number of clients at a time."""
BUFFER = 256 * 1024
"""Most bytes that wait for a client, half a second of a full 1 Mbit/s bus; else it is cut off."""
_POSTED = 4096
"""Most frames that wait for the bus's thread; older ones are lost."""
_KERNEL = 64 * 1024
_QUIET_S = 0.1
"""Time after the answer to ``rawmode`` in which frames wait [s], until the client sends: clients
expect that answer alone."""


class Frame(NamedTuple):
    """A CAN frame: its id, its data, and whether the id is an extended one of 29 bits."""

    can_id: int
    data: bytes
    extended: bool = False


Heard = Callable[[float, Frame], None]
"""Called with the time at which a frame came (`time.monotonic` [s]) and the frame."""


class Command(NamedTuple):
    """A command of socketcand's protocol (CAN over TCP): first word (the verb), words after it."""

    verb: str
    words: tuple[str, ...]


def split(buffer: bytes) -> tuple[list[Command], bytes, int]:
    """Split bytes that a socketcand client sent into commands, the unfinished rest, and the number
    of invalid pieces."""
    *pieces, rest = buffer.split(b">")
    commands: list[Command] = []
    rubbish = 0
    for piece in pieces:
        before, _, text = piece.partition(b"<")
        words = text.decode("ascii", "ignore").split() if text.isascii() else []
        if words:
            commands.append(Command(words[0], tuple(words[1:])))
        rubbish += bool(before.strip()) + (not words)
    before, mark, text = rest.partition(b"<")
    short = mark if len(text) < LONGEST else b""
    return commands, short and mark + text, rubbish + bool(before.strip()) + (mark != short)


def frame_of(words: tuple[str, ...]) -> Frame | None:
    """Decode the words ``id length bytes…`` of socketcand's ``send`` to a frame; None if
    invalid."""
    if len(words) < 2 or len(words[0]) not in (3, 8):
        return None
    try:
        can_id, length = int(words[0], 16), int(words[1], 16)
        data = bytes(int(word, 16) for word in words[2:])
    except ValueError:
        return None
    extended = len(words[0]) == 8
    known = 0 <= can_id <= (0x1FFFFFFF if extended else 0x7FF)
    return Frame(can_id, data, extended) if known and len(data) == length <= 8 else None


def frame_text(frame: Frame, t: float) -> bytes:
    """Return socketcand's ``< frame id seconds data >`` as bytes, with the time stamp t [s]."""
    digits = "08X" if frame.extended else "03X"
    return f"< frame {frame.can_id:{digits}} {t:.6f} {frame.data.hex()} >".encode("ascii")


def bus_off_text(t: float) -> bytes:
    """Return socketcand's error messages for a client that goes bus off at time t [s], as bytes."""
    return b"".join(f"< error {kind:08X} {t:.6f} >".encode() for kind in (_BUS_ERROR, _BUS_OFF))


class Hub:
    """An emulated CAN bus that serves socketcand's protocol (CAN over TCP) at ``host:port``.

    Args:
        host: address of this machine to bind to.
        port: TCP port, 0 for any free one.
        channel: bus name that clients open.
        failed: called, besides a warning, with every exception of a device, a task or the bus.
    """

    def __init__(
        self,
        host: str,
        port: int = 29536,
        channel: str = "can0",
        failed: Callable[[Exception], None] = lambda error: None,
    ) -> None:
        self.host, self.port, self.channel = host, port, channel
        self.loses: Callable[[Frame], bool] = lambda frame: False
        """Function that decides whether a frame is lost now, by a fault."""
        self.counters: Counter[str] = Counter()
        self._failed = failed
        self._devices: dict[int, Heard] = {}
        self._posted: deque[tuple[int, Frame]] = deque(maxlen=_POSTED)
        self._numbers = 0
        self._thread = LoopThread("can hub", self._break_down)
        self._bus = Listener(self._thread, (host, port), "CAN", self._client, MOST)

    def attach(self, heard: Heard | None = None) -> Callable[[Frame], None]:
        """Add a device: ``heard(t, frame)`` gets others' frames; return a function to send one."""
        number = self._number()

        def post(frame: Frame) -> None:
            self._posted.append((number, frame))
            if not self._thread.inside:
                self._thread.soon(self._pass_on)

        if heard is not None:
            self._devices = {**self._devices, number: heard}  # the hub's thread may be reading them
        return post

    def start(self) -> None:
        """Begin to accept clients of the bus; `EmulatorError` if the port is taken or forbidden."""
        self._thread.start()
        self._bus.open()
        self.port = self._bus.address[1]

    def stop(self) -> None:
        """Close the bus and all its connections; may be called twice."""
        self._thread.soon(self._bus.close)
        self._thread.stop()

    def order(self, task: Callable[[], None]) -> None:
        """Schedule ``task`` to run in the bus's thread; do not wait for it."""

        def run() -> None:
            try:
                task()
            except Exception as error:
                self._fail(error)
            self._pass_on()

        self._thread.soon(run)

    def say(self, text: bytes) -> None:
        """Send text of socketcand's protocol to every client; call it in the bus's thread."""
        for client in self._bus.clients:
            client.say(text)

    def hang_up(self) -> None:
        """Close every client's connection; call it in the bus's thread."""
        self._bus.hang_up()

    def bus_off(self, until: float) -> None:
        """Make every client that has sent frames bus off; call it in the bus's thread. It gets
        error frames, then no frame, and none of its own reaches the bus until ``until``
        (`time.monotonic`) or until it reconnects. A client that only listens is never bus off."""
        for client in self._bus.clients:
            if client.spoke:
                client.say(bus_off_text(time.time()))
                client.off_until = until

    def hear(self, client: "Client", commands: list[Command], rubbish: int) -> None:
        """Execute a client's commands; count ``rubbish``, the number of its invalid inputs."""
        self.counters["rubbish"] += rubbish
        for command in commands:
            if client.raw and command.verb == "send":
                client.speaks()
                frame = frame_of(command.words)
                if frame is None:
                    client.answer("error could not parse send command")
                    self.counters["rubbish"] += 1
                elif not client.off:
                    self._posted.append((client.number, frame))
            else:
                client.obey(command)
        self._pass_on()

    def _client(self) -> "Client":
        return Client(self._number(), self, self._bus)

    def _number(self) -> int:
        self._numbers += 1
        return self._numbers

    def _fail(self, error: Exception) -> None:
        self.counters["failures"] += 1
        self._failed(error)
        with contextlib.suppress(EmulatorWarning):
            warnings.warn(f"on the CAN bus: {error!r}", EmulatorWarning, stacklevel=2)

    def _break_down(self, error: Exception) -> None:
        self._bus.close()
        self._fail(error)

    def _pass_on(self) -> None:
        """Deliver queued frames to all other nodes, also those that devices send in answer."""
        while self._posted:
            sender, frame = self._posted.popleft()
            if self.loses(frame):
                self.counters["lost in stall"] += 1
            else:
                self._deliver(sender, frame)
        for client in self._bus.clients:
            if not client.flush():
                self.counters["slow clients"] += 1
                client.close()

    def _deliver(self, sender: int, frame: Frame) -> None:
        self.counters["frames"] += 1
        t = time.monotonic()
        for number, heard in self._devices.items():
            if number == sender:
                continue
            try:
                heard(t, frame)
            except Exception as error:
                self._fail(error)
        text = frame_text(frame, time.time())
        for client in self._bus.clients:
            if client.number != sender:
                client.say(text)


class Client(Connection):
    """Connection of one client to the CAN bus by socketcand's protocol (CAN over TCP)."""

    def __init__(self, number: int, hub: Hub, bus: "Listener[Client]") -> None:
        super().__init__(bus, _KERNEL)
        self.number = number
        self.raw = self.spoke = False
        self.off_until = 0.0
        self._hub = hub
        self._opened = False
        self._quiet_until = 0.0
        self._in, self._out, self._held = b"", bytearray(), bytearray()

    @property
    def off(self) -> bool:
        """Whether the client is bus off: it receives no frame and its frames reach nobody."""
        return self.off_until > 0.0 and time.monotonic() < self.off_until

    def welcome(self) -> None:
        self.answer("hi")
        self.flush()

    def data_received(self, data: bytes) -> None:
        commands, self._in, rubbish = split(self._in + data)
        self._hub.hear(self, commands, rubbish)

    def obey(self, command: Command) -> None:
        """Execute and answer a command of the client other than ``send``."""
        if command.verb == "open" and not self._opened:
            self._opened = command.words == (self._hub.channel,)
            self.answer("ok" if self._opened else "error could not open bus")
        elif command.verb == "rawmode" and self._opened:
            self.answer("ok")
            self.raw, self._quiet_until = True, time.monotonic() + _QUIET_S
            asyncio.get_running_loop().call_at(self._quiet_until, self.flush)
        else:
            self.answer("error unknown command")

    def answer(self, text: str) -> None:
        self._out += f"< {text} >".encode("ascii")

    def say(self, text: bytes) -> None:
        """Queue text for this socketcand client if it is in raw mode (gets frames), not bus off."""
        if self.raw and not self.off:
            queue = self._held if self._quiet_until else self._out
            queue += text

    def speaks(self) -> None:
        """Note that the client has sent a frame, so that it has read the answer to ``rawmode``."""
        self.spoke = True
        self._quiet_until = 0.0

    def flush(self) -> bool:
        """Send what is queued for the client; return False if it reads too slowly."""
        if self._quiet_until and time.monotonic() >= self._quiet_until:
            self._quiet_until = 0.0
        if self._held and not self._quiet_until:
            self._out += self._held
            self._held.clear()
        if self._out and not self.closed:
            self.transport.write(bytes(self._out))
        self._out.clear()
        return self.closed or self.waiting + len(self._held) <= BUFFER
