"""Exports of calibrations, each read back by its consumer's own parser or one written apart."""

import ast
import json
import re
from functools import partial
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
import yaml
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation

import wrenchbed as wb
from robot_emulators.ur.urscript.tokens import Collector
from simulated import MEDRUE_TRUTH, UR5_TRUTH, WHITE, static
from unstarted import emulated
from wrenchbed.errors import ExportError
from wrenchbed.exports.base import Export, output_files
from wrenchbed.exports.load_numbers import Origin, load_numbers
from wrenchbed.physics.wrench import CHANNELS, six_of

INERTIA = {
    "tool.inertia.xx": 4e-3, "tool.inertia.yy": 5e-3, "tool.inertia.zz": 3e-3,
    "tool.inertia.xy": 2e-4, "tool.inertia.xz": -3e-4, "tool.inertia.yz": 1e-4,
}  # fmt: skip
TILT = {"base.tilt.x": 0.01, "base.tilt.y": -0.02}
MOUNT = {"mount.position.x": 0.01, "mount.position.y": -0.02, "mount.position.z": 0.05}
URDF = """<?xml version="1.0"?>
<!-- a user's robot > with odd > text -->
<robot name="mine">
  <link name="base_link"/>
  <link name="flange"><inertial><mass value="2"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0"
    izz="1"/></inertial></link>
  <joint name="j1" type="revolute"><parent link="base_link"/><child link="flange"/>
    <axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <link name="ft_frame"/>
  <joint name="ft_joint" type="fixed">
    <parent link="flange"/>
    <child link="ft_frame"/>
  </joint>
</robot>
"""


def fit_file(tmp_path, truth, free=("default",), robot="ur5", name="fit.json", **data):
    """A fit of noise-free poses, with the truth's inertia in it, as a motion would have told."""
    recording = static(robot, truth, poses=60, **data)
    fit = wb.calibrate(recording, wb.Options(free=free))
    path = tmp_path / name
    fit.write(path)
    return path


def with_inertia(path):
    """The same fit, as if a motion had identified the inertia."""
    raw = json.loads(path.read_text())
    raw["theta"] |= INERTIA
    for name, value in INERTIA.items():
        raw["parameters"][name] = {"value": value, "std": 1e-6, "unit": "kg·m²"}
    raw["covariance"] = block_diag(raw["covariance"], 1e-12 * np.eye(6)).tolist()
    path.write_text(json.dumps(raw))
    return path


TRUTH = UR5_TRUTH | TILT
BIAS = [TRUTH[f"sensor.bias.{c}"] for c in CHANNELS]
TURN = Rotation.from_rotvec([TRUTH[f"mount.rotation.{a}"] for a in "xyz"])
MASS, COG = TRUTH["tool.mass"], np.array([TRUTH[f"tool.cog.{a}"] for a in "xyz"])
XX, YY, ZZ, XY, XZ, YZ = INERTIA.values()
OWN = np.array([[XX, XY, XZ], [XY, YY, YZ], [XZ, YZ, ZZ]])
IN_FLANGE = TURN.as_matrix() @ OWN @ TURN.as_matrix().T
GRAVITY = Rotation.from_rotvec([*TILT.values(), 0.0]).apply([0.0, 0.0, -9.80665])
"""All numbers by hand, from the truth alone; inertias about the CoG."""
near = partial(pytest.approx, abs=1e-9)


@pytest.fixture(scope="module")
def fit(tmp_path_factory):
    free = ("tool.mass", "tool.cog", "mount.rotation", "base.tilt", "sensor.bias")
    return with_inertia(fit_file(tmp_path_factory.mktemp("fit"), TRUTH, free))


def written(fit, tmp_path, name, **options):
    files, _ = wb.export_to(name, load_numbers(fit), tmp_path / "out", wb.ExportOptions(**options))
    return files[0].read_text()


def numbers_in(text):
    return [float(x) for x in re.findall(r"-?\d+\.?\d*(?:e-?\d+)?", text)]


