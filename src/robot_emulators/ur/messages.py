"""Messages of the primary interface: what happened on the controller, each as its bytes.

Layout: Universal Robots, "Remote control via TCP/IP", Client_Interface.xlsx. Big endian: int32 size
of the whole message, uint8 20, uint64 time stamp [µs], int8 source, uint8 kind, then the kind's own
fields. A text at the end has no length, it ends with the message.
"""

import struct
from dataclasses import dataclass
from enum import IntEnum
from typing import Protocol

MESSAGE = 20
_ROBOT, _INTERFACE = 254, 255
"""Sources: the controller, and its program; as captured from a controller."""


class Level(IntEnum):
    """How grave an error code is."""

    INFO = 1
    WARNING = 2
    VIOLATION = 3
    FAULT = 4


class Event(Protocol):
    """Anything that clients of the primary interface are told."""

    def packed(self, timestamp: float) -> bytes:
        """The message, at the controller's time [s]."""
        ...


def _message(kind: int, source: int, timestamp: float, payload: bytes) -> bytes:
    head = struct.pack(">BQBB", MESSAGE, max(0, round(timestamp * 1e6)), source, kind)
    return struct.pack(">i", 4 + len(head) + len(payload)) + head + payload


def _text(text: str) -> bytes:
    return text.encode("utf-8", "replace")[:4096]


@dataclass(frozen=True)
class Version:
    """Which software this is; a client's first message."""

    numbers: tuple[int, int, int, int]
    date: str

    def packed(self, timestamp: float) -> bytes:
        """Kind 3."""
        name = b"URControl"
        major, minor, bugfix, build = self.numbers
        fields = struct.pack(">B9sBBii", len(name), name, major, minor, bugfix, build)
        return _message(3, _ROBOT, timestamp, fields + _text(self.date))


@dataclass(frozen=True)
class Said:
    """textmsg of a program."""

    text: str

    def packed(self, timestamp: float) -> bytes:
        """Kind 0."""
        return _message(0, _INTERFACE, timestamp, _text(self.text))


@dataclass(frozen=True)
class Popup:
    """popup of a program."""

    text: str
    title: str
    warning: bool
    error: bool
    blocking: bool

    def packed(self, timestamp: float) -> bytes:
        """Kind 2."""
        title = _text(self.title)[:255]
        fields = struct.pack(">IB???B", 0, 0, self.warning, self.error, self.blocking, len(title))
        return _message(2, _INTERFACE, timestamp, fields + title + _text(self.text))


@dataclass(frozen=True)
class Safety:
    """The safety mode has changed."""

    mode: int

    def packed(self, timestamp: float) -> bytes:
        """Kind 5."""
        return _message(5, _ROBOT, timestamp, struct.pack(">iiBII", 0, 0, self.mode, 1, 0))


@dataclass(frozen=True)
class Error:
    """An error code: ``C code A argument``."""

    code: int
    argument: int
    level: Level
    text: str = ""

    def packed(self, timestamp: float) -> bytes:
        """Kind 6."""
        fields = struct.pack(">iiiII", self.code, self.argument, self.level, 1, 0)
        return _message(6, _ROBOT, timestamp, fields + _text(self.text))


@dataclass(frozen=True)
class Key:
    """A program began or ended: ``PROGRAM_XXX_STARTED`` and the like, with its name."""

    title: str
    text: str

    def packed(self, timestamp: float) -> bytes:
        """Kind 7."""
        title = _text(self.title)[:255]
        fields = struct.pack(">iiB", 0, 0, len(title)) + title
        return _message(7, _INTERFACE, timestamp, fields + _text(self.text))


@dataclass(frozen=True)
class RuntimeFault:
    """A program cannot go on, at a line and column of its text, from 1."""

    line: int
    column: int
    text: str

    def packed(self, timestamp: float) -> bytes:
        """Kind 10."""
        fields = struct.pack(">II", max(0, self.line), max(0, self.column))
        return _message(10, _INTERFACE, timestamp, fields + _text(self.text))


STARTED, STOPPED = "PROGRAM_XXX_STARTED", "PROGRAM_XXX_STOPPED"
PAUSED, RESUMED = "PROGRAM_XXX_PAUSED", "PROGRAM_XXX_RESUMED"
PROTECTIVE_STOP = Error(209, 0, Level.WARNING, "Protective stop by a program")
"""C209: a program asked for a protective stop."""


def stopped_because(why: str) -> Error:
    """What the safety system objected to.

    C153A0 and its kin name the exact cause on a controller; the emulator says it in words, under
    one code of its own choice.
    """
    return Error(153, 0, Level.WARNING, why)
