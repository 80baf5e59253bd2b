"""Topics of rosbags 1 and 2 and of MCAP files, read message by message."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pyarrow as pa

from wrenchbed import registry
from wrenchbed.errors import MapError
from wrenchbed.logs.flatten import STAMP, Rows

Messages = Iterator[tuple[Any, int]]
"""Messages of a topic and when each was written [ns]."""


def is_log(path: Path) -> bool:
    """Whether a path is a bag (``.bag``, a folder with ``metadata.yaml``) or an MCAP file."""
    return path.suffix in (".bag", ".mcap", ".db3") or (path / "metadata.yaml").is_file()


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
    opened = _mcap if path.suffix == ".mcap" else _bag
    rows, count = Rows(wanted), 0
    with opened(path) as (topics, read):
        topic = _chosen(path, topic, topics)
        for message, logged in read(topic):
            rows.add(message, logged)
            count += 1
            if rows.missing:
                what = f"{topic!r} ({topics[topic]}), message {count}"
                raise MapError(f"{path}: topic {what}: has no {sorted(rows.missing)[0]!r}")
    found = rows.table()
    if STAMP in found.column_names and count and found[STAMP][0].as_py() < 0:
        raise MapError(f"{path}: messages of {topic!r} have no stamp: map t to column 'logged'")
    return found


def _chosen(path: Path, topic: str | None, topics: Mapping[str, str]) -> str:
    if topic is not None and topic in topics:
        return topic
    if topic is None and len(topics) == 1:
        return next(iter(topics))
    known = ", ".join(f"{n} ({kind})" for n, kind in sorted(topics.items())) or "none"
    what = "name one with topic =" if topic is None else f"there is no topic {topic!r}"
    raise MapError(f"{path}: {what}; it holds {known}")


@contextmanager
def _bag(path: Path) -> Iterator[tuple[dict[str, str], Callable[[str], Messages]]]:
    """A bag of ROS 1 or 2."""
    rosbags = registry.require("rosbags.highlevel", "logs")
    typesys = registry.require("rosbags.typesys", "logs")
    folder = path.parent if path.suffix == ".db3" else path
    try:
        reader = rosbags.AnyReader(
            [folder], default_typestore=typesys.get_typestore(typesys.Stores.LATEST)
        )
        reader.open()
    except (rosbags.AnyReaderError, OSError, KeyError, ValueError) as error:
        raise MapError(f"{path}: not a bag that can be read: {_line(error)}") from error
    try:

        def read(topic: str) -> Messages:
            for connection, logged, raw in reader.messages(
                [c for c in reader.connections if c.topic == topic]
            ):
                yield reader.deserialize(raw, connection.msgtype), logged

        yield {c.topic: c.msgtype for c in reader.connections}, read
    finally:
        reader.close()


@contextmanager
def _mcap(path: Path) -> Iterator[tuple[dict[str, str], Callable[[str], Messages]]]:
    """An MCAP file of ROS 1, ROS 2 or JSON messages."""
    mcap = registry.require("mcap.reader", "logs")
    errors = registry.require("mcap.exceptions", "logs")
    with path.open("rb") as stream:
        try:
            reader = mcap.make_reader(stream)
            summary = reader.get_summary()
        except (errors.McapError, OSError, ValueError) as error:
            raise MapError(f"{path}: not an MCAP file that can be read: {_line(error)}") from error
        if summary is None:
            raise MapError(f"{path}: ends early; mend it with `mcap recover`")
        schemas = summary.schemas
        topics = {c.topic: schemas[c.schema_id].name if c.schema_id in schemas else "no schema"
                  for c in summary.channels.values()}  # fmt: skip

        def read(topic: str) -> Messages:
            decoders: dict[int, Callable[[bytes], Any]] = {}
            for schema, channel, message in reader.iter_messages(topics=[topic]):
                if channel.id not in decoders:
                    decoders[channel.id] = _decoder(path, schema, channel.message_encoding)
                yield decoders[channel.id](message.data), message.log_time

        yield topics, read


def _decoder(path: Path, schema: Any, encoding: str) -> Callable[[bytes], Any]:
    if encoding == "json":
        return json.loads
    if encoding not in ("cdr", "ros1") or schema is None:
        raise MapError(f"{path}: messages in {encoding!r} cannot be read; cdr, ros1 and json can")
    typesys = registry.require("rosbags.typesys", "logs")
    store = typesys.get_typestore(typesys.Stores.EMPTY)
    name = schema.name if schema.name.count("/") == 2 else schema.name.replace("/", "/msg/")
    store.register(typesys.get_types_from_msg(schema.data.decode(), name))
    read = store.deserialize_cdr if encoding == "cdr" else store.deserialize_ros1
    return lambda data: read(data, name)


def _line(error: Exception) -> str:
    return (str(error) or type(error).__name__).splitlines()[0]
