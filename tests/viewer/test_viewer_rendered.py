"""What a person sees: rerun's own viewer draws, without a screen, and the picture is measured."""

import socket
from pathlib import Path

import mujoco
import numpy as np
import psutil
import pytest
import rerun as rr

import wrenchbed as wb
from headless import VULKAN, free_port, seen
from pictures import unless
from wrenchbed.simulation.simulation import Simulation
from wrenchbed.viewer import show
from wrenchbed.viewer.elements import MEASURED, SIMULATED
from wrenchbed.viewer.recordings import recording_view
from wrenchbed.viewer.robot import bodies, log_pose, log_shapes, log_world, motion
from wrenchbed.viewer.stream import to_file

pytestmark = unless(VULKAN, "mesa-vulkan-drivers is not installed")
LIKE = 0.985
"""Least intersection over union of two outlines."""
EYE, TARGET = np.array([0.75, -0.75, 0.75]), np.array([0.1, 0.1, 0.3])
FIELD = np.deg2rad(55.0)
"""Vertical field of view of rerun's eye."""
PAINT = (255, 0, 0)
LARGE = (2560, 1440)
_CUT, _OFF = 5.0, 0.5
"""Pixels that the picture of a view lacks of its height, and by which its middle is off."""
_STEP = 4
"""Every so many pixels a ray."""
_NAME = "robot"


def draw(robot, path: Path) -> Simulation:
    """What moves of a robot, at home, in red before black."""
    b = rr.blueprint
    eye = b.EyeControls3D(position=EYE, look_target=TARGET, eye_up=(0, 0, 1))
    view = b.Spatial3DView(
        origin="/world", name=_NAME, background=[0, 0, 0], line_grid=False, eye_controls=eye
    )
    simulation = Simulation(robot, robot.parameters.nominal)
    with to_file(path, b.Blueprint(view, collapse_panels=True)) as canvas:
        log_world(canvas)
        model = simulation.model
        moving = {n for n, b in bodies(model).items() if model.body_weldid[b]}
        log_shapes(canvas, "world/real", model, PAINT, only=moving)
        log_pose(canvas, "world/real", motion(simulation, robot.home[None]))
    return simulation


def pictured(path: Path, port: int) -> np.ndarray:
    """What the viewer draws of it (H, W, 3)."""
    with seen(path, port, LARGE) as viewer:
        return viewer.picture(_NAME)


