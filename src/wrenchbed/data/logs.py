"""Topics of rosbags 1 and 2 and of MCAP files, read message by message.

Messages as rows of numbers: fields by their path, times as whole nanoseconds.

Logs of robots that run ROS: one topic of a bag or an MCAP file as a table.

A recording as an MCAP file of ROS 2 messages, for whoever looks at logs with ROS's tools.
"""

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
from wrenchbed.data.bag1_file import Bag1File
from wrenchbed.data.bag2_folder import METADATA, Bag2Folder, SqliteFile
from wrenchbed.data.log_records import Channel, Log, Messages
from wrenchbed.data.mcap_file import McapFile
from wrenchbed.data.recording import Recording
from wrenchbed.errors import MapError, WrenchbedError, raise_shortage
from wrenchbed.files import atomic_write

STAMP, LOGGED = "stamp", "logged"
"""Times of a message: its header's, and when it was written [ns]."""
_LONGEST_DEFINITION = 2**18
"""Of a kind of messages [characters]: estimate, 20 times the longest of ROS's own."""
_OF_IDL = "=" * 80 + "\nIDL: "
"""Stands before each of several definitions in IDL."""
TRANSFORMS = "transforms"
"""Field of a TFMessage."""
Getter = Callable[[Any], float]


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
        self._times = {n: array("q") for n in self.wanted if n in (STAMP, LOGGED)}
        self._values = {n: array("d") for n in self.wanted if n not in (STAMP, LOGGED)}
        frames = [n.split(".")[1] for n in self._values if n.startswith(f"{TRANSFORMS}.")]
        self._frame = next((f for f in frames if not f.isdecimal()), None)

    def add(self, message: Any, logged: int) -> bool:
        """One message; whether it became a row."""
        told = message
        if self._frame is not None:
            told = _transform(message, self._frame)
            if told is None:
                self.seen += 1
                return False
            message = {TRANSFORMS: {self._frame: told}}
        if LOGGED in self._times:
            self._times[LOGGED].append(logged)
        if STAMP in self._times:
            at = _get(_get(told, "header"), "stamp")
            self._times[STAMP].append(_nanoseconds(at))
        names = _get(message, "name") if "." in "".join(self._values) else None
        for column, values in self._values.items():
            values.append(self._value(message, column, names))
        self.seen += 1
        return True

    def table(self) -> pa.Table:
        """What was gathered; fields that some message lacked are NaN."""
        columns = {n: pa.array(memoryview(v), pa.int64()) for n, v in self._times.items()}
        columns |= {n: pa.array(memoryview(v), pa.float64()) for n, v in self._values.items()}
        return pa.table({n: columns[n] for n in self.wanted})

    def _value(self, message: Any, column: str, names: Any) -> float:
        found: Any = message
        parts = column.split(".")
        for depth, part in enumerate(parts):
            inner = _get(found, part)
            if inner is None and names is not None and _listed(found):
                joint = ".".join(parts[depth:])
                inner = found[list(names).index(joint)] if joint in list(names) else None
                found = inner
                break
            found = inner
            if found is None:
                break
        if isinstance(found, bool | int | float) or hasattr(found, "__float__"):
            return float(found)
        self.missing.add(column)
        return float("nan")


def _get(thing: Any, name: str) -> Any:
    if isinstance(thing, Mapping):
        return thing.get(name)
    if _listed(thing):
        return thing[int(name)] if name.isdecimal() and int(name) < len(thing) else None
    return getattr(thing, name, None)


def _transform(message: Any, frame: str) -> Any:
    """The transform to a child frame in a TFMessage, with or without a slash before its name."""
    for each in _get(message, TRANSFORMS) or ():
        if str(_get(each, "child_frame_id")).lstrip("/") == frame.lstrip("/"):
            return each
    return None


def _listed(thing: Any) -> bool:
    return (
        hasattr(thing, "__len__")
        and hasattr(thing, "__getitem__")
        and not isinstance(thing, str | Mapping)
    )


def _nanoseconds(stamp: Any) -> int:
    """Of ROS 1 or 2, or JSON; −1 without one."""
    if stamp is None:
        return -1
    second = _get(stamp, "sec")
    part = _get(stamp, "nanosec")
    if part is None:
        part = _get(stamp, "nsec")
    return -1 if second is None or part is None else int(second) * 1_000_000_000 + int(part)


def is_log(path: Path) -> bool:
    """Whether a path is a bag (``.bag``, a folder with ``metadata.yaml``) or an MCAP file."""
    return path.suffix in (".bag", ".mcap", ".db3") or (path / METADATA).is_file()


