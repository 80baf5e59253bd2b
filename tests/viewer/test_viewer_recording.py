"""Pictures of recordings and diagnoses, read back from their files: all is where it belongs."""

import json
import subprocess
import sys

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import ntnu
import wrenchbed as wb
from rrd_file import Rrd, strict  # noqa: F401
from simulated import driven
from wrenchbed.errors import NotFoundError, ParameterError
from wrenchbed.pages.scene import heat
from wrenchbed.physics.rotations import matrix
from wrenchbed.reports.claim import joints
from wrenchbed.reports.robot_scene import _parts, blame, part_of
from wrenchbed.simulation.triangle_meshes import bodies, geoms_of, triangles
from wrenchbed.viewer.elements import scale_for
from wrenchbed.viewer.recordings import recording_view
from wrenchbed.viewer.robot import FRAMES_HZ, frames, shape

ROBOTS = ("ur5", "medrue")
SHOWS = {
    "ur5": {"sensor": ("sensor",), "sensor_cable": ("cable",), "tool_plate": ("tool",),
            "finger_left": ("tool",), "sensor_rim": ("mount", "sensor")},
    "medrue": {"sensor_socket": ("sensor",), "sensor_cable": ("cable",), "probe": ("tool",),
               "holder": ("tool",), "probe_cable": ("tool",)},
}  # fmt: skip
"""Parts that named geoms show."""
CHANNELS = ("fx", "fy", "fz", "tx", "ty", "tz")


@pytest.fixture(scope="module", params=ROBOTS)
def recorded(request, tmp_path_factory):
    """A few poses, a fit with other values, and the picture of both."""
    folder = tmp_path_factory.mktemp(request.param)
    robot = wb.load("robots", request.param)
    recording = driven(wb.poses(robot, 12, seed=1), folder / "rec.parquet", 5, seed=1)
    parameters = wb.Model.of(robot, recording.metadata).parameters
    off = np.random.default_rng(2).uniform(-0.2, 0.2, len(parameters)) * parameters.tolerance
    theta = parameters.mapping(parameters.nominal + off)
    fit = {"format": 1, "robot": robot.name, "theta": theta, "parameters": {}, "recording": "rec"}
    (folder / "fit.json").write_text(json.dumps(fit))
    recording_view(recording, folder / "view.rrd", [folder / "fit.json"])
    return robot, recording, Rrd(folder / "view.rrd"), folder


@pytest.mark.sampled
def test_curves_are_what_was_recorded(recorded):
    robot, recording, rrd, folder = recorded
    fit = json.loads((folder / "fit.json").read_text())
    model = wb.Model.of(robot, recording.metadata)
    fitted = model.predict(recording.q, model.parameters.vector(fit["theta"]))
    configured = model.predict(recording.q, model.configured(recording.metadata))
    for k, channel in enumerate(CHANNELS):
        values = rrd.values(f"/wrench/{channel}", "Scalars:scalars", "row")
        assert np.array_equal(values[:, 0], recording.wrench[:, k])
        assert np.allclose(values[:, 1], configured[:, k], atol=1e-9)
        assert np.allclose(values[:, 2], fitted[:, k], atol=1e-9)
        rows = rrd.times(f"/wrench/{channel}", "Scalars:scalars", "row")
        assert np.array_equal(rows, np.arange(len(values)))
        left = rrd.values(f"/residual/{channel}", "Scalars:scalars", "row")
        assert np.allclose(left[:, 0], (recording.wrench - fitted)[:, k], atol=1e-9)
    shown = rrd.values("/joints", "Scalars:scalars", "row")
    factors = [1e3 if j.unit == "m" else 180.0 / np.pi for j in robot.joints]
    assert np.allclose(shown, recording.q * factors, rtol=1e-12)


