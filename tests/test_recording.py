"""Recordings: what is written returns bit for bit, and what is wrong is named by file and row."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from wrenchbed import parquet
from wrenchbed.errors import RecordingError
from wrenchbed.metadata import Metadata, SensorInfo, ToolInfo, parse
from wrenchbed.recording import Recording
from wrenchbed.writer import RecordingWriter

CHANNELS = ("fx", "fy", "fz", "tx", "ty", "tz")
METADATA = Metadata(
    robot="ur5",
    mode="static",
    source="sim",
    rate_hz=100.0,
    tool=ToolInfo(1.35, (0.004, -0.006, 0.071), (2.7e-3, 2.7e-3, 1.1e-3, 0.0, 0.0, 0.0)),
    sensor=SensorInfo("ati-gamma", (0.1,) * 6, 0.0, (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)),
    tolerance={"tool.mass": 0.007},
    gravity=(0.0, 0.0, -9.80665),
    extra={"operator": "Ada"},
)


def columns(n: int = 20) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(0)
    data = {"t": np.arange(n) / 100.0}
    data |= {f"q{j}": rng.normal(size=n) for j in range(1, 7)}
    data |= {c: rng.normal(size=n) for c in CHANNELS}
    return data | {"segment": np.arange(n) // 5, "status": np.zeros(n, dtype=np.uint32)}


def save(path: Path, data: dict[str, np.ndarray], metadata: dict | None = None) -> Path:
    raw = METADATA.to_json() if metadata is None else metadata
    parquet.write(path, parquet.table_of(data, raw))
    return path


def test_a_recording_returns_bit_for_bit(tmp_path):
    data = columns() | {"note": np.array(["x"] * 20), "humidity": np.linspace(0, 1, 20)}
    Recording(METADATA, data).write(tmp_path / "rec.parquet")
    again = Recording.read(tmp_path / "rec.parquet")
    assert again.metadata == METADATA
    assert list(again.columns) == list(data)
    assert all(np.array_equal(again.columns[k], data[k]) for k in data)
    assert again.columns["status"].dtype == np.uint32
    assert list(tmp_path.iterdir()) == [tmp_path / "rec.parquet"]


def test_a_recording_cannot_be_changed():
    recording = Recording(METADATA, columns())
    with pytest.raises(ValueError, match="read-only"):
        recording.t[0] = 1.0


@settings(max_examples=30, deadline=None)
@given(data=st.data())
def test_any_finite_numbers_survive(tmp_path_factory, data):
    n = data.draw(st.integers(1, 30))
    numbers = hnp.arrays(float, n, elements=st.floats(-1e6, 1e6))
    table = {k: data.draw(numbers) for k in ("q1", "q2", *CHANNELS)}
    steps = data.draw(hnp.arrays(float, n, elements=st.floats(1e-6, 10.0)))
    table["t"] = np.cumsum(steps)
    path = tmp_path_factory.mktemp("h") / "rec.parquet"
    Recording(METADATA, table).write(path)
    again = Recording.read(path)
    assert all(np.array_equal(again.columns[k], table[k]) for k in table)


def broken(change) -> dict[str, np.ndarray]:
    data = columns()
    change(data)
    return data


def put(name: str, row: int, value: float):
    def change(data):
        data[name] = data[name].astype(float)
        data[name][row] = value

    return change


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d.pop("fz"), "column 'fz' is missing"),
        (lambda d: d.pop("t"), "column 't' is missing"),
        (lambda d: [d.pop(f"q{j}") for j in range(1, 7)], "neither joint columns"),
        (put("ty", 7, np.nan), "column 'ty', row 7: nan is not a finite number"),
        (put("q3", 2, np.inf), "column 'q3', row 2: inf"),
        (put("humidity", 3, np.nan), "column 'humidity', row 3"),
        (put("t", 5, 0.01), "column 't', row 5: 0.01 does not come after"),
        (lambda d: d.update(t=d["t"][::-1].copy()), r"column 't', row 1: .* \(19 such rows\)"),
        (lambda d: d.update(segment=d["segment"] + 0.5), "'segment' must hold whole numbers"),
        (lambda d: d.update(fx=np.array(["a"] * 20)), "column 'fx' holds"),
        (lambda d: d.update({k: v[:0] for k, v in d.items()}), "0 rows"),
    ],
    ids=lambda x: x if isinstance(x, str) else "",
)
def test_bad_columns_are_named_with_file_and_row(tmp_path, change, words):
    data = columns() | {"humidity": np.zeros(20)}
    change(data)
    path = save(tmp_path / "rec.parquet", data)
    with pytest.raises(RecordingError, match=words) as caught:
        Recording.read(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"format": 2}, "format is 2, this version reads 1"),
        ({"robot": None}, "robot = None must be a name"),
        ({"mode": "fast"}, "mode = 'fast' must be"),
        ({"rate_hz": 0}, "rate_hz = 0 must be above 0 Hz"),
        ({"tool": {"mass": -1.0}}, "tool.mass = -1.0 must be above 0 kg"),
        ({"tool": {"mass": "1 kg"}}, "tool.mass = '1 kg' must be a number"),
        ({"tool": {"cog": [0, 0]}}, "tool.cog = .* must be 3 numbers"),
        ({"tool": {"inertia": [1, 1, 5, 0, 0, 0]}}, "tool.inertia .* not the inertia of any body"),
        ({"tool": 3}, "metadata tool is not a JSON object"),
        ({"sensor": {"noise_std": [1, 1, 1, 1, 1, -1]}}, "noise_std .* must not be negative"),
        ({"sensor": {"mass": -0.1}}, "sensor.mass = -0.1 must be at least 0"),
        ({"sensor": {"pose_flange": [0, 0, 0, 1, 1, 0, 0]}}, "unit quaternion"),
        ({"gravity": [0, 0, -9806.65]}, "gravity .* m/s²"),
        ({"gravity": [0, 0, float("inf")]}, "gravity .* finite"),
    ],
)
def test_bad_metadata_names_the_field(tmp_path, change, words):
    path = save(tmp_path / "rec.parquet", columns(), METADATA.to_json() | change)
    with pytest.raises(RecordingError, match=words):
        Recording.read(path)


def test_only_format_robot_and_mode_are_required():
    assert parse({"format": 1, "robot": "ur5", "mode": "static"}, "x").tool == ToolInfo()


def test_files_that_are_no_recordings_are_refused(tmp_path):
    path = tmp_path / "rec.parquet"
    with pytest.raises(RecordingError, match="no such file"):
        Recording.read(path)
    path.write_text("not parquet")
    with pytest.raises(RecordingError, match="not a complete Parquet file"):
        Recording.read(path)
    pq.write_table(pa.table(columns()), path)
    with pytest.raises(RecordingError, match="wrenchbed import"):
        Recording.read(path)
    pq.write_table(pa.table(columns()).replace_schema_metadata({b"wrenchbed": b"{"}), path)
    with pytest.raises(RecordingError, match="is not JSON"):
        Recording.read(path)
    table = parquet.table_of(columns(), METADATA.to_json())
    missing = table.set_column(3, "q3", pa.array([None, *([1.0] * 19)]))
    pq.write_table(missing, path)
    with pytest.raises(RecordingError, match="column 'q3', row 0: the value is missing"):
        Recording.read(path)


@settings(max_examples=40, deadline=None)
@given(share=st.floats(0.0, 0.999))
def test_a_truncated_file_is_refused_wherever_it_is_cut(tmp_path_factory, share):
    path = save(tmp_path_factory.mktemp("h") / "rec.parquet", columns())
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(RecordingError, match="not a complete Parquet file"):
        Recording.read(path)


def test_orientations_stand_in_for_joints_and_must_be_unit(tmp_path):
    data = {k: v for k, v in columns().items() if not k.startswith("q")}
    data |= dict(zip(("qw", "qx", "qy", "qz"), np.tile([1.0, 0, 0, 0], (20, 1)).T, strict=True))
    recording = Recording(METADATA, data)
    assert recording.joints == ()
    assert np.allclose(recording.rotation, np.eye(3))
    data["qw"] = data["qw"] * 2
    with pytest.raises(RecordingError, match="row 0: 2.0 is not the length of a unit quaternion"):
        Recording(METADATA, data)


def test_the_writer_leaves_one_file_and_keeps_the_old_one(tmp_path):
    path = tmp_path / "rec.parquet"
    path.write_text("precious")
    with RecordingWriter(path, METADATA) as writer:
        for start in range(0, 20, 5):
            writer.append({k: v[start : start + 5] for k, v in columns().items()})
    assert sorted(p.name for p in tmp_path.iterdir()) == ["rec.parquet", "rec.parquet~"]
    assert (tmp_path / "rec.parquet~").read_text() == "precious"
    again = Recording.read(path)
    assert all(np.array_equal(again.columns[k], v) for k, v in columns().items())


def test_an_interrupted_writer_keeps_what_it_has(tmp_path):
    path = tmp_path / "rec.parquet"
    with pytest.raises(KeyboardInterrupt), RecordingWriter(path, METADATA) as writer:
        writer.append(columns())
        raise KeyboardInterrupt
    assert len(Recording.read(path)) == 20


WRITE_FOR_EVER = """
import sys, time
import numpy as np
from wrenchbed.metadata import parse
from wrenchbed.writer import RecordingWriter
meta = parse({"format": 1, "robot": "ur5", "mode": "dynamic"}, "x")
names = ["q1", "q2", "q3", "q4", "q5", "q6", "fx", "fy", "fz", "tx", "ty", "tz"]
start = time.monotonic()
with RecordingWriter(sys.argv[1], meta) as writer:
    while True:
        t = time.monotonic() - start
        writer.append({"t": np.array([t])} | {n: np.array([t]) for n in names})
        print(t, flush=True)
        time.sleep(0.002)