def table(path: Path, topic: str | None, wanted: Sequence[str]) -> pa.Table:
    """Columns of one topic of a log.

    Args:
        path: of the log.
        topic: that is read; may be left out where there is only one.
        wanted: columns, see `Rows`.

    Raises:
        MapError: no such file, topic or field; a message without a stamp.
        MissingExtraError: rosbags or mcap is not installed.
    """
    if not path.exists():
        raise MapError(f"{path}: there is no such file")
    rows, logged = MessageRows(wanted), array("q")
    try:
        log = _opened(path)
        if topic is None:
            deque(log.messages(None), maxlen=0)
            topic = _chosen(path, topic, log.topics)
        with closing(log.messages(topic)) as messages:
            _gather(path, messages, rows, logged)
    except (OSError, MemoryError) as error:
        raise_shortage(error, path)
        raise MapError(f"{path}: cannot be read: {_line(error)}") from error
    _chosen(path, topic, log.topics)
    found = rows.table()
    if rows.seen and found.num_rows == 0:
        frames = ", ".join(wanted)
        raise MapError(f"{path}: no message of {topic!r} has the frame of {frames}")
    if STAMP in found.column_names and rows.seen and found[STAMP][0].as_py() < 0:
        raise MapError(f"{path}: messages of {topic!r} have no stamp: map t to column 'logged'")
    return _in_order(found, logged)


def _in_order(found: pa.Table, logged: Sequence[int]) -> pa.Table:
    """Rows in the order of writing; a file may hold them in another one."""
    times = np.asarray(logged, dtype=np.int64)
    return found if (np.diff(times) >= 0).all() else found.take(np.argsort(times, kind="stable"))


def _chosen(path: Path, topic: str | None, topics: Mapping[str, str]) -> str:
    if topic is not None and topic in topics:
        return topic
    if topic is None and len(topics) == 1:
        return next(iter(topics))
    known = ", ".join(f"{n} ({kind})" for n, kind in sorted(topics.items())) or "none"
    what = "name one with topic =" if topic is None else f"there is no topic {topic!r}"
    raise MapError(f"{path}: {what}; it holds {known}")


def _opened(path: Path) -> Log:
    """The reader of a log."""
    if path.suffix == ".mcap":
        return McapFile(path)
    if path.suffix == ".bag":
        return Bag1File(path)
    if path.suffix == ".db3" and not (path.parent / METADATA).is_file():
        return SqliteFile(path)
    return Bag2Folder(path.parent if path.suffix == ".db3" else path)


def _gather(path: Path, messages: Messages, rows: MessageRows, logged: "array[int]") -> None:
    """Add messages to the rows, and when each of these was written.

    Raises:
        MapError: a field is missing; a message or its definition is damaged, whatever a library
            raises there.
    """
    decoders: dict[Channel, Callable[[bytes], Any]] = {}
    for channel, now, data in messages:
        try:
            if channel not in decoders:
                decoders[channel] = _decoder(path, channel)
            if rows.add(decoders[channel](data), now):
                logged.append(now)
        except WrenchbedError:
            raise
        except Exception as error:  # generated code and parsers: no common base
            raise_shortage(error, path)
            where = f"{path}: topic {channel.topic!r} ({channel.kind}), message {rows.seen + 1}"
            raise MapError(f"{where}: cannot be decoded: {_line(error)}") from error
        if rows.missing:
            what = f"{channel.topic!r} ({channel.kind}), message {rows.seen}"
            raise MapError(f"{path}: topic {what}: has no {sorted(rows.missing)[0]!r}")


def _decoder(path: Path, channel: Channel) -> Callable[[bytes], Any]:
    """What turns the bytes of a channel's messages into objects."""
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


def _line(error: Exception) -> str:
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    if isinstance(error, RecursionError):
        return "nested too deeply"
    return (str(error) or type(error).__name__).splitlines()[0]


__all__ = ["is_log", "table"]


WRENCH, JOINTS, TEMPERATURE = "/wrench", "/joint_states", "/temperature"
KEY = "wrenchbed"
"""Metadata record that keeps the recording's own metadata as JSON."""
_FRAME = "sensor"
Message = Callable[[int], Any]


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
            channel = writer.register_channel(topic, "cdr", schema)
            channels.append((channel, kind, message))
        for row, now in enumerate(at.tolist()):
            for channel, kind, message in channels:
                data = bytes(store.serialize_cdr(message(row), kind))
                writer.add_message(channel, now, data, now, row)
        told = json.dumps(recording.metadata.to_json(), ensure_ascii=False)
        writer.add_metadata(KEY, {"json": told})
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
