"""Logs, tables and settings that are cut, flipped, made to mislead or made to fill the memory."""

import resource
import struct
import sys
import tracemalloc
from contextlib import suppress
from functools import partial

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from mcap.writer import CompressionType
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

import wrenchbed as wb
from json_logs import json_log
from recorded import METADATA, columns
from robot_logs import COUNT, bag1, bag2, fill
from wrenchbed.data import parquet, rosbag_and_mcap
from wrenchbed.data.plan import Plan, is_plan
from wrenchbed.data.recording import Recording
from wrenchbed.data.rosbag_and_mcap import table
from wrenchbed.data.text_table import read_text
from wrenchbed.errors import (
    MapError,
    ParameterError,
    PlanError,
    RecordingError,
    ShortageError,
    WrenchbedError,
)
from wrenchbed.files import checked
from wrenchbed.robots.described import read as read_robot
from wrenchbed.robots.model_file import read_arm
from wrenchbed.sensors.described import read as read_sensor

WANTED = ["stamp", "wrench.force.x"]
MB = 2**20
zstd = pytest.importorskip("compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd")


def mcap_of(path, **options):
    """Numbers in JSON, so that one digit can be changed without changing a length."""
    options = {"compression": CompressionType.NONE, "chunk_size": 2000} | options
    return json_log(path, (("/wrench", {"fx": 1000 + k}, k) for k in range(100)), **options)


def refused(path, *parts, topic="/wrench", wanted=("fx",)):
    """The message, one line that begins with the file."""
    with pytest.raises(MapError) as caught:
        table(path, topic, list(wanted))
    text = str(caught.value)
    assert "\n" not in text and text.startswith(str(path)), text
    for part in parts:
        assert part in text, text
    return text


@pytest.mark.parametrize("compression", list(CompressionType))
def test_a_digit_changed_in_a_chunk_is_refused_with_its_place(compression, tmp_path):
    path = mcap_of(tmp_path / "a.mcap", compression=compression)
    assert table(path, "/wrench", ["fx"])["fx"].to_pylist() == [1000.0 + k for k in range(100)]
    data = path.read_bytes()
    if compression == CompressionType.NONE:
        path.write_bytes(data.replace(b'{"fx": 1050}', b'{"fx": 1850}'))
        refused(path, "behind message 45 of", "the checksum does not fit the data", "damaged")
    else:  # any byte of the third chunk's compressed data
        magic = struct.pack("<I", 0xFD2FB528 if compression == CompressionType.ZSTD else 0x184D2204)
        at = [k for k in range(len(data)) if data[k : k + 4] == magic][2] + 40
        path.write_bytes(data[:at] + bytes([data[at] ^ 4]) + data[at + 1 :])
        refused(path, "behind message ")


def test_the_checksum_of_the_data_and_missing_chunks_are_noticed(tmp_path):
    path = mcap_of(tmp_path / "a.mcap", enable_data_crcs=True, use_chunking=False)
    assert table(path, "/wrench", ["fx"]).num_rows == 100
    path.write_bytes(path.read_bytes().replace(b'{"fx": 1050}', b'{"fx": 1850}'))
    refused(path, "the checksum does not fit the data")
    path = mcap_of(tmp_path / "a.mcap")
    data = bytearray(path.read_bytes())
    at = data.index(b"\x06", data.index(b"\x06", 60) + 1900)
    while struct.unpack_from("<Q", data, at + 1)[0] > 2500 or data[at] != 6:
        at = data.index(b"\x06", at + 1)
    data[at] = 0x86  # a private record, which any reader skips
    path.write_bytes(data)
    refused(path)


def compressed1(path, way):
    writer = Writer1(path / "log.bag")
    writer.set_compression(way)
    return writer, Stores.ROS1_NOETIC, "log.bag"


def compressed2(path, way, storage=StoragePlugin.SQLITE3):
    writer = Writer2(path / "log", version=9, storage_plugin=storage)
    writer.set_compression(way, CompressionFormat.ZSTD)
    return writer, Stores.ROS2_HUMBLE, "log"


