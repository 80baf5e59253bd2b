"""What the readers of logs share: channels, and numbers and texts taken from bytes in order."""

import struct
from collections.abc import Generator
from dataclasses import dataclass
from typing import Any, Protocol

from wrenchbed.errors import MapError

LATEST = 2**63 - 1
"""Largest time of a message [ns]: what 64 bits with a sign hold."""


@dataclass(frozen=True)
class Channel:
    """Messages of one kind on one topic.

    Attributes:
        topic: its name.
        kind: of its messages, ``geometry_msgs/msg/WrenchStamped``.
        encoding: ``cdr``, ``ros1`` or ``json``.
        definition: text that defines the kind; empty where the log holds none.
        language: of the definition, ``msg`` or ``idl``.
        digest: checksum of the definition as the log states it; empty without one.
    """

    topic: str
    kind: str
    encoding: str
    definition: str = ""
    language: str = "msg"
    digest: str = ""


Messages = Generator[tuple[Channel, int, bytes], None, None]
"""Channel, time of writing [ns] and content of messages, in the order of the file."""


class Log(Protocol):
    """A file or folder of messages, which is checked while it is read."""

    @property
    def topics(self) -> dict[str, str]:
        """Topics and their kinds: complete after `messages` came to its end."""

    def messages(self, topic: str | None) -> Messages:
        """Messages of one topic; None reads and checks all and yields none.

        Raises:
            MapError: the log is cut or damaged; names the file, the part and the byte.
        """


class Cursor:
    """Bytes taken one after the other.

    Args:
        data: all of them.
        where: file and part, for messages.
    """

    def __init__(self, data: bytes | memoryview, where: str) -> None:
        self.data, self.where, self.at = memoryview(data), where, 0

    @property
    def left(self) -> int:
        """How many bytes are left."""
        return len(self.data) - self.at

    def take(self, size: int) -> bytes:
        """The next bytes.

        Raises:
            MapError: fewer are left.
        """
        if size > self.left:
            raise MapError(f"{self.where}: ends early: wants {size:,} bytes, has {self.left:,}")
        self.at += size
        return bytes(self.data[self.at - size : self.at])

    def numbers(self, layout: str) -> tuple[Any, ...]:
        """Numbers in a layout of `struct`."""
        return struct.unpack(layout, self.take(struct.calcsize(layout)))

    def number(self, layout: str) -> int:
        """One whole number."""
        return int(self.numbers(layout)[0])

    def text(self) -> str:
        """A text in UTF-8 with its length (uint32) before it."""
        return decoded(self.take(self.number("<I")), self.where)


def decoded(data: bytes, where: str) -> str:
    """A text in UTF-8.

    Raises:
        MapError: it is none.
    """
    try:
        return data.decode()
    except UnicodeDecodeError as error:
        raise MapError(f"{where}: a text in it is not UTF-8: damaged") from error