def test_bodies_are_where_mujoco_has_them_in_every_pose(recorded):
    robot, recording, rrd, _ = recorded
    simulation = wb.Simulation(robot, robot.parameters.nominal)
    model, data = simulation.model, mujoco.MjData(simulation.model)
    for name, body in bodies(model).items():
        entity = f"/world/real/{name}"
        rows = rrd.times(entity, "Transform3D:translation", "row")
        place = rrd.values(entity, "Transform3D:translation", "row")[:, 0]
        turn = rrd.values(entity, "Transform3D:quaternion", "row")[:, 0]
        for k in range(0, len(rows), 7):
            data.qpos[:] = robot.qpos(recording.q[rows[k] : rows[k] + 1], simulation.theta)[0]
            mujoco.mj_kinematics(model, data)
            x, y, z, w = turn[k]
            off = matrix([w, x, y, z]) - data.xmat[body].reshape(3, 3)
            assert max(np.abs(place[k] - data.xpos[body]).max(), np.abs(off).max()) < 1e-5
    rows = rrd.times("/world/real/tool", "Transform3D:translation", "row")
    changes = np.flatnonzero(np.r_[True, np.diff(recording.columns["segment"]) != 0])
    assert set(changes) <= set(rows)


def test_an_arrow_is_the_load_on_the_sensor_in_the_world(recorded):
    """The tool's weight pulls down, whichever way the sensor is turned."""
    robot, recording, rrd, _ = recorded
    rows = rrd.times("/world/wrench/measured/force", "Arrows3D:vectors", "row")
    arrow = rrd.values("/world/wrench/measured/force", "Arrows3D:vectors", "row")[:, 0]
    start = rrd.values("/world/wrench/measured/force", "Arrows3D:origins", "row")[:, 0]
    scale = scale_for(recording.wrench).force
    rotation, position = robot.sensor_pose(recording.q[rows], robot.parameters.nominal)
    wanted = np.einsum("kij,kj->ki", rotation, recording.wrench[rows, :3])
    assert np.abs(arrow - scale * wanted).max() < 1e-5
    assert np.abs(start - position).max() < 0.0121
    weight = 9.80665 * float(robot.tool(robot.parameters.nominal).mass)
    assert np.abs(arrow / scale - [0, 0, -weight]).max() < 0.15 * weight + 0.3


@pytest.mark.parametrize("name", ROBOTS)
def test_all_visible_geoms_are_drawn_as_large_as_mujoco_bounds_them(name):
    robot = wb.load("robots", name)
    model = wb.Simulation(robot, robot.parameters.nominal).model
    for body in bodies(model).values():
        surfaces = [triangles(model, int(g)) for g in geoms_of(model, body)]
        drawn = np.array(shape(model, body).vertex_positions.as_arrow_array().to_pylist())
        assert np.allclose(drawn, np.concatenate(surfaces).reshape(-1, 3), atol=1e-6)
        for g, corners in zip(geoms_of(model, body), surfaces, strict=True):
            own = (corners - model.geom_pos[g]) @ matrix(model.geom_quat[g])
            middle, half = model.geom_aabb[g, :3], model.geom_aabb[g, 3:]
            if model.geom_type[g] != mujoco.mjtGeom.mjGEOM_PLANE:
                low, high = own.min(axis=(0, 1)), own.max(axis=(0, 1))
                assert np.allclose([low, high], [middle - half, middle + half], atol=1e-6)
            across = np.cross(own[:, 1] - own[:, 0], own[:, 2] - own[:, 0])
            outwards = np.einsum("ti,ti->t", across, own.mean(axis=1))
            assert (outwards > 0.0).all()
    seen = sum(len(geoms_of(model, b)) for b in bodies(model).values())
    assert np.count_nonzero(model.geom_group < 3) == seen


def test_a_shape_that_is_not_drawn_is_named():
    text = """<mujoco><asset><hfield name="h" nrow="2" ncol="2" size="1 1 1 1"/></asset>
        <worldbody><geom name="odd" type="hfield" hfield="h"/></worldbody></mujoco>"""
    with pytest.raises(NotFoundError, match="odd is a mjGEOM_HFIELD"):
        shape(mujoco.MjModel.from_xml_string(text), 0)


