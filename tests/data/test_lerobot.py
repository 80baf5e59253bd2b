"""Data sets of LeRobot, written here as its format 3.0 says."""

import json
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from pytest import approx

from servo_arm import JOINTS, RANGES, Servos, feature, lerobot
from servo_arm import recording as servos_recording
from wrenchbed.cli import main
from wrenchbed.data.recording import Recording
from wrenchbed.errors import MapError
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.robots.described import describe

RNG = np.random.default_rng(0)
Q, TARGET = RNG.uniform(-0.2, 1.5, (2, 70, 6))
EPISODE = np.repeat([0, 1, 2], [30, 25, 15])
LOW, HIGH = np.array(RANGES).T
MAP = """
[recording]
robot = "so.toml"
mode = "dynamic"
[lerobot]
"""


def data_set(folder, scale=np.rad2deg, names=None, more=(), **features):
    return lerobot(folder, scale(Q), scale(TARGET), EPISODE, names, more=more, **features)


@pytest.fixture
def here(tmp_path):
    (tmp_path / "so.xml").write_text(Servos().xml(), encoding="utf-8")
    describe(tmp_path / "so.xml", "tip", tmp_path / "so.toml")
    return tmp_path


def imported(here, text, folder="set"):
    (here / "map.toml").write_text(MAP + text, encoding="utf-8")
    out = here / "rec.parquet"
    words = ["import", here / folder, "--map", here / "map.toml", "--out", out, "--force"]
    return main([str(w) for w in words]), out


def read(path):
    recording = Recording.read(path)
    columns = recording.columns
    target = np.stack([columns[f"q_target{j + 1}"] for j in range(6)], axis=1)
    return recording, target


def test_degrees_become_radians_and_episodes_segments(here, capsys):
    data_set(here / "set")
    assert imported(here, 'unit = "deg"')[0] == 0
    assert "3 episodes as segments" in capsys.readouterr().out
    recording, target = read(here / "rec.parquet")
    assert recording.q == approx(Q, abs=1e-6) and target == approx(TARGET, abs=1e-6)
    assert np.array_equal(recording.columns["segment"], EPISODE)
    step = np.diff(recording.t)
    assert step[np.diff(EPISODE) == 0] == approx(1.0 / 30.0, rel=1e-4)
    assert step[np.diff(EPISODE) != 0] == approx(1.0)


def test_normalised_values_need_the_ends_of_their_ranges(here, capsys):
    ends = [[-100, 100]] * 5 + [[0, 100]]
    begin, end = np.array(ends).T
    data_set(here / "set", lambda q: begin + (q - LOW) / (HIGH - LOW) * (end - begin))
    assert imported(here, 'unit = "normalised"')[0] == 1
    assert "lerobot.range" in capsys.readouterr().err
    text = f'unit = "normalised"\nrange = {json.dumps(RANGES)}\nends = {ends}'
    assert imported(here, text)[0] == 0
    recording, target = read(here / "rec.parquet")
    assert recording.q == approx(Q, abs=1e-6) and target == approx(TARGET, abs=1e-6)


def test_a_unit_is_never_guessed(here, capsys):
    data_set(here / "set")
    for text in ("", 'unit = "turns"'):
        assert imported(here, text)[0] == 1
        error = capsys.readouterr().err
        assert "lerobot.unit" in error and "deg" in error and error.count("\n") == 1
    for words in (["--guess"], []):
        assert main(["import", str(here / "set"), *words, "--out", str(here / "x.parquet")]) == 1
        assert "[lerobot] unit" in capsys.readouterr().err


def test_joints_are_found_by_their_names_or_stated(here, capsys):
    turned = [f"main_{j}" for j in reversed(JOINTS)]
    data_set(here / "old", lambda q: np.rad2deg(q[:, ::-1]), {"motors": turned})
    assert imported(here, 'unit = "deg"', "old")[0] == 0
    assert read(here / "rec.parquet")[0].q == approx(Q, abs=1e-6)
    names = [f"motor_{k}" for k in range(6)]
    data_set(here / "set", lambda q: 10.0 + np.rad2deg(q) * [1, -1, 1, 1, 1, 1], names)
    capsys.readouterr()
    assert imported(here, 'unit = "deg"')[0] == 1
    assert "motor_0" in (error := capsys.readouterr().err) and "joints" in error
    text = f'unit = "deg"\njoints = {names}\nzero = [10,10,10,10,10,10]\nsign = [1,-1,1,1,1,1]'
    assert imported(here, text)[0] == 0
    assert read(here / "rec.parquet")[0].q == approx(Q, abs=1e-6)