def test_ur_script_holds_payload_and_gravity(fit, tmp_path):
    lines = [x for x in written(fit, tmp_path, "ur").splitlines() if not x.startswith("#")]
    assert lines[0] == "def wrenchbed_payload():" and lines[-1] == "end"
    gravity = ast.literal_eval(lines[1].strip().removeprefix("set_gravity"))
    mass, cog, inertia = ast.literal_eval(lines[2].strip().removeprefix("set_target_payload"))
    assert gravity == near(-GRAVITY) and mass == near(MASS)
    assert cog == near(TURN.apply(COG)) and inertia == near(six_of(IN_FLANGE))


def test_ros2_parameters_hold_weight_and_cog_in_sensor_axes(fit, tmp_path):
    content = yaml.safe_load(written(fit, tmp_path, "ros2", frame="my: frame"))
    block = content["admittance_controller"]["ros__parameters"]["gravity_compensation"]
    assert block["frame"]["id"] == "my: frame"
    assert block["CoG"]["pos"] == near(COG)
    assert block["CoG"]["force"] == pytest.approx(MASS * 9.80665, abs=1e-8)
    tool = content["gravity_compensation_filter"]["ros__parameters"]["tool"]
    assert tool["mass"] == near(MASS) and tool["pos"] == near(COG)
    assert tool["gravity_field"] == near(GRAVITY)


def test_franka_takes_columns_in_flange_axes(fit, tmp_path):
    content = json.loads(written(fit, tmp_path, "franka"))
    assert set(content) == {"mass", "centerOfMass", "inertia", "transformation"}
    assert content["mass"] == near(MASS) and content["centerOfMass"] == near(TURN.apply(COG))
    assert np.reshape(content["inertia"], (3, 3), order="F") == near(IN_FLANGE)
    assert "±" in (tmp_path / "out.notes.txt").read_text()


def test_kuka_turns_into_principal_axes(fit, tmp_path):
    """KUKA's angles: A about Z, then B about the new Y, then C about the new X [°]."""
    last = written(fit, tmp_path, "kuka").splitlines()[-1]
    _, mass, x, y, z, a, b, c, *moments = numbers_in(last)
    assert mass == near(MASS) and np.array([x, y, z]) / 1e3 == near(TURN.apply(COG))
    vectors = ([0, 0, a], [0, b, 0], [c, 0, 0])
    turns = [Rotation.from_rotvec(v, degrees=True).as_matrix() for v in vectors]
    turn = turns[0] @ turns[1] @ turns[2]
    assert turn @ np.diag(moments) @ turn.T == near(IN_FLANGE)


def test_xarm_takes_ten_numbers(fit, tmp_path):
    mass, *rest = ast.literal_eval(ast.parse(written(fit, tmp_path, "xarm")).body[0].value)
    assert mass == near(MASS) and np.array(rest[:3]) / 1e3 == near(COG)
    assert rest[3:] == pytest.approx(BIAS, abs=1e-8)


def test_urdf_is_read_by_mujoco_and_keeps_all_else(fit, tmp_path):
    raw = json.loads(fit.read_text())
    raw["theta"] |= MOUNT
    moved = tmp_path / "moved.json"
    moved.write_text(json.dumps(raw))
    text = written(moved, tmp_path, "urdf", urdf=URDF)
    mine, found = (ElementTree.fromstring(x) for x in (URDF, text))
    for here, there in zip(mine, found, strict=True):
        if here.get("name") not in ("ft_frame", "ft_joint"):
            assert ElementTree.tostring(here) == ElementTree.tostring(there)
    options = '<mujoco><compiler fusestatic="false"/></mujoco>'
    model = mujoco.MjModel.from_xml_string(text.replace('name="mine">', f'name="mine">{options}'))
    body = model.body("ft_frame")
    assert body.mass[0] == near(MASS) and body.ipos == near(COG)
    axes = Rotation.from_quat(body.iquat, scalar_first=True).as_matrix()
    assert axes @ np.diag(body.inertia) @ axes.T == near(OWN)
    turn = Rotation.from_quat(body.quat, scalar_first=True)
    assert (turn.inv() * TURN).magnitude() < 1e-8
    assert body.pos == near(list(MOUNT.values()))


