"""Data sets of LeRobot, written here as its format 3.0 says."""

import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from pytest import approx

from servo_arm import JOINTS, RANGES, Servos, feature, lerobot
from wrenchbed.cli import main
from wrenchbed.data.recording import Recording
from wrenchbed.errors import MapError
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
    assert recording.wrench == approx(wrench) and recording.columns["i3"] == approx(
        1e-3 * tau[:, 2]
    )


@pytest.mark.parametrize(
    ("wrong", "why"),
    [
        ("info", "observation.state"), ("none", "no Parquet"), ("broken", "cannot be read"),
        ("column", "timestamp"), ("action", "has no elbow_flex"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(here, wrong, why, capsys):
    folder = data_set(here / "set")
    file = folder / "data" / "chunk-000" / "file-000.parquet"
    info = folder / "meta" / "info.json"
    if wrong == "info":
        info.write_text(json.dumps({"features": {"action": feature(["a"])}}), encoding="utf-8")
    elif wrong == "action":
        raw = json.loads(info.read_text(encoding="utf-8"))
        raw["features"]["action"]["names"][2] = "other"
        info.write_text(json.dumps(raw), encoding="utf-8")
    elif wrong == "none":
        for f in file.parent.iterdir():
            f.unlink()
    elif wrong == "broken":
        file.write_bytes(b"PAR1")
    else:
        pq.write_table(pq.read_table(file).drop_columns(["timestamp"]), file)
    assert imported(here, 'unit = "deg"')[0] == 1
    error = capsys.readouterr().err
    assert why in error and error.count("\n") == 1 and MapError.__name__ not in error
