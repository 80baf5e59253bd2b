"""Frames, and socketcand's text protocol as its server speaks it.

Commands and answers are enclosed in ``<`` and ``>``, with single spaces between words. Ids and data
are hexadecimal: three digits for an 11-bit id, eight for one of 29 bits.
Source: doc/protocol.md of linux-can/socketcand.
"""

from typing import NamedTuple

LONGEST = 256
"""Longest command that is waited for [byte]; a frame of 8 bytes with a 29-bit id has 46."""
_BUS_ERROR, _BUS_OFF = 0x80, 0x40
"""Classes of error frames, as SocketCAN writes them."""


class Frame(NamedTuple):
    """A frame: id, data, whether the id has 29 bits, and whether it only asks for data."""

    can_id: int
    data: bytes
    extended: bool = False
    remote: bool = False


class Command(NamedTuple):
    """A command of a client: its first word and the words after it."""

    verb: str
    words: tuple[str, ...]


def split(buffer: bytes) -> tuple[list[Command], bytes, int]:
    """Split bytes of a client into commands, the bytes of an unfinished one, and the number of
    pieces that are no command."""
    commands: list[Command] = []
    rubbish = 0
    while True:
        start = buffer.find(b"<")
        if start < 0:
            return commands, b"", rubbish + bool(buffer.strip())
        rubbish += bool(buffer[:start].strip())
        end = buffer.find(b">", start)
        if end < 0 and len(buffer) - start <= LONGEST:
            return commands, buffer[start:], rubbish
        text = buffer[start + 1 : end]
        buffer = buffer[end + 1 :] if end >= 0 else b""
        if end >= 0 and text.isascii() and text.split():
            verb, *words = text.decode("ascii").split()
            commands.append(Command(verb, tuple(words)))
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
    known = 0 <= can_id <= (0x1FFFFFFF if extended else 0x7FF)
    return Frame(can_id, data, extended) if known and len(data) == length <= 8 else None


def frame_text(frame: Frame, t: float) -> bytes:
    """``frame id seconds data`` for the clients; t [s]."""
    digits = "08X" if frame.extended else "03X"
    return f"< frame {frame.can_id:{digits}} {t:.6f} {frame.data.hex()} >".encode("ascii")


def bus_off_text(t: float) -> bytes:
    """Error frames for a client at a time [s]: its frame was destroyed, and it is off the bus."""
    return b"".join(f"< error {kind:08X} {t:.6f} >".encode() for kind in (_BUS_ERROR, _BUS_OFF))
