"""Imports: units, clocks, orientations, and every mistake in a map named."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import ntnu
from wrenchbed.cli import main
from wrenchbed.data import column_map
from wrenchbed.data.import_files import import_files
from wrenchbed.data.plan import Plan, is_plan
from wrenchbed.data.recording import TARGET, Recording
from wrenchbed.errors import MapError, PlanError

CHANNELS = ("fx", "fy", "fz", "tx", "ty", "tz")


def basic(**changes):
    columns = {c: {"column": c.upper(), "unit": "N" if c[0] == "f" else "N·m"} for c in CHANNELS}
    columns |= {f"q{j}": {"column": f"J{j}", "unit": "deg"} for j in range(1, 7)}
    columns |= {"t": {"column": "time", "unit": "ms"}}
    columns |= changes
    entry = {"match": "*.csv", "columns": {k: v for k, v in columns.items() if v is not None}}
    return {"recording": {"robot": "ur5", "mode": "static"}, "file": [entry]}


def write_map(folder: Path, raw) -> Path:
    path = folder / "map.json"
    path.write_text(json.dumps(raw))
    return path


def write_csv(folder: Path, n=4, name="data.csv", **changes) -> Path:
    data = {"time": [str(10 * i) for i in range(n)]}
    data |= {c.upper(): [f"{i + k}.5" for i in range(n)] for k, c in enumerate(CHANNELS)}
    data |= {f"J{j}": ["90" for _ in range(n)] for j in range(1, 7)} | changes
    rows = [",".join(data)] + [",".join(v[i] for v in data.values()) for i in range(n)]
    path = folder / name
    path.write_text("\n".join(rows) + "\n")
    return path


def load(folder: Path, raw, **changes):
    return import_files([write_csv(folder, **changes)], column_map.read(write_map(folder, raw)))


def test_units_are_converted_to_si(tmp_path):
    raw = basic(
        tx={"column": "TX", "unit": "Nmm"}, ty={"column": "TY", "unit": "Nmm"},
        tz={"column": "TZ", "unit": "Nmm"}, fz={"column": "FZ", "unit": "N", "sign": -1},
    )  # fmt: skip
    raw["recording"]["configured"] = {"drive.constant": [12.0] * 6}
    recording = load(tmp_path, raw).recording
    assert recording.metadata.extra["configured"] == {"drive.constant": [12.0] * 6}
    assert np.allclose(recording.t, [0, 0.01, 0.02, 0.03])
    assert np.allclose(recording.q, np.pi / 2)
    assert np.allclose(recording.wrench[0], [0.5, 1.5, -2.5, 3.5e-3, 4.5e-3, 5.5e-3])


def test_places_of_a_trackers_target_need_no_wrench(tmp_path):
    raw = basic(**dict.fromkeys(CHANNELS))
    raw["file"][0]["columns"] |= {
        c: {"column": k, "unit": "mm"} for c, k in zip(TARGET, "XYZ", strict=True)
    }
    places = {k: ["12.5", "13", "14", "15"] for k in "XYZ"}
    recording = load(tmp_path, raw, **places).recording
    assert np.allclose(recording.columns["mx"], [0.0125, 0.013, 0.014, 0.015])
    del raw["file"][0]["columns"]["mz"]
    with pytest.raises(MapError, match="no column is mapped to fx"):
        load(tmp_path, raw, **places)


@pytest.mark.parametrize(
    ("raw", "words"),
    [
        ({"recording": {"robot": "ur5", "mode": "static"}}, r"at least one \[\[file\]\]"),
        ({"recordings": {}}, "there is no field recordings"),
        (basic() | {"recording": {"mode": "static"}}, "robot is missing: it must be a name"),
        (basic() | {"recording": {"robot": "ur5", "mode": "static", "tool": {"mass": -1}}},
         "tool.mass = -1 must be above 0"),
        (basic(fx={"column": "FX"}), "fx states no unit; one of N, kN, lbf"),
        (basic(fx={"column": "FX", "unit": "Nm"}), "fx in 'Nm' is no unit of force"),
        (basic(fx={"column": "FX", "unit": "lbf"}), "mixed units: fx in lbf, fy in N, fz in N"),
        (basic(fx={"unit": "N"}), "fx needs a table with column"),
        (basic(fx={"column": "FX", "unit": "N", "sign": 2}), "sign = 2 must be 1 or -1"),
        (basic(fx=None), "no column is mapped to fx"),
        (basic(force={"column": "FX", "unit": "N"}), "'force' is no column of a recording"),
        (basic(r11={"column": "R11"}), "needs all of r11…r33, found 1"),
    ],
)  # fmt: skip
def test_a_wrong_map_names_the_entry(tmp_path, raw, words):
    with pytest.raises(MapError, match=words):
        column_map.read(write_map(tmp_path, raw))


@pytest.mark.parametrize(
    ("raw", "changes", "words"),
    [
        (basic(fx={"column": "Fx", "unit": "N"}), {}, "column 'Fx' is missing; found time, FX"),
        (basic(), {"FX": ["1", "x", "2", "3"]}, "column 'FX', row 1: 'x' is no number"),
        (basic(), {"FX": ["1", "", "2", "3"]}, "column 'FX', row 1: the value is missing"),
        (basic(), {"time": ["0", "20", "10", "30"]}, "'time', row 2: the clock does not advance"),
        (basic(), {"n": 0}, "0 rows"),
        (basic() | {"file": [basic()["file"][0] | {"match": "x.csv"}]}, {}, "must fit one of"),
    ],
    ids=lambda x: x if isinstance(x, str) else "",
)
def test_a_wrong_file_names_column_and_row(tmp_path, raw, changes, words):
    with pytest.raises(MapError, match=words):
        load(tmp_path, raw, **changes)


def test_files_columns_and_clocks_that_do_not_fit_the_map_are_named(tmp_path):
    path = write_csv(tmp_path)
    lines = path.read_text().splitlines()
    path.write_text("\n".join([lines[0] + ",FX", *(line + ",1" for line in lines[1:])]))
    with pytest.raises(MapError, match="column 'FX' appears twice"):
        import_files([path], column_map.read(write_map(tmp_path, basic())))
    good = column_map.read(write_map(tmp_path, basic()))
    with pytest.raises(MapError, match="no such file"):
        import_files([tmp_path / "none.csv"], good)
    extra = [write_csv(tmp_path), tmp_path / "notes.txt"]
    with pytest.raises(MapError, match=r"notes.txt: no \[\[file\]\]"):
        import_files(extra, good)
    raw = basic(t={"column": "time", "unit": "s"})
    with pytest.raises(MapError, match="column 'time': .* s is no time: give the unit"):
        load(tmp_path, raw, time=["1.7e12", "1.8e12", "1.9e12", "2.0e12"])


def two_files(folder: Path, step_us: int):
    """A wrench at 1 kHz and an orientation on its own slower clock, epoch times in µs."""
    start = 1_708_857_503_929_545
    clock = start + 1000 * np.arange(400)
    other = start - 5000 + step_us * np.arange(int(500_000 / step_us))
    wrench = ["t,fx,fy,fz,tx,ty,tz"] + [f"{c},1,2,3,4,5,6" for c in clock]
    angle = (other - start) * 1e-6
    turns = Rotation.from_rotvec(np.outer(angle, [0.0, 1.0, 0.0])).as_matrix().reshape(-1, 9)
    names = [f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)]
    lines = ["t," + ",".join(names)]
    lines += [f"{c}," + ",".join(f"{x:.12g}" for x in r) for c, r in zip(other, turns, strict=True)]
    (folder / "w.csv").write_text("\n".join(wrench))
    (folder / "o.csv").write_text("\n".join(lines))
    clock_entry = {"t": {"column": "t", "unit": "us"}}
    first = {c: {"column": c, "unit": "N" if c[0] == "f" else "Nm"} for c in CHANNELS}
    raw = {
        "recording": {"robot": "kuka", "mode": "dynamic", "rate_hz": 1000.0},
        "file": [
            {"match": "w.csv", "columns": first | clock_entry},
            {"match": "o.csv", "columns": {n: {"column": n} for n in names} | clock_entry},
        ],
    }
    return [folder / "w.csv", folder / "o.csv"], column_map.read(write_map(folder, raw))


@settings(max_examples=10, deadline=None)
@given(step=st.integers(2000, 40_000))
def test_orientations_are_merged_along_the_shortest_turn(tmp_path_factory, step):
    files, mapping = two_files(tmp_path_factory.mktemp("h"), step)
    imported = import_files(files, mapping)
    recording = imported.recording
    assert len(recording) + imported.left_out == 400
    wanted = Rotation.from_rotvec(np.outer(recording.t, [0.0, 1.0, 0.0])).as_matrix()
    assert np.abs(recording.rotation - wanted).max() < 1e-9
    assert np.allclose(np.diff(recording.t), 1e-3, atol=1e-12)


def test_real_static_poses_come_in():
    recording = ntnu.static()
    assert len(recording) == 24
    assert recording.metadata.robot == "kuka-lbr-med14"
    assert recording.metadata.gravity == (0.0, 0.0, -9.82085)
    # the file states gravity in sensor axes beside the orientation: they must agree
    raw = np.genfromtxt(ntnu.DATA / "0-calibration_fts-accel.csv", delimiter=",", names=True)
    stated = np.stack([raw["gx"], raw["gy"], raw["gz"]], axis=-1)
    seen = np.array(recording.metadata.gravity) @ recording.rotation
    assert np.abs(seen - stated).max() < 0.01
    # the accelerometer's axes are turned into the sensor's: at rest it reads minus gravity
    assert np.allclose(recording.columns["ay"], raw["az"] * 9.80665)
    read = np.stack([recording.columns[a] for a in ("ax", "ay", "az")], axis=-1)
    assert np.abs(read + seen).max() < 1.0


def torques_at_rest(folder, mode, rows=300, every=0.01):
    """A log of joints and their torques that step on by little, or rest, and its map."""
    q = np.linspace(0.0, 1.0, rows)[:, None] * np.ones(6)
    if mode == "auto":
        q = np.repeat(np.arange(rows // 100), 100)[:, None] * np.ones(6)
    names = ["t", *(f"q{j}" for j in range(1, 7)), *(f"tau{j}" for j in range(1, 7))]
    rows_of_log = np.hstack([np.arange(rows)[:, None] * every, q, np.cos(q)])
    lines = [",".join(names), *(",".join(map(repr, row)) for row in rows_of_log.tolist())]
    (folder / "log.csv").write_text("\n".join(lines) + "\n")
    unit = {"t": "s", "q": "rad", "tau": "N·m"}
    columns = {n: {"column": n, "unit": unit[n.rstrip("123456")]} for n in names}
    write_map(folder, {"recording": {"robot": "ur5", "mode": mode}, "file": [{"columns": columns}]})
    files = [str(folder / "log.csv"), "--map", str(folder / "map.json")]
    return ["import", *files, "--out", str(folder / "rec.parquet")]


def test_torques_without_a_wrench_come_in_and_may_be_imported_again(tmp_path, capsys):
    line = torques_at_rest(tmp_path, "static")
    assert main(line) == 1  # each row is near the one before
    assert "300 poses in 300 rows: this is a log in motion" in capsys.readouterr().err
    assert main(torques_at_rest(tmp_path, "static", every=5.0)) == 0  # there was time to rest
    assert main([*line, "--mode", "dynamic", "--force"]) == 0
    out = tmp_path / "rec.parquet"
    assert not is_plan(out)
    with pytest.raises(PlanError, match=r"this is a recording .*, not a plan"):
        Plan.read(out)
    assert main([*line, "--mode", "dynamic"]) == 1
    assert "is a recording already" in capsys.readouterr().err
    assert main([*line, "--mode", "dynamic", "--force"]) == 0


def test_a_log_of_torques_is_split_into_holds(tmp_path):
    assert main(torques_at_rest(tmp_path, "auto")) == 0
    rest = Recording.read(tmp_path / "rec.parquet")
    assert rest.effort == "tau" and set(rest.columns["segment"]) == {0, 1, 2}
