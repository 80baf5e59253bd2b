"""One topic of a log as a table, fields by their path, times in whole ns; a recording as a log.

Rosbags 1 and 2 are read by `rosbags`, MCAP files by `mcap`, which checks the CRC-32 of chunks and
data. What these libraries do not check is checked here: the number of messages that a log states,
the sizes to which chunks, messages and files unpack, and the checksum of a message's definition. An
archive bomb is a few kilobytes that unpack to gigabytes, whatever size they state.
"""

import json
import sys
import warnings
from array import array
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyarrow as pa

from wrenchbed import registry
from wrenchbed.data.recording import Recording
from wrenchbed.errors import MapError, WrenchbedError, WrenchbedWarning, raise_shortage
from wrenchbed.files import atomic_write

STAMP, LOGGED = "stamp", "logged"
"""Names of two columns with times of messages [ns]: of the header, and of writing the message."""
TRANSFORMS = "transforms"
"""Name of the field of a TFMessage."""
METADATA = "metadata.yaml"
"""Name of the file that marks a folder as a ROS 2 bag."""
KEY = "wrenchbed"
"""Name of the MCAP metadata record that holds the recording's own metadata as JSON."""
_SUFFIXES = (".bag", ".mcap", ".db3")
_LONGEST_DEFINITION = 2**18
"""Longest definition of a kind of messages that is parsed [characters]: 20 times the longest of
ROS's own; the parser takes seconds for a longer one."""
LARGEST = 2**28
"""Largest record, and largest unpacked chunk or message [bytes], which is held in memory: 64 times
mcap's default chunk (4 MiB)."""
RATIO = 200
"""Largest unpacked over packed size of a whole file on the disk, if that is more than `LARGEST`:
ten times that of a log whose readings hardly change."""
_STEP = 2**18
"""Bytes that are unpacked at once where only the size is asked for."""
_ZSTD = "compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd"
_LIBRARIES = {"bz2": "bz2", "lz4": "lz4.frame", "zstd": _ZSTD}
"""Compression → module that opens it as a stream, which ends where its checksum is wrong."""
_REMEDY = (
    "; a log that ends early is mended by `mcap recover`, `rosbag reindex` or `ros2 bag reindex`"
)


@dataclass(frozen=True)
class Channel:
    """One topic of a log with messages of one type.

    Attributes:
        topic: name of the topic.
        kind: type of the messages, for instance ``geometry_msgs/msg/WrenchStamped``.
        encoding: ``cdr``, ``ros1`` or ``json``.
        definition: text that defines the type; empty where the log holds none.
        language: language of the definition; ``msg`` can be read.
        digest: checksum of the definition as the log states it; empty without one.
    """

    topic: str
    kind: str
    encoding: str
    definition: str = ""
    language: str = "msg"
    digest: str = ""


Messages = Iterator[tuple[Channel, int, bytes]]
"""Triples of a message: its channel, time of writing [ns], and encoded content."""


def is_log(path: Path) -> bool:
    """Whether a path is a ROS bag (``.bag``, folder with ``metadata.yaml``) or an MCAP file."""
    return path.suffix in _SUFFIXES or (path / METADATA).is_file()


class MessageRows:
    """Collects some fields of one topic's messages as rows of a table.

    Args:
        wanted: names of columns: `STAMP`, `LOGGED`, a path such as ``wrench.force.x``, or, of
            messages with names (JointState), ``position.<joint>``; of transforms (TFMessage),
            ``transforms.<child frame>.transform.rotation.w``. Messages that lack that frame, or all
            of the joints, are another publisher's and left out.
    """

    def __init__(self, wanted: Sequence[str]) -> None:
        self.wanted = tuple(dict.fromkeys(wanted))
        self.missing: set[str] = set()
        self.seen = self.skipped = 0
        self._columns: dict[str, array[Any]] = {
            n: array("q" if n in (STAMP, LOGGED) else "d") for n in self.wanted
        }
        self._paths = {n: n.split(".") for n in self.wanted if n not in (STAMP, LOGGED)}
        frames = [path[1] for path in self._paths.values() if path[0] == TRANSFORMS and path[1:]]
        self._frame = next((frame for frame in frames if not frame.isdecimal()), None)

    def add(self, message: Any, logged: int) -> bool:
        """Add a message that was logged at a time [ns]; return False if it was left out."""
        self.seen += 1
        headed = message
        if self._frame is not None:
            headed = _transform(message, self._frame)
            message = {TRANSFORMS: {self._frame: headed}}
        names = [str(name) for name in _get(message, "name") or ()]
        others = names and not any(".".join(path[1:]) in names for path in self._paths.values())
        values = {column: _at(message, path, names) for column, path in self._paths.items()}
        if headed is None or (others and set(values.values()) == {None}):
            self.skipped += 1
            return False
        stamp = _get(_get(headed, "header"), "stamp")
        for column, times in ((LOGGED, logged), (STAMP, _nanoseconds(stamp))):
            if column in self._columns:
                self._columns[column].append(times)
        for column, value in values.items():
            number = isinstance(value, bool | int | float) or hasattr(value, "__float__")
            if not number:
                self.missing.add(column)
            self._columns[column].append(float(value) if number else float("nan"))
        return True

    def table(self) -> pa.Table:
        """Table with a row for each message; fields that some message lacked are NaN."""
        kinds = {"q": pa.int64(), "d": pa.float64()}
        columns = self._columns.items()
        return pa.table({n: pa.array(memoryview(c), kinds[c.typecode]) for n, c in columns})


