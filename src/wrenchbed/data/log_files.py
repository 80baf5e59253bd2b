"""MCAP files and rosbags, read message by message by their libraries and checked while read.

MCAP is read by `mcap`, rosbags 1 and 2 by `rosbags`. Those trust sizes and counts that a file
states; here compressed parts are unpacked within limits, and a part that is missing is noticed:

- MCAP (https://mcap.dev/spec): CRC-32 of each chunk, of the data and of the summary, and the
  chunks and messages that the summary states. A writer may leave checksums out (0).
- rosbag 1 (http://wiki.ros.org/Bags/Format/2.0): messages of each chunk that the index states. The
  records are read in order: an index of all messages in memory would be as large as the log.
- rosbag 2: the database's structure, and the messages of each topic that ``metadata.yaml`` states.
"""

import re
import sqlite3
import struct
from collections import Counter
from collections.abc import Generator, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any
from urllib.parse import quote
from zlib import crc32

from wrenchbed import registry
from wrenchbed.data.unpacking import LARGEST, Unpacker
from wrenchbed.errors import MapError, WrenchbedError, raise_shortage

METADATA = "metadata.yaml"
"""Name of the file that marks a folder as a ROS 2 bag."""
_LONGEST_METADATA = 2**20
"""Longest metadata.yaml that is parsed [bytes]: ROS writes about 1 kB a topic, and a parser of
YAML needs some 100 bytes of memory for each byte."""
_FOOTER, _MAGIC = 29, 8
"""Length of the last record of an MCAP file and of the magic behind it [bytes]."""
_LANGUAGES = {"ros2idl": "idl", "omgidl": "idl"}
"""Encoding of an MCAP schema that is not ``msg`` → language of the definition."""


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
"""Channel, time of writing [ns] and content of messages."""


def is_log(path: Path) -> bool:
    """Whether a path is a bag (``.bag``, a folder with ``metadata.yaml``) or an MCAP file."""
    return path.suffix in (".bag", ".mcap", ".db3") or (path / METADATA).is_file()


def messages(path: Path, topic: str | None, topics: dict[str, str]) -> Messages:
    """Messages of one topic of a log, in the order of the file.

    Args:
        path: of the log.
        topic: whose messages are yielded; None reads and checks all and yields none.
        topics: receives all topics and the kinds of their messages.

    Raises:
        MapError: the log is cut or damaged; names the file and the part.
        MissingExtraError: rosbags or mcap is not installed.
    """
    for channel, logged, data in _reader(path):
        topics[channel.topic] = channel.kind or "no schema"
        if data is not None and channel.topic == topic:
            yield channel, logged, data


_Read = Iterator[tuple[Channel, int, bytes | None]]
"""As `Messages`; a channel that may have no message comes once with None as its content."""


def _reader(path: Path) -> _Read:
    if path.suffix == ".mcap":
        return _mcap(path)
    if path.suffix == ".bag":
        return _bag1(path)
    if path.suffix == ".db3" and not (path.parent / METADATA).is_file():
        return _database(path)
    return _bag2(path.parent if path.suffix == ".db3" else path)


@contextmanager
def _naming(path: Path, where: str = "", remedy: str = "") -> Iterator[None]:
    """Errors of the libraries, which have no common base, become a MapError of one line."""
    try:
        yield
    except WrenchbedError:
        raise
    except Exception as error:
        raise_shortage(error, path)
        part = f": {where}" if where else ""
        if type(error).__name__ == "CRCValidationError":
            crc: Any = error
            raise _checksum(path, where or "data section", crc.expected, crc.actual) from error
        raise MapError(
            f"{path}{part}: not a log that can be read: {line(error)}{remedy}"
        ) from error


def line(error: Exception) -> str:
    """Text of an error in one line."""
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    if isinstance(error, RecursionError):
        return "nested too deeply"
    return (str(error) or type(error).__name__).splitlines()[0]


def _checksum(path: Path, part: str, stated: int, given: int) -> MapError:
    return MapError(
        f"{path}: {part}: its checksum is {stated:08x} and its data give {given:08x}: damaged"
    )