compressed_mcap = partial(compressed2, storage=StoragePlugin.MCAP)
COMPRESSED = [
    (compressed1, Writer1.CompressionFormat.BZ2),
    (compressed1, Writer1.CompressionFormat.LZ4),
    (compressed2, CompressionMode.FILE),
    (compressed2, CompressionMode.MESSAGE),
    (compressed_mcap, CompressionMode.FILE),
    (compressed_mcap, CompressionMode.MESSAGE),
    (compressed_mcap, CompressionMode.STORAGE),
]


@pytest.mark.parametrize(("make", "way"), COMPRESSED)
def test_compressed_bags_come_in(make, way, tmp_path):
    writer, _, name = make(tmp_path, way)
    fill(writer, "/wrench")
    (tmp_path / "plain").mkdir()
    plain = (bag1 if make is compressed1 else bag2)(tmp_path / "plain")
    plain = table(plain, "/wrench", WANTED)
    assert table(tmp_path / name, "/wrench", WANTED).equals(plain)


@pytest.mark.parametrize(("make", "way"), COMPRESSED)
def test_a_bag_that_is_a_bomb_is_refused_before_it_fills_the_memory(
    make, way, tmp_path, monkeypatch
):
    writer, known, name = make(tmp_path, way)
    with writer:
        kind, store = "geometry_msgs/msg/WrenchStamped", get_typestore(known)
        topic = writer.add_connection("/wrench", kind, typestore=store)
        writer.write(topic, 1, bytes(32 * MB))
    monkeypatch.setattr(rosbag_and_mcap, "LARGEST", 4 * MB)
    monkeypatch.setattr(rosbag_and_mcap, "RATIO", 2)
    refused_without_memory(tmp_path / name, "4,194,304")
    if make is compressed1:  # a chunk that states less than it holds
        path = tmp_path / name
        whole = path.read_bytes()
        at = whole.index(b"size=", whole.index(b"compression=")) + 5
        path.write_bytes(whole[:at] + struct.pack("<I", 1000) + whole[at + 4 :])
        refused_without_memory(path, "unpack to more than 1,000")


def refused_without_memory(path, *parts):
    """The message as `refused`, where far less than the bomb's 32 MB was in use meanwhile."""
    assert sum(f.stat().st_size for f in (path.iterdir() if path.is_dir() else [path])) < 300_000
    tracemalloc.start()
    try:
        text = refused(path, *parts)
        assert tracemalloc.get_traced_memory()[1] < 16 * MB
    finally:
        tracemalloc.stop()
    return text


@pytest.mark.parametrize("storage", list(StoragePlugin))
def test_a_message_that_does_not_state_its_size_is_no_bomb_either(storage, tmp_path, monkeypatch):
    packer = zstd.ZstdCompressor()
    bomb = packer.compress(bytes(32 * MB)) + packer.flush()
    with Writer2(tmp_path / "log", version=9, storage_plugin=storage) as writer:
        kind, store = "geometry_msgs/msg/WrenchStamped", get_typestore(Stores.ROS2_HUMBLE)
        writer.write(writer.add_connection("/wrench", kind, typestore=store), 1, bomb)
    about = tmp_path / "log" / "metadata.yaml"
    text = about.read_text()
    text = text.replace("compression_format: ''", "compression_format: zstd")
    about.write_text(text.replace("compression_mode: ''", "compression_mode: MESSAGE"))
    monkeypatch.setattr(rosbag_and_mcap, "LARGEST", 4 * MB)
    refused_without_memory(tmp_path / "log", "unpack to more than 4,194,304")


@pytest.mark.parametrize("way", [CompressionType.LZ4, CompressionType.ZSTD])
@pytest.mark.parametrize("stated", [32 * MB + 100, 1000])
def test_a_chunk_of_an_mcap_file_that_is_a_bomb_is_refused(stated, way, tmp_path, monkeypatch):
    path = json_log(tmp_path / "a.mcap", [("/wrench", bytes(32 * MB), 1)], compression=way)
    whole = path.read_bytes()
    at = whole.index(b"\x06", 9 + 12) + 9 + 16
    path.write_bytes(whole[:at] + struct.pack("<Q", stated) + whole[at + 8 :])
    monkeypatch.setattr(rosbag_and_mcap, "LARGEST", 4 * MB)
    refused_without_memory(path, "4,194,304" if stated > MB else "unpack to more than 1,000")


