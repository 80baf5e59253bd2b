"""A bag of ROS 2: a folder with `metadata.yaml` and SQLite or MCAP files.

SQLite files have no checksums. Checked are the database's own structure, and that the files hold
as many messages of each topic as `metadata.yaml` states.
"""

import sqlite3
from collections import Counter
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from typing import Any
from urllib.parse import quote

from wrenchbed import registry
from wrenchbed.data.checked import Fields
from wrenchbed.data.log_records import Channel, Messages
from wrenchbed.data.mcap_file import McapFile
from wrenchbed.data.unpacking import LARGEST, Unpacker
from wrenchbed.errors import MapError

METADATA = "metadata.yaml"
_LONGEST = 2**20
"""Of metadata.yaml [bytes]: estimate, ROS writes 1 kB a topic."""
_KEY = "rosbag2_bagfile_information"
_TABLES = {"topics", "messages"}


class SqliteFile:
    """One file of a bag of ROS 2, see `log_records.Log`.

    Args:
        path: of the ``.db3``.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._channels: dict[int, Channel] = {}
        self.counts: Counter[str] = Counter()

    @property
    def topics(self) -> dict[str, str]:
        """Topics and their kinds."""
        return {c.topic: c.kind for c in self._channels.values()}

    def messages(self, topic: str | None) -> Messages:
        """Messages of one topic; None checks the file and yields none.

        Raises:
            MapError: see `log_records.Log`.
        """
        with self._database() as base:
            self._channels = dict(_channels(base, self.path))
            self.counts = Counter()
            for number, count in base.execute("SELECT topic_id, count(*) FROM messages GROUP BY 1"):
                if number not in self._channels:
                    raise MapError(f"{self.path}: holds messages of no topic: damaged")
                self.counts[self._channels[number].topic] += count
            for number, channel in self._channels.items():
                if channel.topic == topic:
                    yield from _rows(base, number, channel, self.path)

    @contextmanager
    def _database(self) -> Iterator[sqlite3.Connection]:
        uri = f"file:{quote(str(self.path.absolute()))}?mode=ro&immutable=1"
        try:
            with closing(sqlite3.connect(uri, uri=True)) as base:
                base.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LARGEST)
                base.execute("PRAGMA trusted_schema = OFF")
                (found,) = base.execute("PRAGMA quick_check(1)").fetchone()
                if found != "ok":
                    raise MapError(
                        f"{self.path}: the database is damaged: {found.splitlines()[-1]}"
                    )
                yield base
        except (sqlite3.Error, OverflowError, UnicodeDecodeError) as error:
            raise MapError(f"{self.path}: not a database that can be read: {error}") from error


def _channels(base: sqlite3.Connection, path: Path) -> Iterator[tuple[int, Channel]]:
    """Numbers and channels of the topics."""
    tables = {n for (n,) in base.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
    if not tables >= _TABLES:
        raise MapError(f"{path}: not a bag that can be read: it has no table of messages")
    columns = {row[1] for row in base.execute("PRAGMA table_info(topics)")}
    digest = "type_description_hash" if "type_description_hash" in columns else "''"
    known: dict[str, tuple[str, str]] = {}
    if "message_definitions" in tables:
        known = {
            name: (text, "idl" if language == "ros2idl" else "msg" if text else "")
            for name, language, text in base.execute(
                "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
            )
        }
    query = f"SELECT id, name, type, serialization_format, {digest} FROM topics"
    for number, *texts in base.execute(query):
        if not all(isinstance(text, str) for text in texts):
            raise MapError(f"{path}: a topic in it has no name or kind: damaged")
        name, kind, encoding, stated = texts
        yield number, Channel(name, kind, encoding, *known.get(kind, ("", "")), stated)


def _rows(base: sqlite3.Connection, number: int, channel: Channel, path: Path) -> Messages:
    query = "SELECT timestamp, data FROM messages WHERE topic_id = ? ORDER BY timestamp, id"
    for row, (logged, data) in enumerate(base.execute(query, (number,)), 1):
        if not isinstance(logged, int) or not isinstance(data, bytes):
            raise MapError(f"{path}: {channel.topic!r}, message {row}: has no time or no content")
        yield channel, logged, data


_STORAGES: dict[str, type[SqliteFile] | type[McapFile]] = {
    "sqlite3": SqliteFile, "mcap": McapFile,
}  # fmt: skip


class Bag2Folder:
    """See `log_records.Log`.

    Args:
        path: of the folder.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._stated, self._counts = Counter[str](), Counter[str]()
        told = Fields(_metadata(path / METADATA), f"{path / METADATA}: ", MapError).part(_KEY)
        self._kinds = dict(self._topics(told))
        names = told.raw.get("relative_file_paths")
        if not isinstance(names, list) or not all(isinstance(n, str) and n for n in names):
            raise told.error("relative_file_paths", "must be a list of files")
        self._files = [path / PurePath(name).name for name in names]
        self._opened = _STORAGES[
            told.choice("storage_identifier", _STORAGES, "must be 'sqlite3' or 'mcap'")
        ]
        self._compressed = str(told.raw.get("compression_mode") or "none").lower()
        self._compression = str(told.raw.get("compression_format") or "none")

    def _topics(self, told: Fields) -> Iterator[tuple[str, str]]:
        for entry in told.parts("topics_with_message_count"):
            topic = entry.part("topic_metadata")
            name = str(topic.text("name", required=True))
            self._stated[name] += int(entry.number("message_count", "1", nonnegative=True) or 0)
            yield name, str(topic.text("type", required=True))

    @property
    def topics(self) -> dict[str, str]:
        """Topics and their kinds."""
        return self._kinds

    def messages(self, topic: str | None) -> Messages:
        """Messages of one topic; None reads and checks all and yields none.

        Raises:
            MapError: see `log_records.Log`.
        """
        self._counts = Counter()
        with TemporaryDirectory() as folder:
            for path in self._files:
                if not path.is_file():
                    raise MapError(f"{path}: there is no such file; {METADATA} names it")
                yield from self._file(path, topic, Path(folder))
        wrong = [n for n in self._stated | self._counts if self._stated[n] != self._counts[n]]
        if wrong:
            name = sorted(wrong)[0]
            raise MapError(
                f"{self.path / METADATA}: states {self._stated[name]:,} messages of {name!r}, the "
                f"files hold {self._counts[name]:,}: damaged, or a file was exchanged"
            )

    def _file(self, path: Path, topic: str | None, folder: Path) -> Messages:
        unpacker, inner = Unpacker(path), path
        if self._compressed == "file":
            inner = folder / path.stem
            inner.write_bytes(
                unpacker.unpack(path.read_bytes(), self._compression, None, str(path))
            )
        file = self._opened(inner)
        for channel, logged, data in file.messages(topic):
            if self._compressed == "message":
                where = f"{path}: {topic!r}: a message"
                data = unpacker.unpack(data, self._compression, None, where)
            yield channel, logged, data
        self._counts += file.counts


def _metadata(path: Path) -> Any:
    """The content of metadata.yaml.

    Raises:
        MapError: missing, too long or not YAML.
    """
    yaml = registry.require("ruamel.yaml", "logs")
    try:
        text = path.read_bytes()
        if len(text) > _LONGEST:
            raise MapError(f"{path}: has {len(text):,} bytes, more than {_LONGEST:,}")
        return yaml.YAML(typ="safe", pure=True).load(text.decode())
    except FileNotFoundError as error:
        raise MapError(
            f"{path.parent}: not a bag that can be read: it has no {METADATA}"
        ) from error
    except OSError as error:
        raise MapError(f"{path}: cannot be read: {error.strerror}") from error
    except MapError:
        raise
    except Exception as error:  # YAML's readers raise errors of many kinds
        raise MapError(f"{path}: not valid YAML: {str(error).splitlines()[0]}") from error