def test_a_motion_is_shown_at_thirty_pictures_a_second():
    t = np.arange(1000) / 500.0
    moving = frames(np.sin(t)[:, None], t)
    assert 2.0 * FRAMES_HZ - 2 <= len(moving) <= 2.0 * FRAMES_HZ + 2
    assert moving[0] == 0 and moving[-1] == 999
    resting = frames(np.zeros((1000, 1)), t)
    assert resting.tolist() == [0, 999]
    assert frames(np.array([[0.0], [0.0], [1.0], [1.0]])).tolist() == [0, 2, 3]
    assert frames(np.array([[0.0]])).tolist() == [0]


@given(st.floats(1e-6, 1e6), st.floats(1e-6, 1e6))
def test_arrows_fit_the_scene(force, torque):
    assert scale_for(np.zeros((3, 6))).force > 0
    scale = scale_for(np.array([[force, 0, 0, torque, 0, 0]]))
    assert 0.1 < scale.force * force <= 0.3 + 1e-9
    assert 0.1 < scale.torque * torque <= 0.3 + 1e-9
    for size in (scale.force, scale.torque):
        assert round(size / 10 ** np.floor(np.log10(size) + 1e-9), 6) in (1.0, 2.0, 5.0)


def test_colours_grow_darker_with_blame():
    levels = heat(np.linspace(0, 1, 11)).astype(float) @ [0.299, 0.587, 0.114]
    assert (np.diff(levels) < 0).all()
    assert heat(-1.0).tolist() == heat(0.0).tolist() and heat(2.0).tolist() == heat(1.0).tolist()


def test_what_is_no_simulator_is_refused(recorded):
    robot, recording, _, folder = recorded
    other = "ur5" if robot.name == "medrue" else "medrue"
    fit = json.loads((folder / "fit.json").read_text())
    wrong = folder / "wrong.json"

    def refused(text, match):
        wrong.write_text(text)
        with pytest.raises((ParameterError, wb.WrenchbedError), match=match):
            recording_view(recording, folder / "x.rrd", [wrong])

    refused(json.dumps(fit | {"robot": other}), f"wrong.json: is a fit of '{other}'")
    refused(json.dumps(fit | {"theta": {"no such": 1.0}}), "wrong.json: theta: .*no such")
    refused("[1]", "wrong.json: is no fit or twin")
    refused("{", "wrong.json: not valid JSON")
    with pytest.raises(ParameterError, match="at most 3"):
        recording_view(recording, folder / "x.rrd", [folder / "fit.json"] * 4)