@pytest.mark.parametrize("series", ["cb3", "e"])
def test_a_ur_told_by_the_script_feels_no_force(tmp_path, series):
    """The controller's own wrench is zero at 100 poses, and was not before."""
    fit = fit_file(tmp_path, UR5_TRUTH)
    true = {n: v for n, v in UR5_TRUTH.items() if not n.startswith("sensor.")}
    options = wb.EmulatorOptions(
        "127.0.1.37", parameters=true, noise="off", setting={"box": "off", "series": series}
    )
    controller = emulated("ur5", options).controller
    script = written(fit, tmp_path, "ur")
    before = felt(controller)
    controller.upload(Collector().feed(script.encode()))
    for k in range(5):
        controller.cycle(1.0 + 0.008 * k)
    after = felt(controller)
    assert np.abs(before).max() > 0.1
    assert np.abs(after).max() < 1e-6


def felt(controller) -> np.ndarray:
    """The wrench that the controller reports at 100 poses (100, 6), from the load at its flange."""
    body, rows = controller.arm.plant, []
    value = body.model.parameters.mapping(body.theta)
    turn = Rotation.from_rotvec([value[f"mount.rotation.{a}"] for a in "xyz"])
    for q in body.robot.sample(100, np.random.default_rng(3)):
        rotation, _ = body.robot.flange_pose(q[None], body.robot.parameters.nominal)
        load = body.model.true_wrench(q[None], body.theta)[0].reshape(2, 3)
        controller.estimate.update(turn.apply(load).ravel(), rotation[0], np.zeros(6))
        rows.append(controller.estimate.wrench.copy())
    return np.array(rows)


@pytest.mark.slow
def test_std_is_that_of_many_fits(tmp_path):
    """CoG in flange axes depends on CoG and mount: its ± holds over repeated noise."""
    found = []
    for seed in range(24):
        free = ("tool.mass", "tool.cog", "mount.rotation", "sensor.bias")
        path = fit_file(tmp_path, UR5_TRUTH, free, noise=WHITE, samples=5, seed=seed)
        found.append(load_numbers(path).cog)
    scatter = np.std([q.value for q in found], axis=0, ddof=1)
    # every seed draws other poses, so the ± differ a little
    stated = np.mean([q.std for q in found], axis=0)
    assert scatter / stated == pytest.approx(np.ones(3), abs=0.45)  # 24 fits: ± 3 × 14.7 %


def test_a_null_direction_is_never_a_number(tmp_path):
    free = ("tool.mass", "tool.cog", "mount.rotation", "dq6", "sensor.bias")
    path = fit_file(tmp_path, UR5_TRUTH, free, noise=WHITE, samples=5)
    numbers = load_numbers(path)
    assert numbers.cog.origin is Origin.UNDETERMINED and numbers.mass.known
    with pytest.raises(ExportError, match="CoG was not determined, and ur needs it: .*dq6"):
        wb.export_to("ur", numbers, tmp_path / "out")
    assert not (tmp_path / "out").exists()
    written(path, tmp_path, "ros2")  # in sensor axes the load is determined


def test_inertia_that_no_motion_told_is_left_out(tmp_path):
    path = fit_file(tmp_path, UR5_TRUTH)
    lines = written(path, tmp_path, "ur").splitlines()
    call = next(x for x in lines if "set_target_payload(" in x and not x.startswith("#"))
    assert len(numbers_in(call)) == 4
    assert any("inertia" in x and "not identified" in x for x in lines if x.startswith("#"))
    assert ",J" not in written(path, tmp_path, "kuka")
    with pytest.raises(ExportError, match="the inertia was not identified"):
        written(path, tmp_path, "urdf", urdf=URDF)
    inertia = '<inertia ixx="3" iyy="2" izz="1" ixy="0" ixz="0" iyz="0"/>'
    inertial = f'<inertial><mass value="9"/>{inertia}</inertial>'
    kept = URDF.replace('<link name="ft_frame"/>', f'<link name="ft_frame">{inertial}</link>')
    text = written(path, tmp_path, "urdf", urdf=kept)
    assert '<inertia ixx="3" iyy="2" izz="1"' in text and '<mass value="9"/>' not in text


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"refuted": "tz is turned over"}, "its own data refute it: tz is turned over"),
        ({"converged": False}, "converged is not true"),
        ({"covariance": [[1.0]]}, "covariance must be a matrix of"),
        ({"robot": "ur6"}, "robot.*there is no robot 'ur6'; did you mean 'ur5'"),
        ({"gravity": [0.0, 1.0]}, "gravity .* must be 3 numbers"),
    ],
)
def test_a_fit_that_cannot_be_trusted_is_refused(fit, tmp_path, change, why):
    bad = tmp_path / "bad.json"
    bad.write_text(json.dumps(json.loads(fit.read_text()) | change))
    with pytest.raises(ExportError, match=f"bad.json: {why}"):
        load_numbers(bad)


