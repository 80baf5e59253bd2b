"""An MCAP file, read in order and checked against its own checksums and counts.

Format: https://mcap.dev/spec. Checked are the lengths of all records, the checksums (CRC-32) of
each chunk, of the data section and of the summary, and that summary and data tell of the same
chunks and messages, so that no part can be missing. A writer may leave checksums out (0).
"""

import struct
from collections import Counter
from pathlib import Path
from typing import BinaryIO
from zlib import crc32

from wrenchbed.data.log_records import LATEST, Channel, Cursor, Messages, decoded
from wrenchbed.data.unpacking import Unpacker
from wrenchbed.errors import MapError

MAGIC = b"\x89MCAP0\r\n"
_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = range(1, 7)
_CHUNK_INDEX, _ATTACHMENT, _STATISTICS, _DATA_END = 0x08, 0x09, 0x0B, 0x0F
_LAST_KNOWN, _FIRST_PRIVATE = 0x0F, 0x80
"""Kinds of records of the format, and of the first that anybody may add."""
_HEAD = struct.Struct("<BQ")
_OF_MESSAGE = struct.Struct("<HIQQ")
_LANGUAGES = {"ros2idl": "idl", "omgidl": "idl", "": ""}
_BLOCK = 2**20


class McapFile:
    """See `log_records.Log`.

    Args:
        path: of the file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._begin()

    def _begin(self) -> None:
        self._schemas: dict[int, tuple[str, str, bytes]] = {}
        self._channels: dict[int, Channel] = {}
        self._counts: Counter[int] = Counter()
        self._chunks: dict[int, int] = {}  # place → length
        self._crc = 0

    @property
    def topics(self) -> dict[str, str]:
        """Topics and their kinds."""
        return {c.topic: c.kind or "no schema" for c in self._channels.values()}

    @property
    def counts(self) -> Counter[str]:
        """Messages of each topic."""
        found = Counter[str]()
        for number, count in self._counts.items():
            found[self._channels[number].topic] += count
        return found

    def messages(self, topic: str | None) -> Messages:
        """Messages of one topic; None reads and checks all and yields none.

        Raises:
            MapError: see `log_records.Log`.
        """
        self._begin()
        self._unpacker = Unpacker(self.path)
        with self.path.open("rb") as stream:
            self._size = self.path.stat().st_size
            if stream.read(len(MAGIC)) != MAGIC:
                raise MapError(f"{self.path}: not an MCAP file that can be read: it begins as none")
            self._crc = crc32(MAGIC)
            yield from self._data(stream, topic)
            self._summary(stream)

    def _data(self, stream: BinaryIO, topic: str | None) -> Messages:
        """All up to the record DataEnd."""
        while True:
            before = self._crc
            kind, content = self._record(stream)
            if kind == _DATA_END:
                self._compare("data section", content.number("<I"), before)
                self._crc = 0
                return
            if kind == _CHUNK:
                yield from self._chunk(content, topic)
            elif kind == _MESSAGE:
                yield from self._message(content.data, content.where, topic)
            elif kind in (_SCHEMA, _CHANNEL):
                self._announced(kind, content)
            elif kind in (_FOOTER, _CHUNK_INDEX, _STATISTICS):
                raise MapError(f"{content.where}: stands before the end of the data: damaged")

    def _record(self, stream: BinaryIO) -> tuple[int, Cursor]:
        """The next record of the file; its content is left out where nothing in it is used."""
        place = stream.tell()
        head = stream.read(_HEAD.size)
        if len(head) < _HEAD.size:
            raise self._cut(place)
        kind, length = _HEAD.unpack(head)
        where = f"{self.path}: record at byte {place} (kind {kind})"
        if not (1 <= kind <= _LAST_KNOWN or kind >= _FIRST_PRIVATE):
            raise MapError(f"{where}: there is no such kind: damaged")
        if length > self._size - stream.tell():
            raise self._cut(place)
        self._crc = crc32(head, self._crc)
        content = b""
        if kind == _ATTACHMENT or kind >= _FIRST_PRIVATE:
            for begin in range(0, length, _BLOCK):
                self._crc = crc32(stream.read(min(_BLOCK, length - begin)), self._crc)
        else:
            self._footer_crc = self._crc
            content = stream.read(length)
            self._crc = crc32(content, self._crc)
        if kind == _CHUNK:
            self._chunks[place] = _HEAD.size + length
            where = f"{self.path}: chunk {len(self._chunks)} (at byte {place})"
        return kind, Cursor(content, where)

    def _cut(self, place: int) -> MapError:
        return MapError(
            f"{self.path}: ends early: the record at byte {place} is longer than the file; "
            "mend it with `mcap recover`"
        )

    def _announced(self, kind: int, content: Cursor) -> None:
        """A schema or a channel."""
        number = content.number("<H")
        if kind == _SCHEMA:
            name, language = content.text(), content.text()
            schema = name, language, content.take(content.number("<I"))
            if self._schemas.setdefault(number, schema) != schema:
                raise MapError(f"{content.where}: schema {number} is defined twice: damaged")
            return
        of = content.number("<H")
        topic, encoding = content.text(), content.text()
        if of and of not in self._schemas:
            raise MapError(f"{content.where}: channel {number} has no schema: damaged")
        name, language, text = self._schemas.get(of, ("", "", b""))
        if encoding in ("cdr", "ros1") and name.count("/") == 1:
            name = name.replace("/", "/msg/")
        definition = decoded(text, content.where) if encoding in ("cdr", "ros1") else ""
        channel = Channel(topic, name, encoding, definition, _LANGUAGES.get(language, "msg"))
        if self._channels.setdefault(number, channel) != channel:
            raise MapError(f"{content.where}: channel {number} is defined twice: damaged")

    def _chunk(self, content: Cursor, topic: str | None) -> Messages:
        where = content.where
        _, _, size, crc = content.numbers("<QQQI")
        compression = content.text()
        if content.number("<Q") != content.left:
            raise MapError(f"{where}: its length is not that of its content: damaged")
        data = memoryview(
            self._unpacker.unpack(content.take(content.left), compression, size, where)
        )
        if crc and crc32(data) != crc:
            raise MapError(
                f"{where}: its checksum is {crc:08x} and its data give {crc32(data):08x}: damaged"
            )
        at = 0
        while at < size:
            if at + _HEAD.size > size:
                raise MapError(f"{where}: ends within a record: damaged")
            kind, length = _HEAD.unpack_from(data, at)
            at += _HEAD.size + length
            if at > size:
                raise MapError(f"{where}: ends within a record: damaged")
            if kind == _MESSAGE:
                yield from self._message(data[at - length : at], where, topic)
            elif kind in (_SCHEMA, _CHANNEL):
                self._announced(kind, Cursor(data[at - length : at], where))
            elif kind < _FIRST_PRIVATE:
                raise MapError(f"{where}: holds a record of kind {kind}: damaged")

    def _message(self, data: memoryview, where: str, topic: str | None) -> Messages:
        if len(data) < _OF_MESSAGE.size:
            raise MapError(f"{where}: holds a message of {len(data)} bytes: damaged")
        number, _, logged, _ = _OF_MESSAGE.unpack_from(data)
        channel = self._channels.get(number)
        if channel is None:
            raise MapError(f"{where}: holds a message of channel {number}, which is none: damaged")
        self._counts[number] += 1
        if channel.topic == topic:
            if logged > LATEST:
                raise MapError(f"{where}: holds a message of the year {logged:.0e} ns: damaged")
            yield channel, logged, bytes(data[_OF_MESSAGE.size :])

    def _summary(self, stream: BinaryIO) -> None:
        """Everything behind the data: compared with what the data were."""
        begin, indexed = stream.tell(), dict[int, int]()
        while True:
            kind, content = self._record(stream)
            if kind == _FOOTER:
                break
            if kind == _CHUNK_INDEX:
                _, _, place, length = content.numbers("<4Q")
                indexed[place] = length
            elif kind == _STATISTICS:
                self._counted(content)
            elif kind in (_SCHEMA, _CHANNEL):
                self._announced(kind, content)
            elif kind in (_HEADER, _MESSAGE, _CHUNK, _DATA_END):
                raise MapError(f"{content.where}: stands behind the end of the data: damaged")
        if indexed and indexed != self._chunks:
            raise MapError(f"{self.path}: the index of chunks is not that of the chunks: damaged")
        crc = crc32(content.take(16), self._footer_crc)
        self._compare("summary", content.number("<I"), crc)
        start = Cursor(content.data, content.where).number("<Q")
        if start not in (0, begin):
            raise MapError(f"{content.where}: the summary is said to begin at {start}: damaged")
        if stream.read(len(MAGIC) + 1) != MAGIC:
            raise MapError(
                f"{self.path}: does not end as an MCAP file; mend it with `mcap recover`"
            )

    def _counted(self, content: Cursor) -> None:
        """Statistics: as many messages and chunks as were read?"""
        messages, _, _, _, _, chunks, _, _, size = content.numbers("<QHIIIIQQI")
        of_channels = dict(struct.iter_unpack("<HQ", content.take(size - size % 10)))
        wanted = {k: n for k, n in of_channels.items() if n}
        found = sum(self._counts.values()), len(self._chunks)
        if (messages, chunks) != found or (wanted and wanted != self._counts):
            raise MapError(
                f"{self.path}: states {messages:,} messages in {chunks:,} chunks and holds "
                f"{found[0]:,} in {found[1]:,}: damaged, or cut and joined"
            )

    def _compare(self, what: str, stated: int, found: int) -> None:
        if stated and stated != found:
            raise MapError(
                f"{self.path}: {what}: its checksum is {stated:08x} and its data give "
                f"{found:08x}: damaged"
            )
