"""One topic of a log as a table, fields by their path, times in whole ns; a recording as a log."""

import json
from array import array
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from wrenchbed import registry
from wrenchbed.data.log_files import Channel, Messages, line, messages
from wrenchbed.data.recording import Recording
from wrenchbed.errors import MapError, WrenchbedError, raise_shortage
from wrenchbed.files import atomic_write

STAMP, LOGGED = "stamp", "logged"
"""Times of a message: its header's, and when it was written [ns]."""
TRANSFORMS = "transforms"
"""Name of the field of a TFMessage."""
_LONGEST_DEFINITION = 2**18
"""Longest definition of a kind of messages that is parsed [characters]: 20 times the longest of
ROS's own; the parser takes seconds for a longer one."""
_OF_IDL = "=" * 80 + "\nIDL: "
"""Separator between several definitions in IDL."""
WRENCH, JOINTS, TEMPERATURE = "/wrench", "/joint_states", "/temperature"
KEY = "wrenchbed"
"""Metadata record that keeps the recording's own metadata as JSON."""
_FRAME = "sensor"
Message = Callable[[int], Any]
"""Function that returns the message of a row."""


class MessageRows:
    """Some fields of messages of one topic, gathered one by one.

    Args:
        wanted: names of columns: `STAMP`, `LOGGED`, a path such as ``wrench.force.x``, or, of
            messages with names (JointState), ``position.<joint>``; of transforms (TFMessage),
            ``transforms.<child frame>.transform.rotation.w``, where messages without that frame
            are left out.
    """

    def __init__(self, wanted: Sequence[str]) -> None:
        self.wanted = tuple(dict.fromkeys(wanted))
        self.missing: set[str] = set()
        self.seen = 0
        self._columns: dict[str, array[Any]] = {
            n: array("q" if n in (STAMP, LOGGED) else "d") for n in self.wanted
        }
        self._paths = {n: n.split(".") for n in self.wanted if n not in (STAMP, LOGGED)}
        frames = [path[1] for path in self._paths.values() if path[0] == TRANSFORMS and path[1:]]
        self._frame = next((frame for frame in frames if not frame.isdecimal()), None)

    def add(self, message: Any, logged: int) -> bool:
        """Whether a message, now added, became a row."""
        self.seen += 1
        headed = message
        if self._frame is not None:
            headed = _transform(message, self._frame)
            if headed is None:
                return False
            message = {TRANSFORMS: {self._frame: headed}}
        if LOGGED in self._columns:
            self._columns[LOGGED].append(logged)
        if STAMP in self._columns:
            self._columns[STAMP].append(_nanoseconds(_get(_get(headed, "header"), "stamp")))
        names = _get(message, "name")
        for column, path in self._paths.items():
            value = _at(message, path, names)
            if not (isinstance(value, bool | int | float) or hasattr(value, "__float__")):
                self.missing.add(column)
                value = float("nan")
            self._columns[column].append(float(value))
        return True

    def table(self) -> pa.Table:
        """Table of the messages; fields that some message lacked are NaN."""
        kinds = {"q": pa.int64(), "d": pa.float64()}
        columns = self._columns.items()
        return pa.table({n: pa.array(memoryview(c), kinds[c.typecode]) for n, c in columns})


def _at(message: Any, path: Sequence[str], names: Any) -> Any:
    """The value at a path; None if there is none. In a list, a joint's name stands for its place
    among ``names``."""
    value = message
    for depth, part in enumerate(path):
        inner = _get(value, part)
        if inner is None and names is not None and _is_list(value):
            joint = ".".join(path[depth:])  # a joint's name may hold dots
            return value[list(names).index(joint)] if joint in list(names) else None
        if inner is None:
            return None
        value = inner
    return value


def _get(thing: Any, name: str) -> Any:
    """A field of a message, or an element of a list by its number; None if there is none."""
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
    """The transform to a child frame in a TFMessage, with or without a slash before its name."""
    for each in _get(message, TRANSFORMS) or ():
        if str(_get(each, "child_frame_id")).lstrip("/") == frame.lstrip("/"):
            return each
    return None