def test_a_bag_whose_index_or_definition_is_another_is_refused(tmp_path):
    path = bag1(tmp_path)
    whole = path.read_bytes()
    path.write_bytes(whole.replace(b"geometry_msgs/Vector3 force", b"geometry_msgs/Vector3 ferce"))
    refused(path, "does not fit its checksum", wanted=["wrench.ferce.x"])
    at = whole.rindex(b"count=")
    path.write_bytes(whole[: at + 6] + bytes([whole[at + 6] ^ 1]) + whole[at + 7 :])
    refused(path)
    path.write_bytes(whole.replace(b"index_pos=", b"index_pos=" + bytes(8), 1)[: len(whole)])
    refused(path)


@pytest.mark.slow
def test_counts_of_a_bag_of_ros_2_must_agree(tmp_path):
    log = bag2(tmp_path)
    about = log / "metadata.yaml"
    text = about.read_text()
    about.write_text(text.replace(f"message_count: {COUNT}", f"message_count: {COUNT + 1}"))
    told = f"states {COUNT + 1} messages", f"holds {COUNT}"
    refused(log, *told, wanted=WANTED)
    about.write_text("a: " + "[" * 1200)
    refused(log, "not a log that can be read")
    about.unlink()
    alone = table(next(log.glob("*.db3")), "/wrench", WANTED)
    assert alone.num_rows == COUNT


def test_messages_are_sorted_by_the_time_of_writing(tmp_path):
    json_log(tmp_path / "a.mcap", (("/a", {"x": k}, k) for k in (3, 1, 2)))
    assert table(tmp_path / "a.mcap", None, ["x"])["x"].to_pylist() == [1.0, 2.0, 3.0]


@pytest.mark.parametrize("content", [b"[" * 5000, b'{"fx": 1' + b"0" * 400 + b"}", b"\xff", b"7"])
def test_messages_that_are_no_objects_of_numbers(content, tmp_path):
    json_log(tmp_path / "a.mcap", [("/wrench", content, 0)])
    refused(tmp_path / "a.mcap", "message 1")


def test_a_log_without_the_memory_for_it_is_not_called_damaged(tmp_path, monkeypatch):
    path = mcap_of(tmp_path / "a.mcap")

    def full(*_):
        raise MemoryError

    monkeypatch.setattr(rosbag_and_mcap, "_decoder", full)
    with pytest.raises(ShortageError, match=r"a\.mcap: out of memory"):
        table(path, "/wrench", ["fx"])


def recording(path):
    Recording(METADATA, columns(50)).write(path)
    return path


def test_a_flipped_number_of_a_recording_is_refused(tmp_path):
    path = recording(tmp_path / "rec.parquet")
    whole, true = path.read_bytes(), Recording.read(path).columns
    for at in range(4, 2500, 21):
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 8]) + whole[at + 1 :])
        with suppress(RecordingError):
            found = Recording.read(path).columns
            assert all(np.array_equal(found[c], true[c]) for c in true), at


def test_a_small_file_that_states_many_rows_is_refused(tmp_path):
    rows = 3_000_000
    told = {b"wrenchbed": b'{"format": 1, "robot": "ur5", "mode": "static"}'}
    same = pa.DictionaryArray.from_arrays(pa.array(np.zeros(rows, np.int32)), pa.array([1.0]))
    wide = pa.table({f"q{k + 1}": same for k in range(20)}).replace_schema_metadata(told)
    pq.write_table(wide, tmp_path / "a.parquet")
    assert (tmp_path / "a.parquet").stat().st_size < 300_000
    with pytest.raises(PlanError, match="states 3,000,000 rows of 20 columns, which a file of"):
        Plan.read(tmp_path / "a.parquet")


def test_a_long_text_that_is_repeated_does_not_fill_the_memory(tmp_path):
    text = pa.DictionaryArray.from_arrays(
        pa.array(np.zeros(50, np.int32)), pa.array(["y" * 8 * MB])
    )
    plain = pq.read_table(recording(tmp_path / "rec.parquet"))
    wide = plain.append_column("note", text)
    with pq.ParquetWriter(tmp_path / "rec.parquet", wide.schema, store_schema=False) as writer:
        writer.write_table(wide)
        writer.add_key_value_metadata({"wrenchbed": plain.schema.metadata[b"wrenchbed"]})
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    assert len(Recording.read(tmp_path / "rec.parquet").columns["note"][49]) == 8 * MB
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - peak < 200_000  # kB, 50 × 8 MB