# MCAP


def _mcap(path: Path) -> _Read:
    """Messages of an MCAP file."""
    streams = registry.require("mcap.stream_reader", "logs")
    records = registry.require("mcap.records", "logs")
    unpacker, contents = Unpacker(path), _McapContents(path)
    last: list[Any] = []
    chunks: dict[int, int] = {}
    index: dict[int, int] = {}
    with path.open("rb") as stream:
        reader = streams.StreamReader(
            stream, emit_chunks=True, validate_crcs=True, record_size_limit=LARGEST
        ).records
        data_end = 0
        while True:
            with _naming(path, remedy="; if it ends early, mend it with `mcap recover`"):
                record = next(reader, None)
            if record is None:
                break
            if isinstance(record, records.Chunk):
                length = 49 + len(record.compression) + len(record.data)
                place = stream.tell() - length
                chunks[place] = length
                where = f"chunk {len(chunks)} (at byte {place})"
                record.data = unpacker.unpack(
                    record.data, record.compression, record.uncompressed_size, f"{path}: {where}"
                )
                record.compression = ""
                with _naming(path, where):
                    inner = streams.breakup_chunk(record, validate_crc=True)
                for part in inner:
                    yield from contents.add(part, where)
            elif isinstance(record, records.ChunkIndex):
                index[record.chunk_start_offset] = record.chunk_length
            elif isinstance(record, records.DataEnd):
                data_end = stream.tell()
            elif isinstance(record, records.Statistics | records.Footer):
                last.append(record)
            else:
                yield from contents.add(record, "data")
        if index and index != chunks:
            raise MapError(f"{path}: the index of chunks is not that of the chunks: damaged")
        for record in last:
            if isinstance(record, records.Footer):
                _check_summary(path, stream, record, data_end)
            else:
                contents.check(record, len(chunks))


def _check_summary(path: Path, stream: Any, footer: Any, data_end: int) -> None:
    """Checksum of all behind the data, and where that begins."""
    if footer.summary_start not in (0, data_end):
        raise MapError(f"{path}: the summary is said to begin at {footer.summary_start}: damaged")
    end = path.stat().st_size - _MAGIC
    stream.seek(footer.summary_start or end - _FOOTER)
    given = crc32(stream.read(end - 4 - stream.tell()))
    if footer.summary_crc not in (0, given):
        raise _checksum(path, "summary", footer.summary_crc, given)