def _nanoseconds(stamp: Any) -> int:
    """A stamp of ROS 1 or 2, or of JSON [ns]; −1 without one."""
    second, part = _get(stamp, "sec"), _get(stamp, "nanosec")
    if part is None:
        part = _get(stamp, "nsec")
    return -1 if second is None or part is None else int(second) * 1_000_000_000 + int(part)


def table(path: Path, topic: str | None, wanted: Sequence[str]) -> pa.Table:
    """Columns of one topic of a log, rows in the order in which the messages were written.

    Args:
        path: of the log.
        topic: that is read; may be left out where there is only one.
        wanted: columns, see `MessageRows`.

    Raises:
        MapError: no such file, topic or field; a message without a stamp; a damaged log.
        MissingExtraError: rosbags or mcap is not installed.
    """
    if not path.exists():
        raise MapError(f"{path}: there is no such file")
    rows, logged = MessageRows(wanted), array("q")
    topics: dict[str, str] = {}
    try:
        if topic is None:
            deque(messages(path, None, topics), maxlen=0)
            topic = _chosen(path, topic, topics)
        with closing(messages(path, topic, topics)) as read:
            _gather(path, read, rows, logged)
    except (OSError, MemoryError) as error:
        raise_shortage(error, path)
        raise MapError(f"{path}: cannot be read: {line(error)}") from error
    _chosen(path, topic, topics)
    columns = rows.table()
    if rows.seen and columns.num_rows == 0:
        raise MapError(f"{path}: no message of {topic!r} has the frame of {', '.join(wanted)}")
    if STAMP in columns.column_names and rows.seen and columns[STAMP].to_numpy().max() <= 0:
        raise MapError(f"{path}: messages of {topic!r} have no stamp: map t to column 'logged'")
    times = np.asarray(logged, dtype=np.int64)
    in_order = (np.diff(times) >= 0).all()
    return columns if in_order else columns.take(np.argsort(times, kind="stable"))


def _chosen(path: Path, topic: str | None, topics: Mapping[str, str]) -> str:
    """The topic that is read, or an error that lists those of the log."""
    if topic is not None and topic in topics:
        return topic
    if topic is None and len(topics) == 1:
        return next(iter(topics))
    known = ", ".join(f"{n} ({kind})" for n, kind in sorted(topics.items())) or "none"
    what = "name one with topic =" if topic is None else f"there is no topic {topic!r}"
    raise MapError(f"{path}: {what}; it holds {known}")


def _gather(path: Path, read: Messages, rows: MessageRows, logged: "array[int]") -> None:
    """Add messages to the rows, and when each of these was written.

    Raises:
        MapError: a field is missing; a message or its definition is damaged, whatever a library
            raises there.
    """
    decoders: dict[Channel, Callable[[bytes], Any]] = {}
    for channel, now, data in read:
        where = f"{path}: topic {channel.topic!r} ({channel.kind}), message {rows.seen + 1}"
        try:
            if channel not in decoders:
                decoders[channel] = _decoder(path, channel)
            if rows.add(decoders[channel](data), now):
                logged.append(now)
        except WrenchbedError:
            raise
        except Exception as error:  # generated code and parsers: no common base
            raise_shortage(error, path)
            raise MapError(f"{where}: cannot be decoded: {line(error)}") from error
        if rows.missing:
            raise MapError(f"{where}: has no {sorted(rows.missing)[0]!r}")


def _decoder(path: Path, channel: Channel) -> Callable[[bytes], Any]:
    """Function that decodes the bytes of a channel's messages into objects."""
    if channel.encoding == "json":
        return json.loads
    where = f"{path}: topic {channel.topic!r}"
    if channel.encoding not in ("cdr", "ros1"):
        raise MapError(f"{where}: is in {channel.encoding!r}; cdr, ros1 and json can be read")
    if len(channel.definition) > _LONGEST_DEFINITION:
        raise MapError(f"{where}: the definition has {len(channel.definition):,} characters")
    typesys = registry.require("rosbags.typesys", "logs")
    kind = channel.kind
    if channel.definition:
        store = typesys.get_typestore(typesys.Stores.EMPTY)
        store.register(_types(typesys, channel))
        ros1 = channel.encoding == "ros1"
        if channel.digest and channel.digest != (
            store.generate_msgdef(kind)[1] if ros1 else store.hash_rihs01(kind)
        ):
            raise MapError(f"{where}: the definition of {kind} does not fit its checksum: damaged")
    else:
        store = typesys.get_typestore(typesys.Stores.LATEST)
    read = store.deserialize_cdr if channel.encoding == "cdr" else store.deserialize_ros1
    return lambda data: read(data, kind)


