"""`wrenchbed robot`: from a file to a robot, and one clear line where that is impossible."""

import json
import re
import struct

import mujoco
import numpy as np
import pyarrow.parquet as pq
import pytest

import wrenchbed as wb
from arm_files import CASES, DATA, TOOL_COG, TOOL_MASS, ArmFileCase
from wrenchbed import registry
from wrenchbed.cli import main
from wrenchbed.robots.base import models
from wrenchbed.robots.described import read

pytestmark = pytest.mark.usefixtures("fresh_registry")
LOOP = ArmFileCase(str(models() / "five_bar" / "five_bar.xml"), "sensor", 4, True)
"""A robot with closed loops; its TOML says how they are solved."""
STATED = ["--tool-mass", str(TOOL_MASS), "--tool-cog", *map(str, TOOL_COG)]


def ran(*words, code=0):
    assert main([str(word) for word in words]) == code


def only_line(capsys):
    (line,) = capsys.readouterr().err.strip().splitlines()
    return line


@pytest.mark.sampled
@pytest.mark.parametrize("case", [*CASES, LOOP], ids=lambda c: c.path.stem)
def test_an_arm_is_planned_recorded_and_calibrated_by_its_file_alone(case, tmp_path):
    """Noise-free: mass, CoG, bias and mount to 1e-9; the calibration has the recording alone."""
    toml, plan, rec, truth, out = (
        tmp_path / n for n in ("my.toml", "plan.parquet", "rec.parquet", "truth.json", "fit.json")
    )
    values = {"tool.mass": 1.1, "tool.cog.x": 0.013, "sensor.bias.fx": 2.5, "sensor.bias.ty": -0.1}
    if case.file == "panda.xml":  # its hand is a point on the sensor: no torque, none is fitted
        values = {"tool.mass": 0.6}
    values |= {"mount.rotation.x": 0.004, "mount.rotation.z": -0.006}
    truth.write_text(json.dumps(values))
    stated = [] if case.tool else STATED
    ran("robot", case.path, "--frame", case.frame, "--out", toml, *stated)
    ran("plan", toml, "--n", 16, "--out", plan)
    ran("record", "--robot", toml, "--plan", plan, "--out", rec, "--samples", 2, "--noise", "off",
        "--parameters", truth)  # fmt: skip
    toml.unlink()
    registry.forget()
    ran("calibrate", rec, "--out", out)
    fit = json.loads(out.read_text())
    robot = registry.load("robots", fit["robot"])
    names = wb.Model.of(robot).parameters
    wanted = names.vector(values)
    for name in fit["parameters"]:
        assert fit["theta"][name] == pytest.approx(wanted[names.index(name)], abs=1e-9), name
    if case is not LOOP:
        first, last = (robot.arm_model.links[k] for k in (0, -1))
        assert f"link.{first.body}.position.x" in fit["no_effect"]
        pair = {f"joint.{last.joint}.zero", "mount.rotation.z"}
        assert any(pair <= set(r["parameters"]) for r in fit["redundancies"])


def stl(path, size):
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * size / 2
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    data = b"".join(struct.pack("<12fH", 0, 0, 0, *corners[list(f)].ravel(), 0) for f in faces)
    path.write_bytes(b"\0" * 80 + struct.pack("<I", len(faces)) + data)


TWO_LINKS = (DATA / "two_links.xml").read_text(encoding="utf-8")


def bench(tmp_path):
    (tmp_path / "parts").mkdir()
    stl(tmp_path / "parts" / "long.stl", np.array([0.1, 0.2, 0.5]))
    (tmp_path / "bench.xml").write_text(TWO_LINKS)
    return tmp_path / "bench.xml"