def overlap(picture: np.ndarray, simulation: Simulation) -> float:
    """Intersection over union of the drawn robot and the one that MuJoCo's rays hit."""
    height, width = picture.shape[:2]
    rows, columns = np.mgrid[_STEP // 2 : height : _STEP, _STEP // 2 : width : _STEP]
    drawn = picture[rows, columns].astype(int)
    red = (drawn[..., 0] > 90) & (drawn[..., 0] > 2 * drawn[..., 1])
    hit = _hits(simulation, _rays(rows + 0.5, columns + 0.5, height, width))
    return float((red & hit).sum() / (red | hit).sum())


def _scale(height: int) -> float:
    """Pixels per tangent of a view's picture."""
    return float(0.5 * (height + _CUT) / np.tan(0.5 * FIELD))


def _axes() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    ahead = (TARGET - EYE) / np.linalg.norm(TARGET - EYE)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return right, np.cross(right, ahead), ahead


def _rays(rows: np.ndarray, columns: np.ndarray, height: int, width: int) -> np.ndarray:
    """Directions (…, 3) of pixels."""
    right, up, ahead = _axes()
    x = (columns - 0.5 * width - _OFF) / _scale(height)
    y = (0.5 * height + _OFF - rows) / _scale(height)
    ray = x[..., None] * right + y[..., None] * up + ahead
    return ray / np.linalg.norm(ray, axis=-1, keepdims=True)


def _hits(simulation: Simulation, rays: np.ndarray) -> np.ndarray:
    model, data = simulation.model, mujoco.MjData(simulation.model)
    data.qpos[:] = simulation.robot.qpos(simulation.robot.home[None], simulation.theta)[0]
    mujoco.mj_forward(model, data)
    groups = np.array([1, 1, 1, 0, 0, 0], dtype=np.uint8)
    flat = rays.reshape(-1, 3)
    hit = np.empty(len(flat), dtype=bool)
    geom = np.zeros(1, dtype=np.int32)
    for k, ray in enumerate(flat):  # what stands still is passed through: flg_static = 0
        hit[k] = mujoco.mj_ray(model, data, EYE, ray, groups, 0, -1, geom) >= 0
    return hit.reshape(rays.shape[:-1])


@pytest.mark.sampled
@pytest.mark.parametrize("name", ["ur5", "medrue"])
def test_the_robot_has_the_outline_that_mujocos_rays_hit(tmp_path, name):
    simulation = draw(wb.load("robots", name), tmp_path / "robot.rrd")
    picture = pictured(tmp_path / "robot.rrd", free_port())
    assert overlap(picture, simulation) > LIKE


@pytest.mark.slow
def test_the_viewer_shows_a_recording_without_complaint_and_keeps_to_itself(tmp_path):
    robot = wb.load("robots", "ur5")
    with wb.SimDriver(wb.SimOptions("ur5", seed=1)) as driver:
        wb.record(driver, wb.poses(robot, 10, seed=1), tmp_path / "rec.parquet", samples=10)
    recording = wb.Recording.read(tmp_path / "rec.parquet")
    recording_view(recording, tmp_path / "view.rrd")
    with seen(tmp_path / "view.rrd", free_port()) as viewer:
        viewer.client.set_time(timeline="row", sequence=45)
        names = {v.name for v in viewer.client.get_state().views}
        assert {"robot", "fx [N]", "tz [N·m]", "about"} <= names
        assert not [w for w in viewer.warnings() if "oftware rasterizer" not in w]
        viewer.settled()
        places = transforms(viewer)
        picture = viewer.picture("fx [N]")
        assert {"fx measured − simulated [N]", "tz measured − simulated [N·m]"} <= names
        open_ones = connections(viewer.pid)
    simulation = Simulation(robot, robot.parameters.nominal)
    wanted = motion(simulation, recording.q[40:41])
    for k, body in enumerate(wanted.names):
        assert np.abs(places[body] - wanted.position[0, k]).max() < 1e-5
    blue = np.abs(picture.astype(int) - MEASURED).max(axis=-1) < 40
    ends = np.flatnonzero(blue.any(axis=0))[[0, -1]] / blue.shape[1]
    assert ends[0] < 0.2 and ends[1] > 0.9  # the curve fills the plot, all rows are in view
    for colour in (MEASURED, SIMULATED):
        assert (np.abs(picture.astype(int) - colour).max(axis=-1) < 40).sum() > 50
    assert open_ones and all(c.laddr.ip == "127.0.0.1" for c in open_ones)
    assert all(not c.raddr or c.raddr.ip == "127.0.0.1" for c in open_ones)


def test_what_the_viewer_asks_of_others_goes_nowhere(tmp_path, monkeypatch):
    draw(wb.load("robots", "ur5"), tmp_path / "v.rrd")
    with socket.create_server(("127.0.0.1", 0)) as nowhere:
        monkeypatch.setattr(show, "NOWHERE", f"http://127.0.0.1:{nowhere.getsockname()[1]}")
        nowhere.settimeout(30.0)
        with seen(tmp_path / "v.rrd", free_port()):
            asking, _ = nowhere.accept()
            with asking:
                assert asking.recv(200).startswith(b"CONNECT api.github.com:443")


def transforms(viewer) -> dict[str, np.ndarray]:
    """Where the viewer has each body of the real robot."""
    found = {}
    for edge in viewer.client.get_transform_graph(include_transforms=True)["edges"]:
        name = edge["child"].removeprefix("tf#/world/real/")
        if edge["source"]["kind"] == "transform" and "/" not in name:
            found[name] = np.array(edge["source"]["parent_from_child"])[:3, 3]
    return found


def connections(pid: int):
    return psutil.Process(pid).net_connections("inet")
