"""One recording in every convention and under any joint names comes back as the same one."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from arm_files import DATA
from wrenchbed import registry
from wrenchbed.cli import main
from wrenchbed.data import column_map
from wrenchbed.data.guess.column_readings import joints
from wrenchbed.data.guess.column_roles import sheet_of
from wrenchbed.data.guess.guess import guess
from wrenchbed.data.guess.user_facts import Stated
from wrenchbed.data.import_files import import_files
from wrenchbed.data.text_table import read_text
from wrenchbed.errors import MapError
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.robots.described import describe
from wrenchbed.simulation.mujoco_wrench import Simulation

N = 12
TURN = Rotation.random(N, rng=np.random.default_rng(4))
LOAD = np.random.default_rng(5).normal(size=(N, 6))
MOUNT = Rotation.from_rotvec([0.3, -0.5, 0.9])
POINT = np.array([0.01, -0.02, 0.05])
POSE = [*POINT.tolist(), *MOUNT.as_quat(scalar_first=True).tolist()]


def written(folder, orientation, load=LOAD, name="data.csv"):
    """A CSV file of columns o1… and the wrench."""
    names = [f"o{k + 1}" for k in range(orientation.shape[1])] + list(CHANNELS)
    lines = [",".join(names)]
    lines += [",".join(f"{x:.15g}" for x in row) for row in np.hstack([orientation, load])]
    (folder / name).write_text("\n".join(lines))
    return folder / name


def mapped(folder, targets, unit=None, **sections):
    """A map of o1… to targets, in one unit or each in its own."""
    columns = {c: {"column": c, "unit": "N" if c[0] == "f" else "N·m"} for c in CHANNELS}
    for k, target in enumerate(targets):
        own = unit.get(target) if isinstance(unit, dict) else unit
        columns[target] = {"column": f"o{k + 1}"} | ({"unit": own} if own else {})
    raw = {
        "recording": {"robot": "mine", "mode": "static"} | sections.pop("recording", {}),
        "file": [{"match": "*.csv", "columns": columns} | sections.pop("file", {})],
    }
    (folder / "map.json").write_text(json.dumps(raw | sections))
    return column_map.read(folder / "map.json")


NINE = [f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)]
KINDS = {
    "w first": (TURN.as_quat(scalar_first=True), ["qw", "qx", "qy", "qz"], None, {}),
    "w last": (TURN.as_quat(), ["qx", "qy", "qz", "qw"], None, {}),
    "conjugate": (TURN.inv().as_quat(), ["qx", "qy", "qz", "qw"], None, {"inverse": True}),
    "matrix": (TURN.as_matrix().reshape(N, 9), NINE, None, {}),
    "by columns": (TURN.inv().as_matrix().reshape(N, 9), NINE, None, {"inverse": True}),
    "rotation vector": (TURN.as_rotvec(), ["rx", "ry", "rz"], "rad", {}),
    "degrees": (TURN.as_rotvec(degrees=True), ["rx", "ry", "rz"], "deg", {}),
    "roll pitch yaw": (TURN.as_euler("xyz", True), ["roll", "pitch", "yaw"], "deg", {}),
    "KUKA": (TURN.as_euler("ZYX", True), ["yaw", "pitch", "roll"], "deg", {}),
}


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_every_orientation_comes_in(tmp_path, kind):
    values, targets, unit, told = kind
    mapping = mapped(tmp_path, targets, unit, orientation=told)
    found = import_files([written(tmp_path, values)], mapping).recording
    assert np.abs(found.rotation - TURN.as_matrix()).max() < 1e-9
    assert np.abs(found.wrench - LOAD).max() < 1e-12


def test_a_sensor_turned_in_the_flange_counts_without_joints(tmp_path):
    flange = TURN * MOUNT.inv()
    mapping = mapped(
        tmp_path, ["qx", "qy", "qz", "qw"], recording={"sensor": {"pose_flange": POSE}}
    )
    found = import_files([written(tmp_path, flange.as_quat())], mapping).recording
    assert np.abs(found.rotation - TURN.as_matrix()).max() < 1e-9


def test_a_wrench_in_the_axes_of_base_or_flange_is_turned(tmp_path):
    told = {"recording": {"sensor": {"pose_flange": POSE}}, "orientation": {"of": "sensor"}}
    q = TURN.as_quat()
    base = np.hstack([TURN.apply(LOAD[:, :3]), TURN.apply(LOAD[:, 3:])])
    mapping = mapped(tmp_path, ["qx", "qy", "qz", "qw"], wrench={"axes": "base"}, **told)
    found = import_files([written(tmp_path, q, base)], mapping).recording
    assert np.abs(found.wrench - LOAD).max() < 1e-9
    force = MOUNT.apply(LOAD[:, :3])
    torque = MOUNT.apply(LOAD[:, 3:]) + np.cross(POINT, force)
    mapping = mapped(tmp_path, ["qx", "qy", "qz", "qw"], wrench={"axes": "flange"}, **told)
    found = import_files([written(tmp_path, q, np.hstack([force, torque]))], mapping).recording
    assert np.abs(found.wrench - LOAD).max() < 1e-9


@pytest.mark.parametrize("axes", ["sensor", "base"])
def test_torques_about_a_tcp_are_brought_to_the_sensor(tmp_path, axes):
    tcp = np.array([0.01, -0.02, 0.15])
    force, torque = LOAD[:, :3], LOAD[:, 3:] - np.cross(tcp, LOAD[:, :3])
    turn = TURN if axes == "base" else TURN.inv() * TURN
    wrench = np.hstack([turn.apply(force), turn.apply(torque)])
    section = {"axes": axes, "about": tcp.tolist()}
    mapping = mapped(tmp_path, ["qx", "qy", "qz", "qw"], wrench=section)
    found = import_files([written(tmp_path, TURN.as_quat(), wrench)], mapping).recording
    assert np.abs(found.wrench - LOAD).max() < 1e-9


def test_angles_in_degrees_and_unknown_attributes_are_refused(tmp_path):
    mapping = mapped(tmp_path, ["roll", "pitch", "yaw"], "rad")
    with pytest.raises(MapError, match=r"roll pitch yaw reach .* rad: are they in degrees\?"):
        import_files([written(tmp_path, TURN.as_euler("xyz", True))], mapping)
    raw = {"recording": {"robot": "mine", "mode": "static"}}
    raw["file"] = [{"columns": {"fx": {"column": "fx", "unit": "N", "sgn": -1}}}]
    (tmp_path / "map.json").write_text(json.dumps(raw))
    with pytest.raises(MapError, match=r"fx\.sgn; did you mean 'sign'"):
        column_map.read(tmp_path / "map.json")


def test_a_wrench_in_base_axes_is_turned_by_the_robots_joints(tmp_path):
    from wrenchbed import registry

    robot = registry.load("robots", "ur5")
    q = robot.sample(N, np.random.default_rng(2))
    turn = robot.sensor_pose(q, robot.parameters.nominal)[0]
    base = np.hstack([np.einsum("nij,nj->ni", turn, part) for part in np.hsplit(LOAD, 2)])
    mapping = mapped(
        tmp_path, [f"q{j}" for j in range(1, 7)], "rad", wrench={"axes": "base"},
        recording={"robot": "ur5"},
    )  # fmt: skip
    found = import_files([written(tmp_path, q, base)], mapping).recording
    assert np.abs(found.wrench - LOAD).max() < 1e-9


def test_a_constant_orientation_needs_no_column(tmp_path):
    mapping = mapped(tmp_path, [], orientation={"constant": [0.5, 0.5, 0.5, 0.5]})
    found = import_files([written(tmp_path, np.zeros((N, 0)))], mapping).recording
    assert np.allclose(found.q, 0.5)


def test_files_without_a_clock_are_laid_side_by_side(tmp_path):
    written(tmp_path, np.zeros((N, 0)), name="wrench.csv")
    columns = mapped(tmp_path, []) and json.loads((tmp_path / "map.json").read_text())
    columns["file"][0]["match"] = "wrench.csv"
    turn = {c: {"column": str(k + 1)} for k, c in enumerate(("qx", "qy", "qz", "qw"))}
    columns["file"].append({"match": "turn.txt", "columns": turn})
    (tmp_path / "map.json").write_text(json.dumps(columns))
    mapping = column_map.read(tmp_path / "map.json")
    files = [tmp_path / "wrench.csv", tmp_path / "turn.txt"]
    np.savetxt(files[1], TURN.as_quat(), fmt="%.15g")
    found = import_files(files, mapping).recording
    assert np.abs(found.rotation - TURN.as_matrix()).max() < 1e-9
    np.savetxt(files[1], TURN[:-1].as_quat(), fmt="%.15g")
    with pytest.raises(MapError, match=r"row by row, but it has 11 rows and not 12"):
        import_files(files, mapping)


@pytest.mark.parametrize(
    ("sections", "words"),
    [
        ({"recording": {"gravitiy": [0, 0, -9.8]}}, "field recording.gravitiy; did you mean 'grav"),
        ({"recording": {"tolerances": {}}}, "recording.tolerances; did you mean 'tolerance'"),
        ({"recording": {"tolerance": {"tool.maas": 1}}}, "tool.maas; did you mean 'tool.mass'"),
        ({"recording": {"tool": {"mas": 1}}}, "recording.tool.mas; did you mean 'mass'"),
        ({"recording": {"sensor": {"pose": []}}}, "recording.sensor.pose; did you mean"),
        ({"recording": {"mode": "still"}}, "must be 'static', 'dynamic' or 'auto'"),
        ({"file": {"delimeter": ";"}}, "delimeter; did you mean 'delimiter'"),
        ({"orientation": {"inverted": True}}, "orientation.inverted; did you mean 'inverse'"),
        ({"orientation": {"of": "flange"}}, "needs recording.sensor.pose_flange"),
        ({"orientation": {"constant": [1, 0, 0, 0]}}, "one orientation is needed, found qw"),
        ({"wrench": {"axes": "tool"}}, "must be 'sensor', 'flange' or 'base'"),
    ],
)
def test_a_key_that_does_not_exist_is_refused(tmp_path, sections, words):
    with pytest.raises(MapError, match=words):
        mapped(tmp_path, ["qx", "qy", "qz", "qw"], **sections)


NAMES = ("turret", "boom", "roll", "stick", "twist", "bucket", "spin")
POSES = 24


@pytest.fixture(scope="module")
def digger(tmp_path_factory):
    """Seven joints, none of which is numbered; its file, and loads at rest at some poses."""
    folder = tmp_path_factory.mktemp("digger")
    text = (DATA / "iiwa.xml").read_text()
    for k, name in enumerate(NAMES, start=1):
        text = text.replace(f'"joint_{k}"', f'"{name}"')
    (folder / "digger.xml").write_text(text)
    describe(
        folder / "digger.xml", "right_hand", folder / "my.toml", tool_mass=2.0,
        tool_cog=(0.01, -0.02, 0.06),
    )  # fmt: skip
    robot = registry.load("robots", str(folder / "my.toml"))
    q = robot.sample(POSES, np.random.default_rng(6))
    wrench = Simulation(robot, robot.parameters.nominal).wrench(q)
    return folder, robot, q, wrench


def test_a_table_in_any_order_is_read_by_the_joints_names(digger, tmp_path):
    folder, _, q, wrench = digger
    order = sorted(range(7), key=lambda k: NAMES[k])  # as ROS sorts them
    head = [*(NAMES[k] for k in order), *(f"{NAMES[k]}_velocity" for k in order), *CHANNELS]
    rows = np.repeat(np.concatenate([q[:, order], 0 * q, wrench], axis=1), 3, axis=0)
    lines = [",".join(head), *(",".join(f"{v:.9f}" for v in row) for row in rows)]
    (tmp_path / "log.csv").write_text("\n".join(lines))
    found = guess([tmp_path / "log.csv"], Stated(robot=str(folder / "my.toml")))
    assert found.conventions[0].reading.names == NAMES
    sheet = sheet_of(read_text(tmp_path / "log.csv"))
    assert {r.names for r in joints(sheet, "r", ("turret", "boom"))} == {("turret", "boom")}
    assert ("turret", "nobody") not in {r.names for r in joints(sheet, "r", ("turret", "nobody"))}


def test_a_guessed_map_names_the_robots_file_as_seen_from_itself(digger, tmp_path, monkeypatch):
    folder, robot, q, wrench = digger
    rows = np.repeat(np.concatenate([q, wrench], axis=1), 3, axis=0)
    lines = [",".join([*NAMES, *CHANNELS]), *(",".join(f"{v:.9f}" for v in row) for row in rows)]
    (tmp_path / "log.csv").write_text("\n".join(lines))
    (tmp_path / "maps").mkdir()
    monkeypatch.chdir(folder)
    line = ["import", str(tmp_path / "log.csv"), "--guess", "--robot", "my.toml"]
    assert main([*line, "--out", str(tmp_path / "maps" / "rec.parquet")]) == 0
    monkeypatch.chdir(tmp_path)
    found = column_map.read(tmp_path / "maps" / "rec.map.toml")
    assert found.metadata.robot == robot.name