def test_slides_skew_axes_anchors_refs_and_an_upside_down_base(tmp_path, capsys):
    """The site's body has a joint: what hangs below is the tool, fingers as the key has them."""
    file, toml = bench(tmp_path), tmp_path / "my.toml"
    ran("robot", file, "--frame", "seat", "--out", toml)
    said = capsys.readouterr()
    assert "hand, finger" in said.out and "1 meshes are missing" in said.err
    robot = read(toml)
    theta = robot.parameters.nominal
    assert [j.unit for j in robot.joints] == ["m", "rad", "rad", "rad"]
    assert robot.home == pytest.approx([0.2, 0.3, 0.4, 0.5]) and robot.gravity == (0.0, 0.0, -9.7)
    assert robot.parameters.names[:2] == ("joint.slide.zero", "link.rail.position.x")
    assert robot.description.load.mass == pytest.approx(1.0)
    plain = TWO_LINKS.replace('<mesh name="gone" file="gone.stl"/>', "")
    plain = plain.replace('<geom type="mesh" mesh="gone"/>', "")
    model = mujoco.MjModel.from_xml_string(plain.replace("parts", str(tmp_path / "parts")))
    data, hand, finger = mujoco.MjData(model), model.body("hand").id, model.body("finger").id
    q = robot.sample(40, np.random.default_rng(0))
    rotation, origin = robot.sensor_pose(q, theta)
    load = wb.Simulation(robot, theta).wrench(q)
    torque = robot.gravity_torque(q, theta, np.array(robot.gravity))
    for k, row in enumerate(q):
        data.qpos[:] = [*row, 0.02]
        mujoco.mj_inverse(model, data)
        seat, pull = data.site("seat"), model.opt.gravity * 1.0
        assert np.abs(seat.xpos - origin[k]).max() < 1e-12
        assert np.abs(seat.xmat.reshape(3, 3) - rotation[k]).max() < 1e-12
        centre = 0.9 * data.xipos[hand] + 0.1 * data.xipos[finger]
        turned = rotation[k].T @ np.stack([pull, np.cross(centre - seat.xpos, pull)], axis=1)
        assert np.abs(load[k] - turned.T.ravel()).max() < 1e-10
        assert np.abs(torque[k] + data.qfrc_inverse[:4]).max() < 1e-9


def test_meshes_are_kept_and_drawn(tmp_path):
    """The hull of a mesh in the robot's own MJCF is the file's; rerun gets its triangles."""
    rr = pytest.importorskip("rerun")
    from wrenchbed.viewer.robot import shape

    ran("robot", bench(tmp_path), "--frame", "seat", "--out", tmp_path / "m.toml")
    robot = read(tmp_path / "m.toml")
    model = robot.spec(robot.parameters.nominal).compile()
    found = shape(model, model.body("rail").id)
    assert isinstance(found, rr.Mesh3D)
    corners = np.array(found.vertex_positions.as_arrow_array().to_pylist())
    assert np.ptp(corners, axis=0) == pytest.approx([0.1, 0.2, 0.5], abs=1e-5)
    assert len(corners) == 36


URDF = """<robot name="r"><link name="w"/>
<joint name="j" type="{kind}"><parent link="w"/><child link="l"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="1" velocity="2"/>{more}</joint>
<link name="l"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>
</inertial></link>
<joint name="f" type="fixed"><parent link="l"/><child link="t"/><origin xyz="0 0 0.3"/></joint>
<link name="t"><inertial><mass value="0.5"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>{rest}</robot>"""
SECOND = "".join(
    f'<joint name="o{k}" type="revolute"><parent link="{"w" if k == 0 else f"p{k - 1}"}"/>'
    f'<child link="p{k}"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
    f'<link name="p{k}"><inertial><mass value="1"/>'
    '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    for k in range(3)
)
CLOSED_BENCH = TWO_LINKS.replace(
    "<keyframe>",
    '<equality><connect body1="swing" body2="rail" anchor="0 0 0"/></equality><keyframe>',
)


def refused(tmp_path, text, frame, *more, name="a.urdf"):
    (tmp_path / name).write_text(text)
    out = tmp_path / "my.toml"
    code = main(["robot", str(tmp_path / name), "--frame", frame, "--out", str(out), *more])
    return code, out.exists()