def test_efforts_and_wrenches_need_their_units_too(here, capsys):
    tau, wrench = RNG.normal(size=(2, 70, 6)).astype(np.float32)
    more = {"observation.effort": pa.array(list(tau)), "observation.wrench": pa.array(list(wrench))}
    names = {"observation.effort": feature([f"{j}.effort" for j in JOINTS]),
             "observation.wrench": feature(["fx", "fy", "fz", "tx", "ty", "tz"])}  # fmt: skip
    data_set(here / "set", more=more, **names)
    assert imported(here, 'unit = "deg"')[0] == 0
    assert "observation.effort is left out" in capsys.readouterr().out
    assert imported(here, 'unit = "deg"\neffort = "mA"\nwrench = "N, N·m"')[0] == 0
    recording = Recording.read(here / "rec.parquet")
    assert recording.wrench == approx(wrench)
    assert recording.columns["i3"] == approx(1e-3 * tau[:, 2])


FIRST = "data/chunk-000/file-000.parquet"
WRONG = {
    "observation.state": lambda folder: change(folder, "observation.state", "state"),
    "has no elbow_flex": lambda folder: change(folder, "elbow_flex", "other"),  # of the action
    "no Parquet": lambda folder: [file.unlink() for file in folder.rglob("*.parquet")],
    "cannot be read": lambda folder: (folder / FIRST).write_bytes(b"PAR1"),
    "timestamp": lambda folder: pq.write_table(
        pq.read_table(folder / FIRST).drop_columns(["timestamp"]), folder / FIRST
    ),
}


def change(folder, old, new):
    info = folder / "meta/info.json"
    info.write_text(info.read_text(encoding="utf-8").replace(old, new, 1), encoding="utf-8")


@pytest.mark.parametrize("why", WRONG)
def test_what_is_wrong_is_named(here, why, capsys):
    WRONG[why](data_set(here / "set"))
    assert imported(here, 'unit = "deg"')[0] == 1
    error = capsys.readouterr().err
    assert why in error and error.count("\n") == 1 and MapError.__name__ not in error


def written(here, *options, steps=1.0 / 30.0, segment=EPISODE):
    """Exit code of `export` of a motion with joint targets to the folder ``out``; its columns."""
    motion = servos_recording(Q, TARGET, robot=str(here / "so.toml"), segment=segment)
    wrench = dict(zip(CHANNELS, RNG.normal(size=(6, 70)), strict=True))
    columns = {**motion.columns, **wrench, "t": 5.0 + np.cumsum(np.full(70, steps))}
    replace(motion, columns=columns).write(here / "rec.parquet")
    words = ["export", here / "rec.parquet", "--to", "lerobot", "--out", here / "out", *options]
    return main([str(w) for w in words]), columns


def test_a_recording_becomes_what_lerobot_writes_itself_and_comes_back(here):
    code, columns = written(here, "--task", "Push")
    (here / "so.toml").unlink()  # the data set knows its robot
    words = ["import", here / "out", "--out", here / "again.parquet"]
    assert code == 0 and main([str(w) for w in words]) == 0
    again = Recording.read(here / "again.parquet").columns
    for name in ("q1", "q6", "q_target2", "fy", "tz", "segment"):
        assert again[name] == approx(columns[name], abs=1e-6)
    info = json.loads((here / "out/meta/info.json").read_text(encoding="utf-8"))
    assert (info["fps"], info["total_frames"], info["splits"]) == (30, 70, {"train": "0:3"})
    assert info["features"]["action"] == feature([f"{j}.pos" for j in JOINTS])
    data = pq.read_table(here / "out" / FIRST)
    assert set(data.column_names) == set(info["features"])
    assert data.schema.field("action").type == pa.list_(pa.float32(), 6)
    assert data["index"].to_pylist() == list(range(70))
    assert data["timestamp"].to_numpy()[[29, 30, 31]] == approx([29 / 30, 0.0, 1 / 30])
    episodes = pq.read_table(here / "out" / FIRST.replace("data", "meta/episodes"))
    assert episodes["dataset_from_index"].to_pylist() == [0, 30, 55]
    assert episodes["dataset_to_index"].to_pylist() == [30, 55, 70]
    mean = [TARGET[k == EPISODE].mean(axis=0) for k in range(3)]
    assert np.allclose(episodes["stats/action/mean"].to_pylist(), mean)
    tasks = pq.read_table(here / "out/meta/tasks.parquet")
    assert tasks.to_pydict() == {"task_index": [0], "task": ["Push"]}
    assert json.loads(tasks.schema.metadata[b"pandas"])["index_columns"] == ["task"]


def test_an_uneven_clock_is_written_only_at_a_stated_rate(here, capsys):
    steps = np.where(np.arange(70) % 2, 0.02, 0.03)
    assert written(here, steps=steps, segment=None)[0] == 1
    assert "--fps 40" in capsys.readouterr().err and not (here / "out/meta").exists()
    code, columns = written(here, "--fps", "20", steps=steps, segment=None)
    data = pq.read_table(here / "out" / FIRST)
    t = columns["t"][0] + np.arange(len(data)) / 20.0
    force = np.array(data["observation.wrench"].to_pylist())[:, 2]
    assert code == 0 and 0.0 <= columns["t"][-1] - t[-1] < 0.05
    assert force == approx(np.interp(t, columns["t"], columns["fz"]), abs=1e-5)
    assert written(here)[0] == 1 and "holds files already" in capsys.readouterr().err
