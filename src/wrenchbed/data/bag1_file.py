"""A bag of ROS 1 (version 2.0), read in order and checked against its own index.

Format: http://wiki.ros.org/Bags/Format/2.0. It has no checksums. Checked are all lengths, that the
index tells of the same chunks, connections and messages as the data, and the checksum (MD5) of
each definition of messages.
"""

import re
import struct
from collections import Counter
from pathlib import Path
from typing import BinaryIO

from wrenchbed.data.log_records import Channel, Cursor, Messages, decoded
from wrenchbed.data.unpacking import Unpacker
from wrenchbed.errors import MapError

MAGIC = b"#ROSBAG V2.0\n"
_DATA, _BAG, _INDEX, _CHUNK, _INFO, _CONNECTION = range(2, 8)
_SLASHES = re.compile("/+")
_U32 = struct.Struct("<I")


class Bag1File:
    """See `log_records.Log`.

    Args:
        path: of the file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._channels: dict[int, Channel] = {}

    @property
    def topics(self) -> dict[str, str]:
        """Topics and their kinds."""
        return {c.topic: c.kind for c in self._channels.values()}

    def messages(self, topic: str | None) -> Messages:
        """Messages of one topic; None reads and checks all and yields none.

        Raises:
            MapError: see `log_records.Log`.
        """
        self._channels = {}
        self._found: dict[int, Counter[int]] = {}
        """Messages of each connection in the chunks, by their place in the file."""
        self._unpacker, self._size = Unpacker(self.path), self.path.stat().st_size
        with self.path.open("rb") as stream:
            if stream.read(len(MAGIC)) != MAGIC:
                raise MapError(f"{self.path}: not a bag that can be read: it begins as none")
            kind, head, _ = self._record(stream)
            if kind != _BAG:
                raise MapError(f"{self.path}: not a bag that can be read: it has no header")
            index = head.number("index_pos", "<Q")
            if index == 0:
                raise MapError(f"{self.path}: was not closed; mend it with `rosbag reindex`")
            if not stream.tell() <= index <= self._size:
                raise MapError(f"{self.path}: ends early: its index lies at byte {index}")
            yield from self._body(stream, index, topic)
        stated = head.number("conn_count"), head.number("chunk_count")
        if stated != (len(self._channels), len(self._found)):
            raise MapError(
                f"{self.path}: states {stated[0]} connections and {stated[1]} chunks and holds "
                f"{len(self._channels)} and {len(self._found)}: damaged"
            )

    def _body(self, stream: BinaryIO, index: int, topic: str | None) -> Messages:
        """Chunks with an index behind each, then connections and what each chunk holds."""
        place = 0
        listed: dict[int, Counter[int]] = {}
        told: dict[int, Counter[int]] = {}
        while stream.tell() < self._size:
            at = stream.tell()
            kind, head, data = self._record(stream)
            if (kind in (_CHUNK, _INDEX)) != (at < index):
                raise MapError(f"{head.where}: stands on the wrong side of the index: damaged")
            if kind == _CHUNK:
                place = at
                self._found[at], listed[at] = Counter(), Counter()
                yield from self._chunk(head, data, self._found[at], topic)
            elif kind == _INDEX and place:
                listed[place][head.number("conn")] += head.number("count")
            elif kind == _CONNECTION:
                self._connection(head, data)
            elif kind == _INFO and len(data) % 8 == 0:
                pairs = dict(struct.iter_unpack("<II", data))
                told[head.number("chunk_pos", "<Q")] = Counter(pairs)
            else:
                raise MapError(f"{head.where}: is none that belongs there: damaged")
        for number, (at, counts) in enumerate(self._found.items(), 1):
            if not counts == listed[at] == told.get(at):
                raise MapError(
                    f"{self.path}: chunk {number} (at byte {at}): holds other messages than the "
                    "index states: damaged"
                )

    def _record(self, stream: BinaryIO) -> tuple[int, "_Head", bytes]:
        """The next record of the file."""
        where = f"{self.path}: record at byte {stream.tell()}"
        head = _Head(self._part(stream, where), where)
        kind = head.number("op", "<B")
        if kind == _CHUNK:
            head.where = f"{self.path}: chunk {len(self._found) + 1} (at byte {where.split()[-1]})"
        return kind, head, self._part(stream, where)

    def _part(self, stream: BinaryIO, where: str) -> bytes:
        size = stream.read(_U32.size)
        left = self._size - stream.tell()
        if len(size) < _U32.size or _U32.unpack(size)[0] > left:
            raise MapError(f"{where}: is longer than the file: cut, or damaged")
        return stream.read(_U32.unpack(size)[0])

    def _chunk(
        self, head: "_Head", data: bytes, counts: Counter[int], topic: str | None
    ) -> Messages:
        where = head.where
        kind = decoded(head.field("compression"), where)
        data = self._unpacker.unpack(data, kind, head.number("size"), where)
        cursor = Cursor(data, where)
        while cursor.left:
            inner = _Head(cursor.take(cursor.number("<I")), where)
            content = cursor.take(cursor.number("<I"))
            kind_of = inner.number("op", "<B")
            if kind_of == _CONNECTION:
                self._connection(inner, content)
                continue
            number = inner.number("conn")
            channel = self._channels.get(number)
            if kind_of != _DATA or channel is None:
                raise MapError(f"{where}: holds a record that is no message: damaged")
            counts[number] += 1
            if channel.topic == topic:
                seconds, part = struct.unpack("<II", inner.field("time", 8))
                yield channel, seconds * 10**9 + part, content

    def _connection(self, head: "_Head", data: bytes) -> None:
        """A topic with the kind of its messages; it stands in a chunk and again in the index."""
        told = _Head(data, head.where)
        topic, kind, text, digest = (
            decoded(part, head.where)
            for part in (
                head.field("topic"), told.field("type"), told.field("message_definition"),
                told.field("md5sum"),
            )
        )  # fmt: skip
        kind = kind.replace("/", "/msg/") if kind.count("/") == 1 else kind
        digest = "" if digest == "*" else digest
        channel = Channel(_SLASHES.sub("/", topic), kind, "ros1", text, "msg", digest)
        if self._channels.setdefault(head.number("conn"), channel) != channel:
            raise MapError(f"{head.where}: a connection is defined twice: damaged")


class _Head:
    """Fields of a record's header.

    Args:
        data: of the header.
        where: file and record, for messages.
    """

    def __init__(self, data: bytes, where: str) -> None:
        self.where = where
        self._fields: dict[bytes, bytes] = {}
        cursor = Cursor(data, where)
        while cursor.left:
            name, equals, value = cursor.take(cursor.number("<I")).partition(b"=")
            if not equals:
                raise MapError(f"{where}: a field of its header has no name: damaged")
            self._fields[name] = value

    def field(self, name: str, size: int | None = None) -> bytes:
        """The bytes of a field, of a size."""
        value = self._fields.get(name.encode())
        if value is None or size not in (None, len(value)):
            raise MapError(f"{self.where}: its header has no field {name!r}: damaged")
        return value

    def number(self, name: str, layout: str = "<I") -> int:
        """A whole number in a layout of `struct`."""
        return int(struct.unpack(layout, self.field(name, struct.calcsize(layout)))[0])