def _at(message: Any, path: Sequence[str], names: Sequence[str]) -> Any:
    """Value at a path of fields in a message, or None; in a list, of ``names``, a joint's name."""
    value = message
    for depth, part in enumerate(path):
        inner = _get(value, part)
        joint = ".".join(path[depth:])  # a joint's name may hold dots
        if inner is None and joint in names and _is_list(value):
            return value[names.index(joint)] if names.index(joint) < len(value) else None
        if inner is None:
            return None
        value = inner
    return value


def _get(thing: Any, name: str) -> Any:
    """Field of a message by name, or element of a list by its number; None if there is none."""
    if isinstance(thing, Mapping):
        return thing.get(name)
    if _is_list(thing):
        return thing[int(name)] if name.isdecimal() and int(name) < len(thing) else None
    return getattr(thing, name, None)


def _is_list(thing: Any) -> bool:
    """Whether a value is a list or an array of numbers."""
    sized = hasattr(thing, "__len__") and hasattr(thing, "__getitem__")
    return sized and not isinstance(thing, str | Mapping)


def _transform(message: Any, frame: str) -> Any:
    """Transform to the child frame in a TFMessage (leading slashes ignored); None if missing."""
    named = {str(_get(t, "child_frame_id")).lstrip("/"): t for t in _get(message, TRANSFORMS) or ()}
    return named.get(frame.lstrip("/"))


def _nanoseconds(stamp: Any) -> int:
    """Convert a time stamp of ROS 1, ROS 2 or JSON to whole nanoseconds; −1 without one."""
    second, part = _get(stamp, "sec"), _get(stamp, "nanosec")
    if part is None:
        part = _get(stamp, "nsec")
    return -1 if second is None or part is None else int(second) * 1_000_000_000 + int(part)


def table(path: Path, topic: str | None, wanted: Sequence[str]) -> pa.Table:
    """Read some columns of one topic of a log, rows in the order in which messages were written.

    The topic may be left out where there is only one; for ``wanted`` see `MessageRows`.

    Raises:
        MapError: no such file, topic or field; a message without a stamp; a damaged log.
        MissingExtraError: rosbags or mcap is not installed.
    """
    if not path.exists():
        raise MapError(f"{path}: there is no such file")
    rows, logged = MessageRows(wanted), array("q")
    topics: dict[str, str] = {}
    decoders: dict[Channel, Callable[[bytes], Any]] = {}
    where = "not a log that can be read"
    messages = _of_mcap if path.suffix == ".mcap" else _of_bag
    try:
        if topic is None:
            deque(messages(path, None, topics), maxlen=0)
            topic = _chosen(path, topic, topics)
        for channel, now, data in messages(path, topic, topics):
            where = f"topic {topic!r} ({channel.kind}), message {rows.seen + 1}"
            if channel not in decoders:
                decoders[channel] = _decoder(channel)
            if rows.add(decoders[channel](data), now):
                logged.append(now)
            if rows.missing:
                raise MapError(f"{path}: {where}: has no {min(rows.missing)!r}")
            where = f"behind message {rows.seen} of {topic!r}: not a log that can be read"
    except WrenchbedError:
        raise
    except Exception as error:  # those of the libraries have no common base
        raise_shortage(error, path)
        raise MapError(f"{path}: {where}: {_line(error)}{_REMEDY}") from error
    topic = _chosen(path, topic, topics)
    columns = rows.table()
    if rows.seen and columns.num_rows == 0:
        raise MapError(f"{path}: no message of {topic!r} has any of {', '.join(wanted)}")
    if rows.skipped and not topic.endswith(("tf", "tf_static")):
        others = f"{rows.skipped:,} of {rows.seen:,} messages of {topic!r} have none of "
        others += f"{', '.join(wanted)}: another publisher's, left out"
        warnings.warn(f"{path}: {others}", WrenchbedWarning, stacklevel=2)
    times = np.asarray(logged, dtype=np.int64)
    if STAMP in columns.column_names and rows.seen and columns[STAMP].to_numpy().max() <= 0:
        columns = columns.set_column(columns.column_names.index(STAMP), STAMP, pa.array(times))
        text = f"{path}: messages of {topic!r} have no stamp: the times of their logging count"
        warnings.warn(text, WrenchbedWarning, stacklevel=2)
    in_order = (np.diff(times) >= 0).all()
    return columns if in_order else columns.take(np.argsort(times, kind="stable"))


