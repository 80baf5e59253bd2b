"""What a person sees: rerun's own viewer draws a recording without a screen, and asks nobody."""

import socket

import numpy as np
import psutil
import pytest

import wrenchbed as wb
from headless import VULKAN, free_port, seen
from pictures import unless
from simulated import driven
from wrenchbed.simulation.mujoco_wrench import Simulation
from wrenchbed.simulation.triangle_meshes import motion
from wrenchbed.viewer import rerun_window
from wrenchbed.viewer.elements import MEASURED, SIMULATED
from wrenchbed.viewer.plans import plan_view
from wrenchbed.viewer.recordings import recording_view

pytestmark = unless(VULKAN, "mesa-vulkan-drivers is not installed")


@pytest.mark.slow
def test_the_viewer_shows_a_recording_without_complaint_and_keeps_to_itself(tmp_path):
    robot = wb.load("robots", "ur5")
    recording = driven(wb.poses(robot, 10, seed=1), tmp_path / "rec.parquet", 10, seed=1)
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
        open_ones = psutil.Process(viewer.pid).net_connections("inet")
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
    plan_view(wb.poses(wb.load("robots", "ur5"), 2, seed=1), tmp_path / "v.rrd")
    with socket.create_server(("127.0.0.1", 0)) as nowhere:
        monkeypatch.setattr(rerun_window, "NOWHERE", f"http://127.0.0.1:{nowhere.getsockname()[1]}")
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
