"""Messages of the primary interface on events of the controller.

Layout: Universal Robots, "Remote control via TCP/IP", Client_Interface.xlsx. Big endian: int32 size
of the whole message, uint8 20, uint64 time stamp [µs], int8 source, uint8 kind, then the fields of
that kind. A text at the end has no length: it fills the rest of the message.
"""

import struct
from dataclasses import dataclass

MESSAGE = 20
_ROBOT, _INTERFACE = 254, 255
"""Sources of messages: the controller, and its program; as captured from a controller."""
SAID, POPUP, VERSION, SAFETY, ERROR, KEY, FAULT = 0, 2, 3, 5, 6, 7, 10
"""Kinds of messages of the primary interface."""
_WARNING = 2
"""Level of an error message: warning (1 is an information, 3 a violation, 4 a fault)."""
STARTED, STOPPED = "PROGRAM_XXX_STARTED", "PROGRAM_XXX_STOPPED"
PAUSED, RESUMED = "PROGRAM_XXX_PAUSED", "PROGRAM_XXX_RESUMED"


@dataclass(frozen=True)
class Event:
    """A message about an event that clients of the primary interface (port 30001) receive.

    Attributes:
        kind: message type, `SAID` … `FAULT`.
        source: number of the controller part that sends it.
        fields: packed fields of this message type.
        text: text at the end of the message.
    """

    kind: int
    source: int
    fields: bytes
    text: str = ""

    def packed(self, timestamp: float) -> bytes:
        """Return the bytes of the whole message with the controller's time stamp [s]."""
        micros = max(0, round(timestamp * 1e6))
        head = struct.pack(">BQBB", MESSAGE, micros, self.source, self.kind)
        payload = head + self.fields + _encoded(self.text)
        return struct.pack(">i", 4 + len(payload)) + payload


def _encoded(text: str) -> bytes:
    return text.encode("utf-8", "replace")[:4096]


def _titled(title: str) -> bytes:
    encoded = _encoded(title)[:255]
    return bytes([len(encoded)]) + encoded


def version(numbers: tuple[int, int, int, int], date: str) -> Event:
    """Make the message of the software version, ``numbers`` major, minor, bugfix, build, and its
    build ``date``; the first message that a client gets."""
    major, minor, bugfix, build = numbers
    fields = struct.pack(">BBii", major, minor, bugfix, build)
    return Event(VERSION, _ROBOT, _titled("URControl") + fields, date)


def said(text: str) -> Event:
    """Make the message that a program sends by textmsg."""
    return Event(SAID, _INTERFACE, b"", text)


def popup_shown(text: str, title: str, flags: tuple[bool, bool, bool]) -> Event:
    """Make the message of a program's popup; ``flags`` are warning, error and blocking."""
    return Event(POPUP, _INTERFACE, struct.pack(">IB???", 0, 0, *flags) + _titled(title), text)


def safety(mode: int) -> Event:
    """Make the message of the present safety mode, by its number in RTDE's ``safety_mode``."""
    return Event(SAFETY, _ROBOT, struct.pack(">iiBII", 0, 0, mode, 1, 0))


def error(code: int, argument: int, text: str) -> Event:
    """Make the message of a warning by its code and argument, shown as ``C<code>A<argument>``."""
    return Event(ERROR, _ROBOT, struct.pack(">iiiII", code, argument, _WARNING, 1, 0), text)


def key(title: str, text: str) -> Event:
    """Make the message that a program, named ``text``, began or ended (``title``, as `STARTED`)."""
    return Event(KEY, _INTERFACE, struct.pack(">ii", 0, 0) + _titled(title), text)


def runtime_fault(line: int, column: int, text: str) -> Event:
    """Make the message that a program failed at a line and column of its text, both from 1."""
    return Event(FAULT, _INTERFACE, struct.pack(">II", max(0, line), max(0, column)), text)


def stopped_because(why: str) -> Event:
    """Make the message with the reason of a stop by the safety system, always with code C153A0: a
    controller has a code for each cause."""
    return error(153, 0, why)


PROTECTIVE_STOP = error(209, 0, "Protective stop by a program")
"""Message C209A0: a program asked for a protective stop."""