class _McapContents:
    """Schemas and channels of an MCAP file, and its messages counted.

    Args:
        path: of the file, for messages.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._announced: dict[tuple[str, int], Any] = {}
        self._channels: dict[int, Channel] = {}
        self._counts: Counter[int] = Counter()

    def add(self, record: Any, where: str) -> _Read:
        """A record of the data, or of a chunk named ``where``; yields its message or channel."""
        kind = type(record).__name__
        if kind == "Message":
            channel = self._channels.get(record.channel_id)
            if channel is None:
                raise MapError(
                    f"{self._path}: {where}: holds a message of channel {record.channel_id}, "
                    "which is none: damaged"
                )
            self._counts[record.channel_id] += 1
            yield channel, record.log_time, record.data
        elif kind in ("Schema", "Channel"):
            if self._announced.setdefault((kind, record.id), record) != record:
                raise MapError(f"{self._path}: {kind} {record.id} is defined twice: damaged")
            if kind == "Channel":
                self._channels[record.id] = self._channel(record)
                yield self._channels[record.id], 0, None

    def _channel(self, record: Any) -> Channel:
        schema = self._announced.get(("Schema", record.schema_id))
        if schema is None:
            if record.schema_id:
                raise MapError(f"{self._path}: channel {record.id} has no schema: damaged")
            return Channel(record.topic, "", record.message_encoding)
        kind, definition = schema.name, ""
        if record.message_encoding in ("cdr", "ros1"):
            kind = kind.replace("/", "/msg/") if kind.count("/") == 1 else kind
            with _naming(self._path, f"schema {kind}"):
                definition = schema.data.decode()
        language = _LANGUAGES.get(schema.encoding, "msg")
        return Channel(record.topic, kind, record.message_encoding, definition, language)

    def check(self, statistics: Any, chunks: int) -> None:
        """Refuse other numbers of messages and chunks than the summary states."""
        of_channels = {k: n for k, n in statistics.channel_message_counts.items() if n}
        stated = statistics.message_count, statistics.chunk_count
        held = self._counts.total(), chunks
        if stated != held or (of_channels and of_channels != self._counts):
            raise MapError(
                f"{self._path}: states {stated[0]:,} messages in {stated[1]:,} chunks and holds "
                f"{held[0]:,} in {held[1]:,}: damaged, or cut and joined"
            )


# rosbag 1


def _bag1(path: Path) -> _Read:
    """Messages of a bag of ROS 1."""
    library = registry.require("rosbags.rosbag1.reader", "logs")
    kinds, unpacker = library.RecordType, Unpacker(path)
    connections: dict[int, Channel] = {}
    held: dict[int, Counter[int]] = {}
    stated: dict[int, Counter[int]] = {}
    counts = (0, 0)
    for place, head, data in _records1(path, library):
        where = f"record at byte {place}"
        with _naming(path, where):
            kind = head.get_uint8("op")
            if kind == kinds.BAGHEADER:
                counts = head.get_uint32("conn_count"), head.get_uint32("chunk_count")
                if not head.get_uint64("index_pos"):
                    raise MapError(f"{path}: was not closed; mend it with `rosbag reindex`")
            elif kind == kinds.CONNECTION:
                _connect(path, library, head, data, connections)
            elif kind == kinds.CHUNK_INFO:
                pairs = dict(struct.iter_unpack("<II", data))
                if len(pairs) != head.get_uint32("count"):
                    raise MapError(f"{path}: {where}: its counts are damaged")
                stated[head.get_uint64("chunk_pos")] = Counter(pairs)
            elif kind not in (kinds.CHUNK, kinds.IDXDATA):
                raise MapError(f"{path}: {where}: is of no kind: damaged")
        if kind == kinds.CHUNK:
            held[place] = Counter()
            where = f"chunk {len(held)} (at byte {place})"
            chunk = _unpacked1(path, where, head, data, unpacker)
            for number, logged, content in _chunk1(path, where, library, chunk, connections):
                held[place][number] += 1
                yield connections[number], logged, content
    yield from ((channel, 0, None) for channel in connections.values())
    if counts != (len(connections), len(held)) or held != stated:
        raise MapError(
            f"{path}: its index states other connections, chunks or messages than it holds: damaged"
        )


def _records1(path: Path, library: Any) -> Iterator[tuple[int, Any, bytes]]:
    """Place, header and data of the records of a bag of ROS 1."""
    size = path.stat().st_size
    remedy = "; if it ends early, mend it with `rosbag reindex`"
    with path.open("rb") as stream:
        if stream.readline() != b"#ROSBAG V2.0\n":
            raise MapError(f"{path}: not a bag that can be read: it begins as none")
        while (place := stream.tell()) < size:
            with _naming(path, f"record at byte {place}", remedy):
                head = library.Header.read(stream)
                data = library.read_bytes(stream, library.read_uint32(stream))
            yield place, head, data


def _unpacked1(path: Path, where: str, head: Any, data: bytes, unpacker: Unpacker) -> bytes:
    """The content of a chunk of a bag of ROS 1."""
    with _naming(path, where):
        compression, size = head.get_string("compression"), head.get_uint32("size")
    return unpacker.unpack(data, compression, size, f"{path}: {where}")


def _chunk1(
    path: Path, where: str, library: Any, data: bytes, connections: dict[int, Channel]
) -> Iterator[tuple[int, int, bytes]]:
    """Connection, time [ns] and content of the messages of a chunk of a bag of ROS 1."""
    stream, kinds = BytesIO(data), library.RecordType
    while stream.tell() < len(data):
        with _naming(path, where):
            head = library.Header.read(stream)
            content = library.read_bytes(stream, library.read_uint32(stream))
            kind, number = head.get_uint8("op"), head.get_uint32("conn")
            if kind == kinds.CONNECTION:
                _connect(path, library, head, content, connections)
                continue
            if kind != kinds.MSGDATA or number not in connections:
                raise MapError(f"{path}: {where}: holds a record that is no message: damaged")
            logged = head.get_time("time")
        yield number, logged, content


def _connect(
    path: Path, library: Any, head: Any, data: bytes, connections: dict[int, Channel]
) -> None:
    """Add the channel of a connection, which stands in a chunk and again in the index."""
    about = library.Header.read(BytesIO(struct.pack("<I", len(data)) + data))
    digest = about.get_string("md5sum")
    channel = Channel(
        re.sub("/+", "/", head.get_string("topic")),
        library.normalize_msgtype(about.get_string("type")),
        "ros1",
        about.get_string("message_definition"),
        digest="" if digest == "*" else digest,
    )
    if connections.setdefault(head.get_uint32("conn"), channel) != channel:
        raise MapError(f"{path}: a connection is defined twice: damaged")


# rosbag 2


def _database(path: Path) -> _Read:
    """Messages of an SQLite file of a bag of ROS 2."""
    library = registry.require("rosbags.rosbag2.storage_sqlite3", "logs")
    address = quote(str(path.absolute()))
    with _naming(path):
        base = sqlite3.connect(f"file:{address}?mode=ro&immutable=1", uri=True)
        with closing(base):
            (state,) = base.execute("PRAGMA quick_check(1)").fetchone()
        if state != "ok":
            raise MapError(f"{path}: the database is damaged: {state.splitlines()[-1]}")
        reader = library.Sqlite3Reader(Path(address))
        reader.open()
    with closing(reader):
        if reader.metadata.message_count != sum(c.msgcount for c in reader.connections):
            raise MapError(f"{path}: holds messages of no topic: damaged")
        for connection in reader.connections:
            definition = connection.msgdef
            channel = Channel(
                connection.topic,
                connection.msgtype,
                connection.ext.serialization_format,
                definition.data,
                definition.format.name.lower(),
                connection.digest,
            )
            yield channel, 0, None
            with _naming(path, repr(connection.topic)):
                for _, logged, data in reader.messages([connection]):
                    yield channel, logged, data


def _bag2(path: Path) -> _Read:
    """Messages of a bag of ROS 2: a folder with ``metadata.yaml`` and SQLite or MCAP files."""
    library = registry.require("rosbags.rosbag2.reader", "logs")
    about = path / METADATA
    with _naming(about):
        if (length := about.stat().st_size) > _LONGEST_METADATA:
            raise MapError(f"{about}: has {length:,} bytes, more than {_LONGEST_METADATA:,}")
        for file in path.glob("*.zstd"):
            Unpacker(file).check_file("zstd")  # the library unpacks it whatever its size
        bag = library.DirectoryReader(path)
        bag.open()
    with closing(bag):
        stated = Counter({c.topic: c.msgcount for c in bag.connections})
        held: Counter[str] = Counter()
        for storage in bag.storages:
            unpacker = Unpacker(storage.path)
            for channel, logged, data in _storage(path, storage.path):
                content = data
                if data is not None:
                    held[channel.topic] += 1
                    if bag.metadata.compression_mode == "message":
                        where = f"{path}: {channel.topic!r}: a message"
                        content = unpacker.unpack(data, "zstd", None, where)
                yield channel, logged, content
        yield from ((Channel(c.topic, c.msgtype, "cdr"), 0, None) for c in bag.connections)
    different = sorted(name for name in stated | held if stated[name] != held[name])
    if different:
        name = different[0]
        raise MapError(
            f"{about}: states {stated[name]:,} messages of {name!r}, the files hold "
            f"{held[name]:,}: damaged, or a file was exchanged"
        )


def _storage(folder: Path, path: Path) -> _Read:
    """Messages of one file of a bag of ROS 2; one that was unpacked lies in another folder."""
    try:
        yield from _mcap(path) if path.suffix == ".mcap" else _database(path)
    except MapError as error:
        raise MapError(str(error).replace(str(path.parent), str(folder), 1)) from error
