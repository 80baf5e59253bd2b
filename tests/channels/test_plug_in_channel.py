"""One file adds a channel: its columns are imported, read back, and diagnosed without a wrench."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest

import wrenchbed as wb
from plain_ur5 import flange, poses
from wrenchbed import registry
from wrenchbed.channels.base import Channel, flat
from wrenchbed.data import recording as recordings
from wrenchbed.data.column_map import read
from wrenchbed.data.metadata import parse
from wrenchbed.errors import MapError, RecordingError
from wrenchbed.physics.rotations import apply

MAP = """
[recording]
robot = "ur5"
mode = "static"
rate_hz = 100.0
[[file]]
match = "*.csv"
[file.columns]
t = { column = "t", unit = "s" }
segment = { column = "segment" }
"""


@dataclass(frozen=True, eq=False)
class Plumb(Channel):
    """Parts of the direction of gravity along x and y of the sensor, with a zero."""

    name = "plumb"
    title = "parts of the direction of gravity along two axes"
    columns: ClassVar[Mapping[str, str]] = dict.fromkeys(("down_x", "down2"), "1")
    usual = "its zeros"
    floor = 5e-5
    zero: np.ndarray = field(default_factory=lambda: np.zeros(2))

    def predict(self, chain, scene, pose, load):
        down = scene.gravity / np.linalg.norm(scene.gravity)
        return apply(np.swapaxes(pose.rotation, 1, 2), down)[:, :2] + self.zero

    def nuisance(self, scene):
        return np.broadcast_to(np.eye(2), (len(scene), 2, 2))

    def fitted(self, read, scene, pose=None):
        expected = self.predict(None, scene, pose or SimpleNamespace(rotation=scene.pose[0]), None)
        residual = (read - expected[scene.held]).ravel()
        slopes = flat(self.nuisance(scene)[scene.held])
        return replace(self, zero=self.zero + np.linalg.lstsq(slopes, residual, rcond=None)[0])


@pytest.fixture
def plumb(monkeypatch):
    entry = SimpleNamespace(load=Plumb)
    monkeypatch.setattr(
        registry, "_entry_points", lambda k: {"plumb": entry} if "chan" in k else {}
    )
    recordings.channel_units.cache_clear()
    yield
    recordings.channel_units.cache_clear()


def rows(wrong, seed=1, count=60, per_pose=10):
    """Columns of a plain UR5 whose joint 5 is off by ``wrong`` [rad]."""
    rng = np.random.default_rng(seed)
    q, error = poses(count, rng), np.zeros((4, 6))
    error[0, 4] = wrong
    zero = np.array([0.004, -0.002])
    down = np.array([zero - flange(each, error)[2, :2] for each in q])
    q, down = np.repeat(q, per_pose, axis=0), np.repeat(down, per_pose, axis=0)
    down = down + 5e-4 * rng.standard_normal(down.shape)
    hold = np.repeat(np.arange(count), per_pose)
    columns = {"t": 3.0 * hold + 0.01 * np.arange(len(q)), "segment": hold}
    columns |= {f"q{j + 1}": x for j, x in enumerate(q.T)}
    return columns | dict(zip(("down_x", "down2"), down.T, strict=True))


def test_its_columns_alone_are_imported_and_diagnosed(tmp_path, plumb):
    columns = rows(np.deg2rad(0.4))
    header = ",".join(columns)
    table = np.column_stack([*columns.values()])
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header=header, comments="", fmt="%.9g")
    lines = [f'q{j} = {{ column = "q{j}", unit = "rad" }}' for j in range(1, 7)]
    lines += [f'{c} = {{ column = "{c}", unit = "1" }}' for c in ("down_x", "down2")]
    (tmp_path / "map.toml").write_text(MAP + "\n".join(lines))
    (tmp_path / "wrong.toml").write_text(MAP + 'down_z = { column = "down_x", unit = "1" }')
    with pytest.raises(MapError, match="down_z.*did you mean.*down_"):
        read(tmp_path / "wrong.toml")
    made = wb.import_files([tmp_path / "log.csv"], read(tmp_path / "map.toml")).recording
    made.write(tmp_path / "made.parquet")
    made = wb.Recording.read(tmp_path / "made.parquet")
    (cause,) = wb.diagnose(made).diagnosis.which
    assert cause["effect"] == "joint.offset" and cause["elements"] == ["joint 5"]
    found = cause["parameters"]["offset.q5"]
    assert abs(np.rad2deg(found["value"]) - 0.4) < 3.0 * np.rad2deg(found["std"]) < 0.05


def test_without_it_they_are_no_readings_and_as_text_they_are_refused(plumb):
    columns = rows(0.0, count=12)
    metadata = parse({"robot": "ur5", "mode": "static", "source": "import"}, "made")
    wb.Recording(metadata, columns, "made")
    for name in ("down_x", "ax"):
        words = np.array(["a"] * len(columns["t"]), dtype=object)
        with pytest.raises(RecordingError, match=f"{name}.*holds object, not numbers"):
            wb.Recording(metadata, columns | {name: words}, "made")