"""


@pytest.mark.parametrize("seconds", [1.3, 2.2])
def test_kill_9_loses_at_most_the_last_second(tmp_path, seconds):
    path = tmp_path / "rec.parquet"
    with subprocess.Popen(
        [sys.executable, "-c", WRITE_FOR_EVER, str(path)], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        first = float(process.stdout.readline())
        last = first
        while last < first + seconds:
            last = float(process.stdout.readline())
        os.kill(process.pid, signal.SIGKILL)
        last = max([last, *(float(x) for x in process.stdout.read().split())])
    plain = pq.read_table(path)  # opens for any reader of Parquet
    with pytest.warns(UserWarning, match="did not finish"):
        recording = Recording.read(path)
    assert last - recording.t[-1] < 1.0
    assert len(recording) >= plain.num_rows > 0
    assert last - plain.column("t")[-1].as_py() < 1.0
    assert recording.metadata.mode == "dynamic"
    assert np.array_equal(recording.columns["fx"], recording.t)


def test_a_journal_cut_in_the_middle_opens_up_to_the_cut(tmp_path):
    path = tmp_path / "rec.parquet"
    with RecordingWriter(path, METADATA) as writer:
        for start in range(0, 20, 5):
            writer.append({k: v[start : start + 5] for k, v in columns().items()})
            writer.flush()
        journal = path.with_name("rec.parquet.journal")
        whole = journal.read_bytes()
    for share in (0.5, 0.7, 0.9):
        journal.write_bytes(whole[: int(share * len(whole))])
        with pytest.warns(UserWarning, match="rows come from its journal"):
            rows = len(Recording.read(path))
        assert rows in (5, 10, 15)
    journal.write_bytes(whole[:50])
    with pytest.raises(RecordingError, match="journal"):
        Recording.read(path)


def test_metadata_is_plain_json():
    assert json.loads(json.dumps(METADATA.to_json())) == METADATA.to_json()
    assert parse(METADATA.to_json(), "x") == METADATA


def killed(path: Path) -> None:
    """A file whose writer died: its journal holds 20 rows, the file itself 5."""
    writer = RecordingWriter(path, METADATA)
    writer.__enter__()
    writer.append({k: v[:5] for k, v in columns().items()})
    writer.flush()
    writer._rewrite_cost = 1e9
    writer.append({k: v[5:] for k, v in columns().items()})
    writer.flush()


def test_the_backup_of_a_killed_writer_keeps_its_journal(tmp_path):
    path = tmp_path / "rec.parquet"
    killed(path)
    with RecordingWriter(path, METADATA) as writer:
        writer.append({k: v[:3] for k, v in columns().items()})
    assert len(Recording.read(path)) == 3
    with pytest.warns(UserWarning, match="did not finish"):
        assert len(Recording.read(tmp_path / "rec.parquet~")) == 20


def test_a_stale_journal_does_not_outlive_a_newer_file(tmp_path):
    path = tmp_path / "rec.parquet"
    killed(path)
    Recording(METADATA, {k: v[:3] for k, v in columns().items()}).write(path)
    assert len(Recording.read(path)) == 3
    assert (tmp_path / "rec.parquet.journal~").exists()


def test_folders_are_no_recordings(tmp_path):
    with pytest.raises(RecordingError, match="is a folder"):
        Recording.read(tmp_path)
    with pytest.raises(RecordingError, match="is a folder"), RecordingWriter(tmp_path, METADATA):
        pass
    assert tmp_path.is_dir()
