"""Rosbags 1 and 2, MCAP and UR's own recordings come in as they are; a recording goes back out."""

import json
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.rosbag2 import StoragePlugin
from rosbags.typesys import Stores, get_typestore

import wrenchbed as wb
from json_logs import json_log
from robot_logs import COUNT, LOAD, START, TURN, Q, bag1, bag2, messages, plain, stamps
from simulated import driven
from wrenchbed.cli import main
from wrenchbed.data.import_files import import_files
from wrenchbed.data.rosbag_and_mcap import MessageRows, table
from wrenchbed.errors import MapError


def bag2_mcap(path: Path) -> Path:
    return bag2(path, StoragePlugin.MCAP)


def mcap_json(path: Path) -> Path:
    store = get_typestore(Stores.ROS2_HUMBLE)
    log = ((topic, plain(message), at) for topic, _, message, at in messages(store))
    return json_log(path / "log.mcap", log)


LOGS = {"rosbag 1": bag1, "rosbag 2": bag2, "rosbag 2 in MCAP": bag2_mcap,
        "MCAP of ROS 2": lambda path: next(bag2_mcap(path).glob("*.mcap")),
        "MCAP of JSON": mcap_json}  # fmt: skip


@pytest.mark.parametrize("make", LOGS.values(), ids=LOGS)
def test_a_robots_log_comes_in_bit_for_bit_and_what_is_not_there_is_named(make, tmp_path):
    log = make(tmp_path)
    found = import_files([log], wb.read_map("ros-ur5")).recording
    assert np.array_equal(found.wrench, LOAD)
    assert np.array_equal(found.q, Q)
    assert np.array_equal(found.t, (stamps() - START) / 1e9)
    assert found.metadata.robot == "ur5" and found.metadata.mode == "dynamic"
    found = import_files([log], wb.read_map("ros-oriented")).recording
    unit = TURN / np.linalg.norm(TURN)
    turned = np.stack([found.columns[c] for c in ("qw", "qx", "qy", "qz")], axis=1)
    assert np.allclose(np.abs(turned @ unit), 1.0, atol=1e-12)
    assert np.allclose(found.columns["az"], -9.8) and np.allclose(found.columns["ax"], -0.1)
    assert np.allclose(found.columns["temperature"], 20.0 + np.arange(COUNT) / 10)
    with pytest.raises(MapError, match=r"no topic '/ft'; it holds .*/wrench \("):
        table(log, "/ft", ["wrench.force.x"])
    with pytest.raises(MapError, match=r"message 1: has no 'wrench\.force\.w'"):
        table(log, "/wrench", ["wrench.force.w"])
    with pytest.raises(MapError, match="name one with topic"):
        table(log, None, ["wrench.force.x"])


@pytest.mark.parametrize("name", ["a.bag", "a.mcap", "a.db3"])
def test_files_of_another_kind_are_refused(tmp_path, name):
    with pytest.raises(MapError, match="there is no such file"):
        table(tmp_path / name, "/wrench", ["x"])
    (tmp_path / name).write_bytes(b"nothing of the kind" * 9)
    with pytest.raises(MapError, match="that can be read"):
        table(tmp_path / name, "/wrench", ["x"])


def test_the_clients_of_universal_robots_write_files_that_come_in(tmp_path):
    parts = ("target_q", "actual_q", "ft_raw_wrench")
    names = ["timestamp", *(f"{part}_{k}" for part in parts for k in range(6))]
    rows = np.column_stack([np.arange(COUNT) / 125 + 77.5, Q, Q, LOAD])
    for name, mark in (("ur-rtde", ","), ("ur-client", " ")):
        lines = [mark.join(names), *(mark.join(map(repr, row.tolist())) for row in rows)]
        (tmp_path / f"{name}.csv").write_text("\n".join(lines) + "\n")
        found = import_files([tmp_path / f"{name}.csv"], wb.read_map(name)).recording
        assert np.array_equal(found.wrench, LOAD) and np.array_equal(found.q, Q)
        assert np.allclose(found.t, np.arange(COUNT) / 125, atol=1e-12)


def test_a_recording_goes_out_as_mcap_and_comes_back(tmp_path, capsys):
    robot = wb.load("robots", "ur5")
    driven(wb.multisine(robot, 6.0, 50.0, 1), tmp_path / "rec.parquet", seed=1)
    assert main(["export", str(tmp_path / "rec.parquet"), "--mcap", str(tmp_path / "r.mcap")]) == 0
    out = ["--map", "ros-ur5", "--out", str(tmp_path / "back.parquet")]
    assert main(["import", str(tmp_path / "r.mcap"), *out]) == 0
    there, back = (wb.Recording.read(tmp_path / f"{n}.parquet") for n in ("rec", "back"))
    assert np.array_equal(there.wrench, back.wrench) and np.array_equal(there.q, back.q)
    assert np.abs(there.t - there.t[0] - back.t).max() < 1e-9
    with (tmp_path / "r.mcap").open("rb") as stream:
        (kept,) = make_reader(stream).iter_metadata()
    assert json.loads(kept.metadata["json"]) == there.metadata.to_json()
    assert main(["export", str(tmp_path / "rec.parquet")]) == 1
    assert "--mcap for a recording" in capsys.readouterr().err


def test_messages_are_reached_by_path_publisher_and_time_of_logging(tmp_path):
    rows = MessageRows(["a.1", "position.my.joint", "logged"])
    rows.add({"a": [1, 2.5], "name": ["x", "my.joint"], "position": [7.0, 8.0]}, 42)
    assert rows.table().to_pylist() == [{"a.1": 2.5, "position.my.joint": 8.0, "logged": 42}]
    assert not rows.missing
    assert not rows.add({"name": ["gripper"], "position": [7.0]}, 43) and rows.skipped == 1
    rows.add({"a": [1], "name": ["my.joint"], "position": []}, 44)
    assert rows.missing == {"a.1", "position.my.joint"}
    states = [{"name": ["gripper" if k % 3 else "elbow"], "position": [float(k)]} for k in range(6)]
    json_log(tmp_path / "a.mcap", (("/joint_states", s, k) for k, s in enumerate(states)))
    with pytest.warns(wb.errors.WrenchbedWarning, match="4 of 6 messages .* another publisher's"):
        found = table(tmp_path / "a.mcap", "/joint_states", ["position.elbow"])
    assert found["position.elbow"].to_pylist() == [0.0, 3.0]
    nothing = {"header": {"stamp": {"sec": 0, "nanosec": 0}}, "wrench": {"force": {"x": 1.5}}}
    json_log(tmp_path / "a.mcap", (("/wrench", nothing, 7 + 10 * k) for k in range(3)))
    with pytest.warns(wb.errors.WrenchbedWarning, match="no stamp: the times of their logging"):
        found = table(tmp_path / "a.mcap", "/wrench", ["stamp", "wrench.force.x"])
    assert found["stamp"].to_pylist() == [7, 17, 27]