def _types(typesys: Any, channel: Channel) -> Any:
    """The kinds that a definition defines; in IDL several may stand one behind the other."""
    if channel.language == "msg":
        return typesys.get_types_from_msg(channel.definition, channel.kind)
    if not channel.definition.startswith(_OF_IDL):
        return typesys.get_types_from_idl(channel.definition)
    texts = channel.definition.split(_OF_IDL)[1:]
    parts = [typesys.get_types_from_idl(text.partition("\n")[2]) for text in texts]
    return {name: kind for part in parts for name, kind in part.items()}


def write_mcap(recording: Recording, path: str | Path) -> None:
    """Write wrench, joints and temperature as `geometry_msgs` and `sensor_msgs` in CDR.

    Args:
        recording: its time 0 becomes the log's.
        path: of the ``.mcap``.

    Raises:
        MissingExtraError: mcap or rosbags is not installed.
    """
    writer_of = registry.require("mcap.writer", "logs").Writer
    typesys = registry.require("rosbags.typesys", "logs")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    at = np.round(1e9 * recording.t.astype(float)).astype(np.int64)
    with atomic_write(path) as stream:
        writer = writer_of(stream)
        writer.start(profile="ros2", library="wrenchbed")
        channels = []
        for topic, kind, message in _topics(recording, at, store):
            text, _ = store.generate_msgdef(kind, ros_version=2)
            schema = writer.register_schema(kind, "ros2msg", text.encode())
            channels.append((writer.register_channel(topic, "cdr", schema), kind, message))
        for row, now in enumerate(at.tolist()):
            for channel, kind, message in channels:
                data = bytes(store.serialize_cdr(message(row), kind))
                writer.add_message(channel, now, data, now, row)
        metadata = json.dumps(recording.metadata.to_json(), ensure_ascii=False)
        writer.add_metadata(KEY, {"json": metadata})
        writer.finish()


def _topics(recording: Recording, at: np.ndarray, store: Any) -> Iterator[tuple[str, str, Message]]:
    """Topic, type and the message of a row, of all that a recording has."""
    known = store.types
    time, header = known["builtin_interfaces/msg/Time"], known["std_msgs/msg/Header"]

    def head(row: int) -> Any:
        seconds, rest = divmod(int(at[row]), 1_000_000_000)
        return header(stamp=time(sec=seconds, nanosec=rest), frame_id=_FRAME)

    values = recording.wrench.astype(float)
    vector = known["geometry_msgs/msg/Vector3"]
    wrench, stamped = known["geometry_msgs/msg/Wrench"], known["geometry_msgs/msg/WrenchStamped"]

    def load(row: int) -> Any:
        force, torque = (vector(*map(float, part)) for part in np.split(values[row], 2))
        return stamped(header=head(row), wrench=wrench(force=force, torque=torque))

    yield WRENCH, "geometry_msgs/msg/WrenchStamped", load
    if recording.joints:
        robot, names = recording.metadata.robot, list(recording.joints)
        if registry.is_known("robots", robot):
            names = list(registry.load("robots", robot).joint_names)
        state, q = known["sensor_msgs/msg/JointState"], recording.q.astype(float)
        none = np.zeros(0)

        def place(row: int) -> Any:
            return state(header=head(row), name=names, position=q[row], velocity=none, effort=none)

        yield JOINTS, "sensor_msgs/msg/JointState", place
    if "temperature" in recording.columns:
        warm = recording.columns["temperature"].astype(float)
        kind = known["sensor_msgs/msg/Temperature"]

        def warmth(row: int) -> Any:
            return kind(header=head(row), temperature=float(warm[row]), variance=0.0)

        yield TEMPERATURE, "sensor_msgs/msg/Temperature", warmth