def test_columns_of_lists_and_names_that_are_no_text_are_refused(tmp_path):
    plain = pq.read_table(recording(tmp_path / "rec.parquet"))
    pq.write_table(plain.append_column("x", pa.array([[1.0]] * 50)), tmp_path / "rec.parquet")
    with pytest.raises(RecordingError, match=r"column 'x' holds list<.*not numbers or text"):
        Recording.read(tmp_path / "rec.parquet")
    path = recording(tmp_path / "rec.parquet")
    path.write_bytes(path.read_bytes().replace(b"q1", b"\xff\xfe"))
    assert not is_plan(path)
    with pytest.raises(RecordingError, match="not a complete Parquet file"):
        Recording.read(path)


@pytest.mark.parametrize("text", ["[" * 900 + "]" * 900, '{"a":' * 5000, "1" * 5000, "{\xff"])
def test_hostile_metadata_of_a_recording(text, tmp_path):
    plain = pq.read_table(recording(tmp_path / "rec.parquet"))
    pq.write_table(plain.replace_schema_metadata({"wrenchbed": text}), tmp_path / "rec.parquet")
    with pytest.raises(RecordingError, match="key 'wrenchbed'"):
        Recording.read(tmp_path / "rec.parquet")


@pytest.mark.parametrize("at_once", [2**18, 7])
def test_memory_that_does_not_suffice_is_named(tmp_path, monkeypatch, at_once):
    path = recording(tmp_path / "rec.parquet")
    monkeypatch.setattr(parquet, "ROWS_AT_ONCE", at_once)

    def full(*_, **__):
        raise pa.ArrowMemoryError("malloc of size 64 failed")

    monkeypatch.setattr(pq.ParquetFile, "read", full)
    with pytest.raises(ShortageError, match=r"rec\.parquet: out of memory"):
        Recording.read(path)


@pytest.mark.parametrize(
    ("name", "text", "told"),
    [
        ("a.json", "[" * 500 + "]" * 500, "more than 100 levels"),
        ("a.json", " " * (2**25 + 1), "longer than 33,554,432 bytes"),
        ("a.toml", "x = " + "[" * 500 + "]" * 500, "more than 100 levels"),
        ("a.toml", "a." * 300 + "b = 1", "more than 200 dots"),
        ("a.toml", "#" * (2**20 + 1), "longer than 1,048,576 bytes"),
    ],
)
def test_long_and_deep_settings_are_refused(name, text, told, tmp_path):
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(MapError, match=told):
        wb.read_map(path)
    for read in (read_robot, read_sensor) if path.suffix == ".toml" else ():
        with pytest.raises(ParameterError, match=told) as caught:
            read(path)
        assert str(path) in str(caught.value) and "\n" not in str(caught.value)


def test_long_names_and_lines_are_refused_and_wide_tables_read(tmp_path):
    with pytest.raises(WrenchbedError) as caught:
        checked.Fields({"robot": "r" * 2_000_000}, "f: ", RecordingError).text("robot")
    assert "2,000,000 characters" in str(caught.value) and len(str(caught.value)) < 1000
    (tmp_path / "a.csv").write_text("a,b\n1,2\n" + "3," * 60_000 + "\n")
    with pytest.raises(MapError, match="line 3 has 120,000 characters, more than 100,000"):
        read_text(tmp_path / "a.csv")
    wide = "\n".join(",".join(f"{r}.{k}" for k in range(3000)) for r in range(60))
    (tmp_path / "b.csv").write_text(wide)
    assert read_text(tmp_path / "b.csv").table.shape == (60, 3000)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ('<!DOCTYPE a [<!ENTITY b "c">]><mujoco>&b;</mujoco>', "defines entities"),
        ("<mujoco>" + "<body>" * 5000 + "</body>" * 5000 + "</mujoco>", "nesting is too deep"),
        ("<mujoco>" + " " * 2**24 + "</mujoco>", "more than 16,777,216"),
    ],
)
def test_models_of_robots_that_would_fill_memory_or_stack(text, told, tmp_path):
    (tmp_path / "a.xml").write_text(text)
    with pytest.raises(ParameterError, match=told):
        read_arm(tmp_path / "a.xml", "a")