def _chosen(path: Path, topic: str | None, topics: Mapping[str, str]) -> str:
    """Name of the topic to read: the stated one, or the only one; else an error lists all."""
    if topic is not None and topic in topics:
        return topic
    if topic is None and len(topics) == 1:
        return next(iter(topics))
    known = ", ".join(f"{n} ({kind})" for n, kind in sorted(topics.items())) or "none"
    what = "name one with topic =" if topic is None else f"there is no topic {topic!r}"
    raise MapError(f"{path}: {what}; it holds {known}")


def _line(error: Exception) -> str:
    """Text of an exception, joined to one line."""
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    if isinstance(error, RecursionError):
        return "nested too deeply"
    if type(error).__name__ == "CRCValidationError":  # of mcap, which need not be installed
        return "the checksum does not fit the data: damaged"
    return (str(error) or type(error).__name__).splitlines()[0]


def _of_mcap(path: Path, topic: str | None, topics: dict[str, str]) -> Messages:
    """Yield a topic's messages of an MCAP file in its order; fill ``topics``: topic → type."""
    library = registry.require("mcap.stream_reader", "logs")
    kinds = registry.require("mcap.records", "logs")
    schemas: dict[int, Any] = {}
    channels: dict[int, Channel] = {}
    counts: Counter[int] = Counter()
    with path.open("rb") as stream:
        for outer in library.StreamReader(
            stream, emit_chunks=True, validate_crcs=True, record_size_limit=LARGEST
        ).records:
            records = [outer]
            if isinstance(outer, kinds.Chunk):
                data = unpack(outer.data, outer.compression, outer.uncompressed_size)
                chunk = replace(outer, compression="", data=data)
                records = library.breakup_chunk(chunk, validate_crc=True)
            for record in records:
                if isinstance(record, kinds.Schema):
                    schemas[record.id] = record
                elif isinstance(record, kinds.Channel):
                    channel = _channel_of_mcap(record, schemas.get(record.schema_id))
                    channels[record.id] = channel
                    topics[channel.topic] = channel.kind or "no schema"
                elif isinstance(record, kinds.Message):
                    counts[record.channel_id] += 1
                    if channels[record.channel_id].topic == topic:
                        yield channels[record.channel_id], record.log_time, record.data
                elif isinstance(record, kinds.Statistics):
                    _check_count(path, record.message_count, counts.total())


def _channel_of_mcap(record: Any, schema: Any) -> Channel:
    if schema is None:
        return Channel(record.topic, "", record.message_encoding)
    kind, definition = schema.name, ""
    if record.message_encoding in ("cdr", "ros1"):
        kind = kind.replace("/", "/msg/") if kind.count("/") == 1 else kind
        definition = schema.data.decode()
    language = schema.encoding.removeprefix("ros1").removeprefix("ros2")
    return Channel(record.topic, kind, record.message_encoding, definition, language)