def test_flange_axes_need_a_flange(fit, tmp_path):
    with pytest.raises(ExportError, match="knows the place of the sensor"):
        load_numbers(fit, (0, 0, 0, 1, 0, 0, 0))
    path = fit_file(tmp_path, MEDRUE_TRUTH, ("mTool", "xG", "yG", "zG"), robot="medrue")
    with pytest.raises(ExportError, match="state the sensor's place with --mount"):
        written(path, tmp_path, "ur")
    with pytest.raises(ExportError, match="--mount: give x y z"):
        load_numbers(path, (0, 0, 0, 2, 0, 0, 0))
    half = np.sqrt(0.5)
    turned = load_numbers(path, (0.0, 0.0, 0.1, half, 0.0, 0.0, half))  # 90° about z
    x, y, z = turned.cog_sensor.value
    assert turned.cog.value == pytest.approx([-y, x, z + 0.1], abs=1e-12)
    wb.export_to("ur", turned, tmp_path / "out")
    with pytest.raises(ExportError, match="calibrate with --free default sensor.bias"):
        written(path, tmp_path, "xarm")


@pytest.mark.parametrize(
    ("urdf", "frame", "why"),
    [
        (None, None, "name your own file with --urdf"),
        (URDF, "ft_fram", "there is no link 'ft_fram'; did you mean 'ft_frame'.*base_link"),
        (URDF[:-20], None, "no valid XML"),
        ("<!DOCTYPE robot>" + URDF.split("?>")[1], None, "document type"),
        ("<model/>", None, "not <robot>"),
        (URDF, "base_link", "flange behind 'base_link' have masses of their own"),
    ],
)
def test_a_urdf_that_cannot_take_it_is_refused(fit, tmp_path, urdf, frame, why):
    with pytest.raises(ExportError, match=why):
        written(fit, tmp_path, "urdf", urdf=urdf, frame=frame)


def test_effects_of_a_twin_are_in_the_numbers_or_named_as_left_out(tmp_path):
    theta = {n: v for n, v in TRUTH.items() if not n.startswith("sensor.bias")}
    raw = {
        "format": 1, "robot": "ur5", "theta": theta, "tool": {}, "recording": "r.parquet",
        "effects": [
            {"effect": "sensor.creep", "parameters": {}},
            {"effect": "base.tilt", "parameters": {"x": 0.1, "y": 0.0}},
        ],
    }  # fmt: skip
    path = tmp_path / "twin.json"
    robot = wb.load("robots", "ur5")
    creep = wb.load("effects", "sensor.creep").parameters(robot)
    raw["effects"][0]["parameters"] = {p.name: p.nominal + p.tolerance for p in creep}
    path.write_text(json.dumps(raw))
    numbers = load_numbers(path)
    assert any(line.startswith("sensor.creep") for line in numbers.left)
    assert not any("base.tilt" in line for line in numbers.left)
    want = Rotation.from_rotvec([0.11, -0.02, 0.0]).apply([0.0, 0.0, -9.80665])
    assert numbers.gravity.value == pytest.approx(want, abs=2e-3)  # turns do not quite add up
    assert numbers.mass.std is None


