"""Joints of a robot from a file are known by the file's names, in logs and in tables."""

import numpy as np
import pytest

from arm_files import DATA
from wrenchbed import registry
from wrenchbed.cli import main
from wrenchbed.data import column_map
from wrenchbed.data.guess.guess import guess
from wrenchbed.data.guess.readings import joints
from wrenchbed.data.guess.sheets import sheet_of
from wrenchbed.data.guess.stated import Stated
from wrenchbed.data.logs import table, write_mcap
from wrenchbed.data.metadata import Metadata
from wrenchbed.data.recording import Recording
from wrenchbed.data.text_table import read_text
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.robots.described import describe
from wrenchbed.simulation.simulation import Simulation

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


def test_a_log_in_mcap_has_the_files_names(digger, tmp_path):
    pytest.importorskip("mcap")
    _, robot, q, wrench = digger
    columns = {"t": np.arange(POSES) / 10.0, "segment": np.arange(POSES)}
    columns |= {f"q{k + 1}": q[:, k] for k in range(7)}
    columns |= {c: wrench[:, k] for k, c in enumerate(CHANNELS)}
    metadata = Metadata(robot=robot.name, mode="static", source="sim")
    write_mcap(Recording(metadata, columns, "r"), tmp_path / "r.mcap")
    found = table(tmp_path / "r.mcap", "/joint_states", ["position.bucket", "position.turret"])
    rows = found.to_pydict()
    assert np.allclose(rows["position.bucket"], q[:, 5], atol=1e-12)
    assert np.allclose(rows["position.turret"], q[:, 0], atol=1e-12)