ROS = "http://www.ros.org"
REFUSALS = {
    "not XML": ("hello", "t", "not XML"),
    "other XML": ("<html/>", "t", "neither MJCF .* nor URDF"),
    "xacro": (f'<robot xmlns:xacro="{ROS}/wiki/xacro"><xacro:arm/></robot>', "t", "xacro"),
    "xacro value": ('<robot name="${p}arm"><link name="a"/></robot>', "t", "unexpanded xacro"),
    "no such frame": (URDF.format(kind="revolute", more="", rest=""), "tt", "mean 't'.* w?.*l, t"),
    "nothing moves it": (URDF.format(kind="fixed", more="", rest=""), "t", "no joint moves"),
    "floating": (URDF.format(kind="floating", more="", rest=""), "t", "base floats"),
    "no speed": (
        URDF.format(kind="revolute", more="", rest="").replace('velocity="2"', 'velocity="fast"'),
        "t", "velocity of a joint's limit: .*'fast'",
    ),
    "mimic": (
        URDF.format(kind="revolute", more='<mimic joint="o0"/>', rest=""),
        "t", "couples joints 'j'",
    ),
    "two arms": (URDF.format(kind="revolute", more="", rest=SECOND), "t", "second arm: o0, o1, o2"),
    "massless tool": (
        URDF.format(kind="revolute", more="", rest="").replace('value="0.5"', 'value="0"'),
        "t", "--tool-mass",
    ),
    "loop": (CLOSED_BENCH, "seat", "closes a loop between 'swing' and 'rail'"),
}  # fmt: skip


@pytest.mark.parametrize("what", REFUSALS)
def test_what_is_no_arm_is_refused_in_one_line(what, tmp_path, capsys):
    text, frame, reason = REFUSALS[what]
    code, written = refused(tmp_path, text, frame)
    err = capsys.readouterr().err.strip().splitlines()
    assert (code, written) == (1, False)
    errors = [line for line in err if "error" in line]
    assert len(errors) == 1
    assert len(err) == 1 or what == "loop"  # a mesh that is missing is said too
    assert re.search(reason, errors[0]), errors[0]
    assert str(tmp_path / "a.urdf") in errors[0]


def test_a_mimic_joint_of_the_gripper_stands_at_its_offset(tmp_path):
    inertia = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
    fingers = "".join(
        f'<joint name="{name}" type="prismatic"><parent link="t"/><child link="{name}l"/>'
        f'<axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/>{more}</joint>'
        f'<link name="{name}l"><inertial><mass value="0.5"/>{inertia}</inertial></link>'
        for name, more in (("g", ""), ("m", '<mimic joint="g" multiplier="-1" offset="0.04"/>'))
    )
    text = URDF.format(kind="revolute", more="", rest=fingers)
    assert refused(tmp_path, text, "t") == (0, True)
    load = read(tmp_path / "my.toml").description.load
    assert [load.mass, load.cog[0]] == pytest.approx([1.5, 0.5 * 0.04 / 1.5])


def plain_arm(tmp_path, frame="t"):
    assert refused(tmp_path, URDF.format(kind="revolute", more="", rest=""), frame) == (0, True)
    return tmp_path / "my.toml"


def test_a_second_arm_is_held_on_request_and_foreign_elements_are_passed_over(tmp_path, capsys):
    text = URDF.format(kind="revolute", more="", rest=SECOND)
    assert refused(tmp_path, text, "t", "--hold-others") == (0, True)
    assert "o0, o1, o2 stay" in capsys.readouterr().err
    assert len(read(tmp_path / "my.toml").joints) == 1
    # Drake's, as MuJoCo reads it.
    text = URDF.format(
        kind="revolute", more="", rest="<drake:proximity><drake:x/></drake:proximity>"
    )
    assert refused(tmp_path, text, "t") == (0, True)