def _of_bag(path: Path, topic: str | None, topics: dict[str, str]) -> Messages:
    """Yield a topic's messages of a ROS bag in its order; fill ``topics``: topic → type."""
    bag1 = path.suffix == ".bag"
    library = registry.require(f"rosbags.rosbag{1 if bag1 else 2}.reader", "logs")
    whole = path.parent if path.suffix == ".db3" and (path.parent / METADATA).is_file() else path
    bag = library.Reader(whole)
    if whole.is_dir():
        for file in filter(Path.is_file, whole.iterdir()):
            check_file(file)
        bag.storage.STORAGE_PLUGINS = {**bag.storage.STORAGE_PLUGINS, "mcap": _left_to_mcap}
    with bag:
        for position, chunk in bag.chunks.items() if bag1 else ():
            bag.bio.seek(position)
            header = library.Header.read(bag.bio)
            kind, size = header.get_string("compression"), header.get_uint32("size")
            limited = partial(unpack, compression=kind, stated=size)
            bag.chunks[position] = chunk._replace(decompressor=limited)
        packed = not bag1 and bag.compression_mode == "message"
        if packed:  # rosbags unpacks without a limit; now it hands out what is stored
            bag.storage.metadata = bag.storage.metadata._replace(compression_mode=None)
        topics |= {c.topic: c.msgtype for c in bag.connections}
        connections = [c for c in bag.connections if c.topic == topic]
        count = 0
        for channel, logged, data in _stored(bag, connections):
            count += 1
            yield channel, logged, unpack(data, "zstd") if packed else data
        _check_count(path, sum(c.msgcount for c in connections), count)


def unpack(data: bytes, compression: str, stated: int | None = None) -> bytes:
    """Decompress a chunk or message to the stated size, and never to more than `LARGEST` bytes.

    Args:
        data: the chunk or message as it is stored.
        compression: ``bz2``, ``lz4`` or ``zstd``; empty or ``none`` for what is not compressed.
        stated: size of the content as the file states it [bytes]; None where it does not.

    Raises:
        ValueError: another size, or an unknown compression.
        EOFError: data cut short.
    """
    content, limit = data, LARGEST if stated is None else stated
    if limit > LARGEST:
        raise ValueError(
            f"{len(data):,} bytes state {limit:,} bytes unpacked, more than {LARGEST:,}: "
            "damaged, or a bomb"
        )
    if compression not in ("", "none"):
        if compression not in _LIBRARIES:
            raise ValueError(f"compression {compression!r}; {', '.join(_LIBRARIES)} can be read")
        with registry.require(_LIBRARIES[compression], "logs").open(BytesIO(data)) as stream:
            content = stream.read(limit + 1)
    if len(content) > limit:
        raise _too_large(len(data), limit)
    if stated not in (None, len(content)):
        raise ValueError(f"{len(data):,} bytes unpack to {len(content):,}, not {stated:,}: damaged")
    return content


def check_file(file: Path) -> None:
    """Check the unpacked size of a rosbag 2 file compressed as a whole, which rosbags unpacks to
    disk: a `ValueError` beyond `LARGEST` and `RATIO` times its size."""
    zstd, packed, size = registry.require(_ZSTD, "logs"), file.stat().st_size, 0
    limit = max(LARGEST, RATIO * packed)
    with suppress(zstd.ZstdError, EOFError), zstd.open(file) as stream:  # others are read as is
        while size <= limit and (part := stream.read(_STEP)):
            size += len(part)
    if size > limit:
        raise _too_large(packed, limit, f"{file.name}: ")


def _too_large(packed: int, limit: int, where: str = "") -> ValueError:
    return ValueError(f"{where}{packed:,} bytes unpack to more than {limit:,}: damaged, or a bomb")


def _left_to_mcap(path: Path) -> SimpleNamespace:
    """Stand-in for rosbags' MCAP reader, which unpacks without a limit: it reads nothing."""
    return SimpleNamespace(path=path, connections=(), open=lambda: None, close=lambda: None)


def _stored(bag: Any, connections: Sequence[Any]) -> Messages:
    """Yield the stored messages of one topic of an open bag; those of ROS 2 may be compressed."""
    if not connections:
        return
    parts = getattr(getattr(bag, "storage", None), "storages", ())
    files = [part.path for part in parts if isinstance(part, SimpleNamespace)]
    digest = "" if connections[0].digest == "*" else connections[0].digest
    for file in files:
        for channel, logged, data in _of_mcap(file, connections[0].topic, {}):
            yield replace(channel, digest=digest), logged, data
    for connection, logged, data in () if files else bag.messages(connections):
        text, kind = connection.msgdef, connection.msgtype
        encoding = getattr(connection.ext, "serialization_format", "ros1")
        language = text.format.name.lower()
        yield Channel(connection.topic, kind, encoding, text.data, language, digest), logged, data


