"""One client of the hub: socketcand's text protocol as its server speaks it, with its handshake.

Commands and answers are enclosed in ``<`` and ``>``, with single spaces between words. Ids and data
are hexadecimal: three digits for an 11-bit id, eight for one of 29 bits.
Source: doc/protocol.md of linux-can/socketcand.
"""

import asyncio
import time
from typing import NamedTuple, Protocol

from robot_emulators.base.event_loop import Connection
from robot_emulators.can_bus.wire import Frame

LONGEST = 256
"""Longest command that is waited for [byte]."""
BUS_ERROR, BUS_OFF = 0x80, 0x40
"""Classes of error frames: a frame was destroyed; the sender is off the bus."""


class Command(NamedTuple):
    """What a client asks: its first word and the rest."""

    verb: str
    words: tuple[str, ...]


def split(buffer: bytes) -> tuple[list[Command], bytes, int]:
    """Commands in what a client sent, what is left of it, and how many pieces were rubbish."""
    commands: list[Command] = []
    rubbish = 0
    while True:
        start = buffer.find(b"<")
        if start < 0:
            return commands, b"", rubbish + bool(buffer.strip())
        rubbish += bool(buffer[:start].strip())
        end = buffer.find(b">", start)
        if end < 0:
            rest = buffer[start:]
            return (
                (commands, rest, rubbish) if len(rest) <= LONGEST else (commands, b"", rubbish + 1)
            )
        words = buffer[start + 1 : end].split()
        buffer = buffer[end + 1 :]
        try:
            texts = tuple(word.decode("ascii") for word in words)
        except UnicodeDecodeError:
            texts = ()
        if texts:
            commands.append(Command(texts[0], texts[1:]))
        else:
            rubbish += 1


def frame_of(words: tuple[str, ...]) -> Frame | None:
    """The frame of ``send id length bytes…``; None where the words are no frame."""
    if len(words) < 2 or len(words[0]) not in (3, 8):
        return None
    try:
        can_id, length = int(words[0], 16), int(words[1], 16)
        data = bytes(int(word, 16) for word in words[2:])
    except ValueError:
        return None
    extended = len(words[0]) == 8
    if can_id < 0 or can_id > (0x1FFFFFFF if extended else 0x7FF):
        return None
    if not 0 <= length <= 8 or len(data) != length:
        return None
    return Frame(can_id, data, extended)


def frame_text(frame: Frame, t: float) -> bytes:
    """``frame id seconds data`` for the clients; t [s]."""
    digits = "08X" if frame.extended else "03X"
    return f"< frame {frame.can_id:{digits}} {t:.6f} {frame.data.hex()} >".encode("ascii")


def error_text(t: float, kind: int) -> bytes:
    """An error frame for the clients; t [s], its class as SocketCAN writes it."""
    return f"< error {kind:08X} {t:.6f} >".encode("ascii")


BUFFER = 256 * 1024
"""Bytes that wait for a client at most; one that is slower is disconnected."""
_KERNEL = 64 * 1024
_QUIET_S = 0.1
"""So long after the answer to ``rawmode``, or until the client sends, frames are held back: clients
read that answer by itself."""


class Bus(Protocol):
    """What a client needs of the hub."""

    def joined(self, client: "Client") -> bool:
        """Take a new client; False where there are too many."""
        ...

    def gone(self, client: "Client") -> None:
        """Forget a client."""
        ...

    def hear(self, client: "Client", commands: list[Command], rubbish: int) -> None:
        """Take what a client sent."""
        ...


class Client(Connection):
    """A connection that spoke or will speak socketcand's text protocol."""

    def __init__(self, number: int, channel: str, bus: Bus) -> None:
        super().__init__(_KERNEL)
        self.number = number
        self.raw = self.spoke = False
        self.off_until = 0.0
        self._channel, self._bus = channel, bus
        self._opened = False
        self._quiet_until = 0.0
        self._in, self._out, self._held = b"", bytearray(), bytearray()

    @property
    def off(self) -> bool:
        """Whether it is bus off: it hears nothing and is not heard."""
        return self.off_until > 0.0 and time.monotonic() < self.off_until

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        if self._bus.joined(self):
            self.answer("hi")
            self.flush()
        else:
            self.close()

    def connection_lost(self, error: Exception | None) -> None:
        self._bus.gone(self)

    def data_received(self, data: bytes) -> None:
        commands, self._in, rubbish = split(self._in + data)
        self._bus.hear(self, commands, rubbish)

    def obey(self, command: Command) -> None:
        """Answer everything but ``send``."""
        if command.verb == "open" and not self._opened:
            self._opened = command.words == (self._channel,)
            self.answer("ok" if self._opened else "error could not open bus")
        elif command.verb == "rawmode" and self._opened:
            self.answer("ok")
            self.raw, self._quiet_until = True, time.monotonic() + _QUIET_S
            asyncio.get_running_loop().call_at(self._quiet_until, self.flush)
        elif command.verb == "echo":
            self.answer("echo")
        else:
            self.answer("error unknown command")

    def answer(self, text: str) -> None:
        """Queue an answer."""
        self._out += f"< {text} >".encode("ascii")

    def say(self, text: bytes) -> None:
        """Queue a frame for a client in raw mode, unless it is bus off."""
        if self.raw and not self.off:
            queue = self._held if self._quiet_until else self._out
            queue += text

    def speaks(self) -> None:
        """It sent a frame, so it has read the answer to ``rawmode``."""
        self.spoke = True
        self._quiet_until = 0.0

    def flush(self) -> bool:
        """Send what is queued; False where the client is too slow."""
        if self._quiet_until and time.monotonic() >= self._quiet_until:
            self._quiet_until = 0.0
        if self._held and not self._quiet_until:
            self._out += self._held
            self._held.clear()
        if self._out and not self.closed:
            self.transport.write(bytes(self._out))
        self._out.clear()
        return self.closed or self.waiting + len(self._held) <= BUFFER