@pytest.mark.parametrize("name", wb.names("exports"))
def test_contract(fit, tmp_path, name):
    form: Export = wb.load("exports", name)
    assert form.name == name and form.title and form.source
    numbers = load_numbers(fit)
    files, notes = wb.export_to(name, numbers, tmp_path / "out", wb.ExportOptions(urdf=URDF))
    assert output_files(name, Path())  # as `--out ""` gives
    assert files == output_files(name, tmp_path / "out") and all(f.is_file() for f in files)
    text = "".join(f.read_text() for f in files)
    for line in notes:  # ± and what is left out, whatever the form of its comments
        assert line in text
    assert str(numbers.digest) in text
    for quantity in ("mass", "cog", "inertia", "rotation", "position", "bias", "gravity"):
        said = getattr(numbers, quantity).name
        assert any(said in line for line in notes) or not getattr(numbers, quantity).known
    again, _ = wb.export_to(name, numbers, tmp_path / "again", wb.ExportOptions(urdf=URDF))
    assert [f.read_bytes() for f in again] == [f.read_bytes() for f in files]


BENIGN = "pose-log"
HOSTILE = [
    "x\r\n$OUT[1]=TRUE", "x\u2028import os\u2029import os\u0085import os",
    "x\x0bimport os\x0cimport os\x1cimport os", "x\x00\x1b[2J\u202e\ufffe\uffff",
    "-->", "x---->\n<mass value='9'/>", "x-", "coding: utf-7 +AAo-import os",
]  # fmt: skip
"""Texts that would end a comment of some language, or of all that read Unicode's line ends."""


def exported_from(fit, folder, name, text):
    """Files of an export whose fit names ``text`` as recording and unit, and in its own name."""
    raw = json.loads(fit.read_text())
    raw["recording"] = text
    raw["redundancies"] = [{"sentence": text}]
    raw["parameters"]["dq2"] = {"value": 0.1, "std": 0.1, "unit": text}
    raw["covariance"] = np.pad(raw["covariance"], (0, 1)).tolist()
    folder.mkdir()
    path = folder / f"{text.replace('/', '').replace(chr(0), '')}.json"
    path.write_text(json.dumps(raw))
    files, _ = wb.export_to(name, load_numbers(path), folder / "out", wb.ExportOptions(urdf=URDF))
    return [f.read_bytes().decode() for f in files]


@pytest.mark.sampled
@pytest.mark.parametrize("name", wb.names("exports"))
def test_names_of_others_stay_within_comments(fit, tmp_path, name):
    """Only lines of comments differ, however the fit and its recording are called."""
    form = wb.load("exports", name)
    want = exported_from(fit, tmp_path / "benign", name, BENIGN)
    assert any(BENIGN in text for text in want)
    for k, hostile in enumerate(HOSTILE):
        got = exported_from(fit, tmp_path / str(k), name, hostile)
        assert len(got) == len(want)
        for text, benign in zip(got, want, strict=True):
            assert meaning(text) == meaning(benign), hostile
            if text.startswith("{"):
                continue
            lines, others = text.splitlines(), benign.splitlines()
            assert len(lines) == len(others), hostile  # at all that Unicode calls a line's end
            if form.comment in ("# ", "; "):
                differ = [a for a, b in zip(lines, others, strict=True) if a != b]
                assert differ and all(a.startswith(form.comment) for a in differ), hostile


def meaning(text):
    """What a file's consumer reads of it, whatever its language."""
    if text.startswith("<?xml"):
        root = ElementTree.fromstring(text)
        return [(e.tag, e.attrib) for e in root.iter()]
    if text.startswith("{"):
        return {k: v for k, v in json.loads(text).items() if k not in ("source", "left_out")}
    if "load = [" in text:
        return ast.dump(ast.parse(text.encode()))
    if "admittance_controller:" in text:
        return yaml.safe_load(text)
    return None


def test_names_in_a_user_s_urdf_are_kept_as_they_are_written(fit, tmp_path):
    link = '<link name="a&quot; &lt;b" />'
    mine = URDF.replace('<link name="ft_frame"/>', link).replace(
        '<child link="ft_frame"/>', '<child link="a&quot; &lt;b"/>'
    )
    text = written(fit, tmp_path, "urdf", urdf=mine, frame='a" <b')
    assert ElementTree.fromstring(text).find("link[@name='a\" <b']/inertial") is not None