def _check_count(path: Path, stated: int, count: int) -> None:
    if stated != count:
        raise MapError(
            f"{path}: states {stated:,} messages and holds {count:,}: damaged, or cut and joined"
        )


def _decoder(channel: Channel) -> Callable[[bytes], Any]:
    """Return a function that decodes the bytes of a channel's messages into objects."""
    if channel.encoding == "json":
        return json.loads
    if channel.encoding not in ("cdr", "ros1"):
        raise ValueError(f"is in {channel.encoding!r}; cdr, ros1 and json can be read")
    if len(channel.definition) > _LONGEST_DEFINITION:
        raise ValueError(f"its definition has {len(channel.definition):,} characters")
    typesys = registry.require("rosbags.typesys", "logs")
    kind, ros1 = channel.kind, channel.encoding == "ros1"
    if channel.definition:
        if channel.language != "msg":
            raise ValueError(f"its definition is in {channel.language!r}; msg can be read")
        store = typesys.get_typestore(typesys.Stores.EMPTY)
        store.register(typesys.get_types_from_msg(channel.definition, kind))
        digest = store.generate_msgdef(kind)[1] if ros1 else store.hash_rihs01(kind)
        if channel.digest not in ("", digest):
            raise ValueError(f"the definition of {kind} does not fit its checksum: damaged")
    else:
        store = typesys.get_typestore(typesys.Stores.LATEST)
    read = store.deserialize_ros1 if ros1 else store.deserialize_cdr
    return lambda data: read(data, kind)


def write_mcap(recording: Recording, path: str | Path) -> None:
    """Write a recording's wrench, joints and temperature to an MCAP file, as ROS 2 messages in CDR;
    a `MissingExtraError` if mcap or rosbags is not installed. Topics are those that the ready maps
    read (`maps/ros-ur5.toml`): ``/wrench``, ``/joint_states``."""
    writer_of = registry.require("mcap.writer", "logs").Writer
    typesys = registry.require("rosbags.typesys", "logs")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    time = store.types["builtin_interfaces/msg/Time"]
    header = store.types["std_msgs/msg/Header"]
    at = np.round(1e9 * recording.t.astype(float)).astype(np.int64)
    with atomic_write(path) as stream:
        writer = writer_of(stream)
        writer.start(profile="ros2", library="wrenchbed")
        channels = []
        for topic, kind, message in _topics(recording, store.types):
            text, _ = store.generate_msgdef(kind, ros_version=2)
            schema = writer.register_schema(kind, "ros2msg", text.encode())
            channels.append((writer.register_channel(topic, "cdr", schema), kind, message))
        for row, now in enumerate(at.tolist()):
            stamp = time(sec=now // 10**9, nanosec=now % 10**9)
            head = header(stamp=stamp, frame_id="sensor")
            for channel, kind, message in channels:
                content = store.types[kind](header=head, **message(row))
                data = bytes(store.serialize_cdr(content, kind))
                writer.add_message(channel, now, data, now, row)
        metadata = json.dumps(recording.metadata.to_json(), ensure_ascii=False)
        writer.add_metadata(KEY, {"json": metadata})
        writer.finish()


def _topics(
    recording: Recording, known: Mapping[str, Any]
) -> Iterator[tuple[str, str, Callable[[int], dict[str, Any]]]]:
    """Yield topic, message type, and a message's fields by row; ``known``: classes by type."""
    vector, wrench = known["geometry_msgs/msg/Vector3"], known["geometry_msgs/msg/Wrench"]
    load = recording.wrench.astype(float)

    def of_load(row: int) -> dict[str, Any]:
        force, torque = (vector(*map(float, part)) for part in np.split(load[row], 2))
        return {"wrench": wrench(force=force, torque=torque)}

    yield "/wrench", "geometry_msgs/msg/WrenchStamped", of_load
    if recording.joints:
        robot, names = recording.metadata.robot, list(recording.joints)
        if registry.is_known("robots", robot):
            names = list(registry.load("robots", robot).joint_names)
        q, none = recording.q.astype(float), np.zeros(0)
        still: dict[str, Any] = {"name": names, "velocity": none, "effort": none}
        kind = "sensor_msgs/msg/JointState"
        yield "/joint_states", kind, lambda row: still | {"position": q[row]}
    if "temperature" in recording.columns:
        warm = recording.columns["temperature"].astype(float).tolist()
        kind = "sensor_msgs/msg/Temperature"
        yield "/temperature", kind, lambda row: {"temperature": warm[row], "variance": 0.0}
