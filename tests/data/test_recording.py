"""Recordings return bit for bit; what is wrong in them or in JSON is named by file and field."""

import subprocess
import sys

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from recorded import METADATA, columns, save
from wrenchbed.data import parquet
from wrenchbed.data.metadata import ToolInfo, parse
from wrenchbed.data.recording import Recording
from wrenchbed.data.writer import RecordingWriter
from wrenchbed.errors import MapError, RecordingError, TwinError
from wrenchbed.files.checked import Fields, load


def test_a_recording_returns_bit_for_bit_and_needs_three_fields(tmp_path):
    odd = np.array([0.0, -0.0, 5e-324, 1 / 3, -1e29] * 4)
    data = columns() | {"note": np.array(["x"] * 20), "fx": odd, "humidity": odd}
    Recording(METADATA, data).write(tmp_path / "rec.parquet")
    again = Recording.read(tmp_path / "rec.parquet")
    assert again.metadata == METADATA
    assert list(again.columns) == list(data)
    assert all(np.array_equal(again.columns[k], data[k]) for k in data)
    assert again.columns["status"].dtype == np.uint32
    assert list(tmp_path.iterdir()) == [tmp_path / "rec.parquet"]
    assert parse({"format": 1, "robot": "ur5", "mode": "static"}, "x").tool == ToolInfo()


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
        (put("fx", 4, 1e200), "column 'fx', row 4: 1e[+]200 is larger than any reading"),
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
    path = save(tmp_path / "rec.parquet", data, METADATA.to_json())
    with pytest.raises(RecordingError, match=words) as caught:
        Recording.read(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_column_whose_name_is_no_text_is_refused():
    written = pa.schema([("humidity", pa.float64())]).serialize().to_pybytes()
    schema = pa.ipc.read_schema(pa.py_buffer(written.replace(b"humidity", b"\xffumidity")))
    with pytest.raises(RecordingError, match="x: the name of a column is not UTF-8 text"):
        parquet.columns(schema.empty_table(), "x", RecordingError)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"format": 2}, "format is 2, this version reads 1"),
        ({"robot": None}, "robot = None must be a name"),
        ({"mode": "fast"}, "mode = 'fast' must be"),
        ({"rate_hz": 0}, "rate_hz = 0 must be above 0 Hz"),
        ({"tool": {"mass": -1.0}}, "tool.mass = -1.0 must be above 0 kg"),
        ({"tool": {"mass": "1 kg"}}, "tool.mass = '1 kg' must be a number"),
        ({"tool": {"cog": [0, 0]}}, "tool.cog = .* must be 3 finite numbers"),
        ({"tool": {"inertia": [1, 1, 5, 0, 0, 0]}}, "tool.inertia .* not the inertia of any body"),
        ({"tool": 3}, "metadata tool is not an object with fields"),
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


def test_files_that_are_no_recordings_are_refused(tmp_path):
    path = tmp_path / "rec.parquet"
    with pytest.raises(RecordingError, match="no such file"):
        Recording.read(path)
    path.write_text("not parquet")
    with pytest.raises(RecordingError, match="not a complete Parquet file .*wrenchbed import"):
        Recording.read(path)
    pq.write_table(pa.table(columns()), path)
    with pytest.raises(RecordingError, match="wrenchbed import"):
        Recording.read(path)
    pq.write_table(pa.table(columns()).replace_schema_metadata({b"wrenchbed": b"{"}), path)
    with pytest.raises(RecordingError, match="key 'wrenchbed': not valid JSON"):
        Recording.read(path)
    table = parquet.table_of(columns(), METADATA.to_json())
    missing = table.set_column(3, "q3", pa.array([None, *([1.0] * 19)]))
    pq.write_table(missing, path)
    with pytest.raises(RecordingError, match="column 'q3', row 0: the value is missing"):
        Recording.read(path)


