"""A plan's picture, read back from its file, and `view` on the command line."""

import json
import socket
from pathlib import Path

import numpy as np
import pytest

import wrenchbed as wb
from rrd_file import Rrd, strict  # noqa: F401
from wrenchbed.campaigns.moves import itinerary
from wrenchbed.cli import main
from wrenchbed.errors import DriverError, ParameterError
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.robots.checked_moves import Limits
from wrenchbed.simulation.mujoco_wrench import Simulation
from wrenchbed.simulation.triangle_meshes import motion
from wrenchbed.viewer import rerun_window
from wrenchbed.viewer.plans import STAY_S, along, plan_view

UR5 = wb.load("robots", "ur5")


def words(rrd: Rrd) -> str:
    return str(rrd.values("/report", "TextDocument:text")[0, 0])


@pytest.mark.parametrize("name", ["ur5", "medrue"])
def test_the_way_rests_at_every_pose_in_turn(name):
    robot = wb.load("robots", name)
    plan = wb.poses(robot, 8, seed=3)
    legs = itinerary(robot, plan, robot.home, Limits(), range(8), clear=True)
    dwell = np.array([0.0, 2.5] * 4)
    q, at = along(robot, legs, dwell, Limits().speed)
    assert (np.diff(at) > 0).all()
    stays = np.flatnonzero((np.diff(q, axis=0) == 0).all(axis=1))
    assert np.array_equal(q[stays], plan.q)
    assert np.allclose(np.diff(at)[stays], np.where(dwell > 0, dwell, STAY_S))
    moving = sum(leg.seconds for leg in legs)
    assert at[-1] == pytest.approx(moving + np.where(dwell > 0, dwell, STAY_S).sum(), abs=1e-9)
    speed = np.abs(np.diff(q, axis=0)) / np.diff(at)[:, None]
    top = Limits().speed * np.array([j.speed for j in robot.joints])
    assert (speed <= 1.001 * top).all()
    assert (speed.max(axis=0) > 0.3 * top).any()


def test_the_picture_holds_poses_way_and_expected_wrenches(tmp_path):
    plan = wb.poses(UR5, 6, seed=3)
    plan_view(plan, tmp_path / "p.rrd")
    rrd = Rrd(tmp_path / "p.rrd")
    simulation = Simulation(UR5, UR5.parameters.nominal)
    dots = rrd.values("/world/poses", "Points3D:positions")[0]
    assert np.abs(dots - motion(simulation, plan.q).sensor).max() < 1e-6
    joints = np.deg2rad(rrd.values("/joints", "Scalars:scalars", "time"))
    model = wb.Model.of(UR5)
    expected = model.predict(joints, model.parameters.nominal)
    for k, channel in enumerate(CHANNELS):
        drawn = rrd.values(f"/wrench/{channel}", "Scalars:scalars", "time")
        assert np.allclose(drawn[:, 0], expected[:, k], atol=1e-9)
    assert "touches nothing" in words(rrd)


def test_plans_that_cannot_be_run_or_have_no_model_say_so(tmp_path):
    q = np.array([UR5.home, UR5.home])
    q[1, 1] = 0.9  # the arm through its bench
    plan_view(wb.Plan.of("ur5", q), tmp_path / "p.rrd")
    rrd = Rrd(tmp_path / "p.rrd")
    assert "cannot be run" in words(rrd) and "row 1" in words(rrd)
    assert len(rrd.values("/joints", "Scalars:scalars", "row")) == 2
    with pytest.raises(ParameterError, match="has no model"):
        plan_view(wb.Plan.of("oriented", np.zeros((1, 1))), tmp_path / "o.rrd")


def test_touches_and_motions_are_shown(tmp_path):
    medrue = wb.load("robots", "medrue")
    tip = medrue.tool_pose(medrue.home[None], medrue.parameters.nominal)[1]
    plan_view(wb.Plan.of("medrue", medrue.home[None], points=tip), tmp_path / "t.rrd")
    touched = Rrd(tmp_path / "t.rrd").values("/world/touches", "Points3D:positions")[0]
    assert np.abs(touched - tip).max() < 1e-6
    plan = wb.multisine(UR5, 5.0, 50.0, 1)
    plan_view(plan, tmp_path / "m.rrd")
    rrd = Rrd(tmp_path / "m.rrd")
    degrees = rrd.values("/joints", "Scalars:scalars", "time")
    assert np.allclose(degrees, np.rad2deg(plan.q), rtol=1e-12)
    assert "/world/poses" not in rrd.entities()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("view")
    assert main(["plan", "ur5", "--n", "12", "--out", str(folder / "plan.parquet")]) == 0
    record = ["record", "--robot", "ur5", "--plan", str(folder / "plan.parquet"), "--samples", "10"]
    rec, fit = str(folder / "rec.parquet"), str(folder / "fit.json")
    assert main([*record, "--out", rec]) == 0
    assert main(["calibrate", rec, "--out", fit]) == 0
    assert main(["view", rec, "--rrd", str(folder / "r.rrd")]) == 0
    assert main(["view", rec, fit, "--rrd", str(folder / "c.rrd")]) == 0
    return folder


def test_the_viewer_listens_to_this_machine_alone_and_tells_nobody(tmp_path, monkeypatch):
    told = rerun_window.command("x.rrd")
    assert told[told.index("--bind") + 1] == "127.0.0.1" and told[-1] == "x.rrd"
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    with rerun_window.quiet() as environment:
        written = list(Path(environment["XDG_CONFIG_HOME"]).rglob("*.json"))
        assert written and json.loads(written[0].read_text())["analytics_enabled"] is False
    assert not list(tmp_path.iterdir())


def test_a_port_that_is_taken_is_named(monkeypatch):
    monkeypatch.setenv("DISPLAY", ":0")
    with socket.create_server((rerun_window.HOST, 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(DriverError, match=f"port {port} is taken"):
            rerun_window.show("x.rrd", port=port)


def refused(capsys, *words):
    assert main(list(map(str, words))) == 1
    return capsys.readouterr().err


def test_refusals_say_what_to_do(folder, capsys, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    assert "there is no screen" in refused(capsys, "view", folder / "rec.parquet")
    assert "diagnose --out" in refused(capsys, "view", folder)
    assert "picture already" in refused(capsys, "view", folder / "r.rrd", folder / "fit.json")
    assert "picture already" in refused(capsys, "view", folder / "r.rrd", "--rrd", "x.rrd")
    plan = folder / "plan.parquet"
    assert "is a plan" in refused(capsys, "view", plan, folder / "fit.json", "--rrd", "p.rrd")
