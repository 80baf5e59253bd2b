"""One client of the hub: its handshake, and a bounded buffer of what it has yet to read.

The text protocol of socketcand, as its server speaks it.

Commands and answers stand between ``<`` and ``>``, words between single spaces; numbers of ids and
data are hexadecimal, three digits for an 11-bit id and eight for one of 29 bits.
Source: doc/protocol.md of linux-can/socketcand.
"""

import socket
import time
from typing import NamedTuple

from wrenchbed.emulators.can_bus.wire import Frame

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
read that answer on its own."""


class Client:
    """A connection that spoke or will speak socketcand's text protocol."""

    def __init__(self, number: int, connection: socket.socket, channel: str) -> None:
        self.number, self.connection, self.channel = number, connection, channel
        self.raw = self.too_slow = self.spoke = False
        self.off_until = 0.0
        self._opened = False
        self._quiet_until = 0.0
        self._in, self._out, self._held = b"", bytearray(), bytearray()
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _KERNEL)
        self.answer("hi")

    @property
    def waiting(self) -> bool:
        """Whether it has bytes yet to take."""
        return bool(self._out or self._held)

    @property
    def off(self) -> bool:
        """Whether it is bus off: it hears nothing and is not heard."""
        return self.off_until > 0.0 and time.monotonic() < self.off_until

    def receive(self) -> tuple[list[Command], int, bool]:
        """Commands that arrived, pieces of rubbish, and whether the connection is alive."""
        try:
            got = self.connection.recv(65536)
        except BlockingIOError:
            return [], 0, True
        except OSError:
            return [], 0, False
        if not got:
            return [], 0, False
        commands, self._in, rubbish = split(self._in + got)
        return commands, rubbish, True

    def obey(self, command: Command) -> None:
        """Answer everything but ``send``."""
        if command.verb == "open" and not self._opened:
            self._opened = command.words == (self.channel,)
            self.answer("ok" if self._opened else "error could not open bus")
        elif command.verb == "rawmode" and self._opened:
            self.answer("ok")
            self.raw, self._quiet_until = True, time.monotonic() + _QUIET_S
        elif command.verb == "echo":
            self.answer("echo")
        else:
            self.answer("error unknown command")

    def answer(self, text: str) -> None:
        """Queue an answer."""
        self._out += f"< {text} >".encode("ascii")

    def say(self, text: bytes) -> None:
        """Queue a frame for a client in raw mode, unless it is bus off."""
        if self.off:
            return
        if self.raw and self._quiet_until:
            self._held += text
        elif self.raw:
            self._out += text

    def speaks(self) -> None:
        """It sent a frame, so it has read the answer to ``rawmode``."""
        self.spoke = True
        self._quiet_until = 0.0

    def flush(self) -> bool:
        """Send what the connection takes now; False where it is dead or too slow."""
        if self._quiet_until and time.monotonic() >= self._quiet_until:
            self._quiet_until = 0.0
        if self._held and not self._quiet_until:
            self._out += self._held
            self._held.clear()
        if self._out:
            try:
                del self._out[: self.connection.send(self._out)]
            except BlockingIOError:
                pass
            except OSError:
                return False
        self.too_slow = len(self._out) + len(self._held) > BUFFER
        return not self.too_slow