def test_a_fixed_joints_name_is_its_childs_frame_and_speeds_are_found_beside_transmissions(
    tmp_path,
):
    robot = read(plain_arm(tmp_path, "f"))
    assert robot.joints[0].speed == 2.0
    assert robot.arm_model.end_shift == pytest.approx([0.0, 0.0, 0.3])
    assert robot.description.load.bodies == ("t",)
    # ROS files name the joint a second time there, without a limit.
    rest = '<transmission name="gear"><joint name="j"/></transmission>'
    assert refused(tmp_path, URDF.format(kind="revolute", more="", rest=rest), "t") == (0, True)
    assert read(tmp_path / "my.toml").joints[0].speed == 2.0


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ("mass = 0.5 ", "mass = -1 ", r"tool\.mass = -1 must be above 0"),
        ("lower = -1.0", "lower = 2.0", r"joint 1\.lower = 2.0 must be below"),
        ("speed", "sped", r"there is no field joint 1\.sped; did you mean 'speed'"),
        ('name = "j"', 'name = "k"', r"joint 1\.name = 'k' must be 'j'"),
        ("gravity = [0.0, 0.0, -9.80665]", "gravity = [0, 0, -1000]", "gravity .* m/s²"),
        ("format = 1", "format = 1 =", "not valid TOML"),
        ('file = "a.urdf"', 'file = "b.urdf"', "b.urdf.*there is no such file"),
    ],
)
def test_a_wrong_edit_of_the_toml_is_named(old, new, reason, tmp_path, capsys):
    toml = plain_arm(tmp_path)
    text = toml.read_text(encoding="utf-8")
    assert old in text
    toml.write_text(text.replace(old, new), encoding="utf-8")
    capsys.readouterr()
    ran("plan", toml, "--n", 3, "--out", tmp_path / "p.parquet", code=1)
    assert re.search(reason, only_line(capsys))


def test_an_edit_counts_and_a_changed_model_is_refused(tmp_path, capsys):
    toml = plain_arm(tmp_path)
    before = read(toml)
    toml.write_text(toml.read_text(encoding="utf-8").replace("upper = 1.0", "upper = 0.5"))
    after = read(toml)
    assert (before.joints[0].upper, after.joints[0].upper) == (1.0, 0.5)
    assert before.name != after.name
    (tmp_path / "a.urdf").write_text((tmp_path / "a.urdf").read_text() + "\n")
    models = ((toml, "has changed since"), (DATA / "iiwa.xml", "wrenchbed robot"))
    for model, words in models:  # another one than described, or none yet
        ran("plan", model, "--out", tmp_path / "p.parquet", code=1)
        assert words in capsys.readouterr().err


def test_nothing_is_written_into_the_users_file(tmp_path):
    file = tmp_path / "a.urdf"
    file.write_text(URDF.format(kind="revolute", more="", rest=""))
    ran("robot", file, "--frame", "t", "--out", file, code=1)
    out = tmp_path / "new" / "my.toml"
    made = wb.describe_robot(file, "t", out)
    assert file.read_text() == URDF.format(kind="revolute", more="", rest="")
    assert out.read_text(encoding="utf-8") == made.text
    assert wb.load("robots", str(out)).name == made.robot.name


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda m: m.pop("arm"), "robot_model: not an arm"),
        (lambda m: m["arm"].pop("links"), "robot_model: not an arm"),
        (lambda m: m["arm"].update(links=[{}]), "robot_model: not an arm"),
        (lambda m: m.update(toml=3), "toml is no text"),
        (lambda m: m.update(toml=m["toml"] + "# more"), "what the file carries is 'r@"),
    ],
)
def test_a_recording_whose_robot_was_broken_is_refused_in_one_line(
    change, reason, tmp_path, capsys
):
    toml, plan, rec = plain_arm(tmp_path), tmp_path / "plan.parquet", tmp_path / "rec.parquet"
    ran("plan", toml, "--n", 5, "--out", plan)
    ran("record", "--robot", toml, "--plan", plan, "--samples", 2, "--out", rec)
    table = pq.read_table(rec)
    raw = json.loads(table.schema.metadata[b"wrenchbed"])
    change(raw["robot_model"])
    pq.write_table(table.replace_schema_metadata({"wrenchbed": json.dumps(raw)}), rec)
    registry.forget()
    capsys.readouterr()
    ran("calibrate", rec, "--out", tmp_path / "fit.json", code=1)
    assert reason in only_line(capsys)