def test_a_file_that_is_unpacked_in_parts_is_the_same(tmp_path, monkeypatch):
    data = columns() | {"note": np.array(["x"] * 20), "small": np.arange(20, dtype=np.float32)}
    path = save(tmp_path / "rec.parquet", data, METADATA.to_json())
    whole = Recording.read(path).columns
    monkeypatch.setattr(parquet, "ROWS_AT_ONCE", 7)
    again = Recording.read(path)
    assert list(again.columns) == list(whole)
    for name, column in again.columns.items():
        assert column.dtype == whole[name].dtype and np.array_equal(column, whole[name])
        assert not column.flags.writeable
    assert np.array_equal(np.concatenate(list(again.parts_of_q())), again.q)
    values = [*([1.0] * 16), None, *([1.0] * 3)]
    table = parquet.table_of(data, METADATA.to_json()).set_column(3, "q3", pa.array(values))
    pq.write_table(table, path)
    with pytest.raises(RecordingError, match="column 'q3', row 16: the value is missing"):
        Recording.read(path)


@pytest.mark.slow
def test_a_large_file_is_never_in_memory_twice(tmp_path):
    rows = 2_000_000
    noise = np.random.default_rng(0).standard_normal(rows)
    path = save(tmp_path / "rec.parquet", dict.fromkeys(columns(), noise), METADATA.to_json())
    code = f"""
import resource
from pathlib import Path
from wrenchbed.data import parquet
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
read, _ = parquet.read(Path({str(path)!r}), ValueError)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert 1024 * int(done.stdout) < 1.4 * 8 * rows * len(columns())


def test_orientations_stand_in_for_joints_and_folders_for_no_recording(tmp_path):
    data = {k: v for k, v in columns().items() if not k.startswith("q")}
    data |= dict(zip(("qw", "qx", "qy", "qz"), np.tile([1.0, 0, 0, 0], (20, 1)).T, strict=True))
    recording = Recording(METADATA, data)
    assert recording.joints == ()
    assert np.allclose(recording.rotation, np.eye(3))
    data["qw"] = data["qw"] * 2
    with pytest.raises(RecordingError, match="row 0: 2.0 is not the length of a unit quaternion"):
        Recording(METADATA, data)
    with pytest.raises(RecordingError, match="is a folder"):
        Recording.read(tmp_path)
    with pytest.raises(RecordingError, match="is a folder"), RecordingWriter(tmp_path, METADATA):
        pass
    assert tmp_path.is_dir()


def fields(**raw):
    return Fields(raw, "a.json: ", MapError)


@pytest.mark.parametrize(
    ("read", "message"),
    [
        (lambda: fields(x=True).number("x", "kg"), "x = True must be a number"),
        (lambda: fields(x=float("nan")).number("x", "s"), "x = nan must be a number"),
        (lambda: fields(x=10**400).number("x", "s"), "must be a number [s]"),
        (lambda: fields(x=[1, "2"]).numbers("x", 2), "must be 2 finite numbers"),
        (lambda: fields().stated_text("x"), "x is missing: it must be a text"),
        (lambda: fields(x=3).text("x"), "x = 3 must be a name"),
        (lambda: fields(x="c").choice("x", ("a", "b"), "must be a or b"), "x = 'c' must be a or b"),
        (lambda: fields(x={"y": 0}).part("x").text("y"), "x.y = 0 must be a name"),
        (lambda: fields(x=[{}, 1]).parts("x"), "x[1] is not an object with fields"),
        (lambda: fields(x=1).only(("b", "a"), "a map"), "there is no field x; a map has a, b"),
        (lambda: Fields([], "a.json: ", MapError), "a.json: the file is not an object with fields"),
    ],
)
def test_a_wrong_field_is_named_with_its_rule(read, message):
    with pytest.raises(MapError) as error:
        read()
    assert message in str(error.value)


def test_errors_name_field_file_and_kind(tmp_path):
    with pytest.raises(MapError, match="a.json: x: other"), fields().naming("x"):
        raise TwinError("other")
    with pytest.raises(TwinError, match="there is no such file"):
        load(tmp_path / "a.json", TwinError)
    with pytest.raises(TwinError, match="is a folder; give a JSON file"):
        load(tmp_path, TwinError)
    (tmp_path / "rec.json").write_bytes(b"PAR1\x80\x00PAR1")
    with pytest.raises(TwinError, match=r"rec\.json: is Parquet, such as recordings"):
        load(tmp_path / "rec.json", TwinError)
    for name, text in (("a.json", "{"), ("a.json", "[" * 100_000), ("a.toml", "[")):
        (tmp_path / name).write_text(text)
        with pytest.raises(MapError, match=f"{name}: not valid {name[2:].upper()}"):
            load(tmp_path / name, MapError, "TOML")