def test_without_rerun_the_extra_is_named():
    code = (
        "import sys; sys.modules['rerun'] = None\n"
        "from wrenchbed.viewer.recordings import recording_view"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 1 and "MissingExtraError" in done.stderr
    assert "[view]" in done.stderr


def test_a_sensor_without_a_robot_is_shown_by_its_readings(tmp_path):
    recording = ntnu.static()
    recording_view(recording, tmp_path / "view.rrd")
    rrd = Rrd(tmp_path / "view.rrd")
    curves = rrd.values("/wrench/tz", "Scalars:scalars", "row")
    assert np.array_equal(curves[:, 0], recording.wrench[:, 5])
    assert not any(e.startswith("/world") for e in rrd.entities())


def cause(effect, probability=1.0, rivals=(), **parameters):
    return {
        "effect": effect,
        "probability": probability,
        "rivals": list(rivals),
        "parameters": {k: {"value": v, "std": abs(v) / 10 or 1.0} for k, v in parameters.items()},
    }


def parts(robot="ur5", world=False):
    arm = wb.load("robots", robot)
    simulation = wb.Simulation(arm, arm.parameters.nominal)
    return simulation, part_of(simulation, world)


def shares_of(simulation, shares):
    """Bodies of the parts that a scene shows, each with its share."""
    of = list(bodies(simulation.model).values())
    return {(of[p.body], p.share) for p in _parts(simulation, shares)}


def test_rivals_have_their_own_probability_and_joint():
    rivals = [
        cause("sensor.creep", 0.2),
        cause("tool.mass", 0.3),
        cause("drive.coulomb", 0.1, joint=4),
    ]
    shares = blame({"which": [cause("link.length", 0.9, rivals, **{"length.a3": 0.1})]})
    assert shares == pytest.approx({"link 3": 0.3, "sensor": 0.2, "tool": 0.3, "joint 4": 0.1})


def test_joints_and_links_that_a_cause_names_are_blamed_alone():
    assert blame({"which": [cause("joint.compliance", 0.8, joint=2)]}) == {"joint 2": 0.8}
    several = cause("joint.offset", **{"offset.q3": 0.01, "offset.q5": 0.02})
    several["parameters"]["offset.q1"] = {"value": 1e-4, "std": 1e-3}
    assert joints(several) == [3, 5]
    assert set(blame({"which": [several]})) == {"joint 3", "joint 5"}
    assert set(blame({"which": [cause("link.length", **{"twist.2": 0.1})]})) == {"link 2"}


@pytest.mark.parametrize("robot", ["ur5", "medrue"])
def test_every_geom_of_the_robot_stands_for_a_part(robot):
    simulation, known = parts(robot)
    model = simulation.model
    assert set(known) == {g for g in range(model.ngeom) if model.geom_bodyid[g]}
    named = {n for names in known.values() for n in names}
    assert {"sensor", "cable", "tool", "base", "link", "joint 1", "joint 6"} <= named
    of = {model.geom(g).name: names for g, names in known.items()}
    assert {name: of[name] for name in SHOWS[robot]} == SHOWS[robot]


@pytest.mark.parametrize("robot", ["ur5", "medrue"])
@pytest.mark.parametrize("joint", [1, 4])
def test_blame_is_painted_on_the_body_that_the_joint_moves(robot, joint):
    simulation, _ = parts(robot)
    model, painted = simulation.model, shares_of(simulation, {f"joint {joint}": 1.0})
    red, grey = ({body for body, share in painted if share == x} for x in (1.0, 0.0))
    own = int(model.joint(f"q{joint}").bodyid[0])
    assert red == ({own} if len(model.body(own).geomnum) and model.body(own).geomnum[0] else set())
    assert not red & grey and grey and 0 not in red | grey
    assert (0, 1.0) in shares_of(simulation, {"environment": 1.0})  # bench and floor


def test_torques_alone_show_the_robot_its_joints_and_each_sensor(tmp_path):
    robot = wb.load("robots", "ur5")
    path = tmp_path / "rec.parquet"
    recording = driven(wb.poses(robot, 6, seed=1), path, 4, seed=1)
    columns = {k: x for k, x in recording.columns.items() if k not in CHANNELS}
    torques = np.random.default_rng(0).normal(size=(len(recording), 6))
    columns |= {f"tau{j + 1}": x for j, x in enumerate(torques.T)} | {"mx": columns["q1"]}
    columns |= {"my": columns["q2"], "mz": columns["q3"]}
    bare = wb.Recording(recording.metadata, columns, "bare")
    recording_view(bare, tmp_path / "view.rrd")
    rrd = Rrd(tmp_path / "view.rrd")
    assert np.allclose(rrd.values("/readings/0", "Scalars:scalars", "row"), torques)
    places = rrd.values("/readings/1", "Scalars:scalars", "row")
    assert np.array_equal(places, bare.q[:, :3])
    assert np.allclose(rrd.values("/joints", "Scalars:scalars", "row"), np.rad2deg(bare.q))
    assert len(rrd.times("/world/real/tool", "Transform3D:translation", "row"))
    with pytest.raises(wb.errors.RecordingError, match="has no wrench"):
        recording_view(bare, tmp_path / "other.rrd", [tmp_path / "fit.json"])
