"""Effects on the tool, the arm and the load against mechanics done by hand or by differences."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from effect_scenes import added, at, change, displacement, motion, scene_of
from scipy.spatial.transform import Rotation

from wrenchbed import registry
from wrenchbed.benchmark.lookalikes.motion_loads import link_forces
from wrenchbed.effects.base import Pose
from wrenchbed.effects.chain import ActiveEffect, respond
from wrenchbed.effects.scene import Scene
from wrenchbed.errors import ParameterError
from wrenchbed.robots.medrue import kinematics
from wrenchbed.simulation.mujoco_wrench import Simulation

G = 9.80665
TOOL, COG = 1.35, np.array([0.004, -0.006, 0.071])
"""Mass [kg] and centre of gravity [m] of the UR5's tool."""
FLANGE = Rotation.from_euler("x", 90, degrees=True)
"""Of the UR5 at q = 0: the sensor's y points up."""


def seen(scene):
    """Rotations of the sensor and the force of the tool's weight in its axes (M, 3) [N]."""
    rotation = Rotation.from_matrix(scene.pose[0])
    return rotation, rotation.inv().apply([0.0, 0.0, -TOOL * G])


def loads(force, cog=COG):
    return np.concatenate([force, np.cross(cog, force)], axis=1)


def test_another_mass_or_centre_of_gravity_adds_its_lever_times_the_weight():
    scene = scene_of("ur5 static")
    _, force = seen(scene)
    found = added(scene, "tool.cog", cog__x=1e-3, cog__y=-2e-3, cog__z=3e-3)
    assert np.abs(found[:, :3]).max() < 1e-12
    assert found[:, 3:] == pytest.approx(np.cross([1e-3, -2e-3, 3e-3], force), abs=1e-12)
    assert added(scene, "tool.mass", mass=0.135) == pytest.approx(loads(0.1 * force), abs=1e-12)


def test_the_tool_side_has_no_lever_and_a_tilted_base_turns_gravity():
    scene = scene_of("ur5 static")
    rotation, _ = seen(scene)
    found = added(scene, "tool.self_weight", mass=0.05)
    assert found[:, :3] == pytest.approx(rotation.inv().apply([0, 0, -0.05 * G]), abs=1e-12)
    assert np.abs(found[:, 3:]).max() < 1e-12
    scene = scene_of("ur5 static")
    rotation, force = seen(scene)
    turned = Rotation.from_rotvec([0.02, -0.01, 0.0]).apply([0.0, 0.0, -TOOL * G])
    found = added(scene, "base.tilt", x=0.02, y=-0.01)
    assert found == pytest.approx(loads(rotation.inv().apply(turned) - force), abs=1e-12)


@pytest.mark.parametrize(
    ("name", "given", "way"),
    [
        ("mount.rotation", {"rotation__x": 0.1, "rotation__y": 0.2, "rotation__z": -0.3},
         [0.1, 0.2, -0.3]),
        ("joint.offset", {"joint": 6, "offset": 0.1}, [0.0, 0.0, 0.1]),
        ("link.length", {"twist__6": 0.1}, [0.1, 0.0, 0.0]),
    ],
)  # fmt: skip
def test_what_turns_the_sensor_turns_its_tool_with_it(name, given, way):
    """The last joint turns about the sensor's z, and its twist about the sensor's x."""
    scene = scene_of("ur5 static")
    _, force = seen(scene)
    turned = Rotation.from_rotvec(way).inv().apply(force)
    assert added(scene, name, **given) == pytest.approx(loads(turned - force), abs=1e-12)


def spins(scene, h=1e-3):
    """ω and its derivative in sensor axes (M, 3) by differences of the sensor's rotation."""
    q, d, dd = scene.q.v, scene.q.d, scene.q.dd

    def rotation(s):
        moved = q + s * h * d + 0.5 * (s * h) ** 2 * dd
        return Rotation.from_matrix(scene.robot.sensor_pose(moved, scene.theta)[0])

    now = rotation(0.0)
    before, after = ((rotation(-1.0).inv() * now), (now.inv() * rotation(1.0)))
    b, a = before.as_rotvec(), after.as_rotvec()
    return (a + b) / (2.0 * h), (a - b) / h**2


AXES = {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}


@pytest.mark.parametrize("axes", AXES)
def test_more_inertia_takes_more_torque_to_turn(axes):
    scene = motion("ur5", seconds=1.0)
    inertia = np.zeros((3, 3))
    i, j = AXES[axes]
    inertia[i, j] = inertia[j, i] = 2e-3
    spin, turning = spins(scene)
    torque = -(turning @ inertia + np.cross(spin, spin @ inertia))
    found = added(scene, "tool.inertia", **{f"inertia__{axes}": 2e-3})
    assert np.abs(torque).max() > 1e-3
    assert np.abs(found[:, :3]).max() < 1e-12
    assert found[:, 3:] == pytest.approx(torque, abs=1e-6)


def test_an_accelerometer_says_what_of_the_inertial_load_is_there():
    """m = 2 kg at c = 0.1 m along z, I = diag(1, 2, 3)·1e-2 kg·m², one acceleration at a time."""
    robot = registry.load("robots", "oriented")
    known = robot.parameters
    theta = robot.theta_of_tool(known.nominal, 2.0, (0.0, 0.0, 0.1))
    for axis, size in zip(("xx", "yy", "zz"), (1e-2, 2e-2, 3e-2), strict=True):
        theta[known.index(f"tool.inertia.{axis}")] = size
    none = np.zeros((3, 3))
    acceleration, turning, spin = none.copy(), none.copy(), none.copy()
    acceleration[0] = [1.0, 2.0, 3.0]
    turning[1] = [1.0, 1.0, 1.0]
    spin[2] = [1.0, 2.0, 0.0]
    extra = {"acceleration": acceleration, "spin": spin, "turning": turning}
    q = np.tile([1.0, 0.0, 0.0, 0.0], (3, 1))
    scene = Scene(robot, theta, np.array(robot.gravity), q, np.arange(3.0), np.ones(3, bool))
    told = replace(scene, extra=extra)
    effect = registry.load("effects", "tool.inertia")
    (variant,) = effect.variants(told)
    assert variant.free == ("share",)
    expected = [
        [-2.0, -4.0, -6.0, 0.1 * 4.0, 0.1 * -2.0, 0.0],
        [0.0, 0.0, 0.0, -1e-2, -2e-2, -3e-2],
        [0.0, 0.0, 0.0, 0.0, 0.0, -(1.0 * 2e-2 * 2.0 - 2.0 * 1e-2 * 1.0)],
    ]
    for share in (1.0, 0.5):
        want = pytest.approx(share * np.array(expected), abs=1e-12)
        assert added(told, "tool.inertia", share=share) == want
    assert not added(scene, "tool.inertia", share=1.0).any()


AS_PARAMETERS = [("ur5 static", "base.tilt"), ("ur5 static", "mount.rotation"),
                 ("ur5 static", "tool.cog"), ("ur5 motion", "link.length"),
                 ("ur5 motion", "tool.inertia"), ("medrue static", "joint.offset")]  # fmt: skip


@pytest.mark.parametrize(("label", "name"), AS_PARAMETERS)
def test_a_robot_with_other_parameters_reads_what_the_effect_says(label, name):
    scene, effect = scene_of(label), registry.load("effects", name)
    for variant in effect.variants(scene)[:8]:
        known = effect.parameters(scene.robot)
        given = {n: 2.0 * known[known.index(n)].tolerance for n in variant.free}
        values = effect.values(scene.robot, given)
        before = scene.theta.copy()
        theta = effect.as_parameters(scene.robot, scene.theta, values)
        assert np.array_equal(scene.theta, before)
        told = respond(replace(scene, theta=theta))
        expected = respond(scene, [ActiveEffect(effect, values)])
        assert told == pytest.approx(expected, abs=1e-9)


def test_offsets_are_parameters_only_where_every_joint_has_a_zero():
    effect, theta = registry.load("effects", "joint.offset"), np.array([5.0, 0.1, 0.2])
    values = {"offset.q1": 0.01, "offset.q2": 0.02}
    index = ("l", "dq1", "dq2").index
    robot = SimpleNamespace(zero_names=("dq1", "dq2"), parameters=SimpleNamespace(index=index))
    assert effect.as_parameters(robot, theta, values) == pytest.approx([5.0, 0.11, 0.22])
    robot.zero_names = ()
    assert effect.as_parameters(robot, theta, values) is None


def test_a_bearing_with_play_tilts_about_the_moment_across_it():
    scene = at("ur5", np.zeros(6))
    force = FLANGE.inv().apply([0.0, 0.0, -TOOL * G])
    moment = np.cross(COG, force) * [1.0, 1.0, 0.0]
    turn = 2e-3 * moment / np.sqrt(moment @ moment + 0.05**2)
    turned = Rotation.from_rotvec(turn).inv().apply(force)
    found = added(scene, "joint.clearance", tilt=2e-3)
    assert found == pytest.approx(loads((turned - force)[None]), abs=1e-12)


@pytest.mark.parametrize("angle", [0.588, 5.0])
def test_a_joint_leaves_the_middle_of_its_backlash_at_a_hundredth_of_a_newton_metre(angle):
    """The last joint, whose axis lies level: the tool hangs 7 mm beside it."""
    scene = at("ur5", [0.0, 0.0, 0.0, 0.0, 0.0, angle])
    rotation = FLANGE * Rotation.from_euler("z", angle)
    torque = np.cross(COG, rotation.inv().apply([0.0, 0.0, -TOOL * G]))[2]
    moved = displacement(scene, "joint.backlash", joint=6, load=2e-4)
    assert moved[0, 5] == pytest.approx(2e-4 * np.tanh(torque / 0.01), rel=1e-6)
    assert np.abs(moved[0, :5]).max() == 0.0


@pytest.mark.parametrize(("name", "axes"), [("compliance__x", "x"), ("compliance__y", "y"),
                                            ("compliance", "xy")])  # fmt: skip
def test_a_base_gives_about_the_axes_stated(name, axes):
    scene = at("ur5", [0.7, -0.5, 0.4, 0.2, 0.3, 0.1])
    moment = scene.base_moment[0]
    angle = [1e-5 * m if a in axes else 0.0 for a, m in zip("xyz", moment, strict=True)]
    rotation, force = seen(scene)
    turned = (Rotation.from_rotvec(angle) * rotation).inv().apply([0.0, 0.0, -TOOL * G])
    assert np.abs(moment[:2]).min() > 1.0
    found = added(scene, "base.compliance", **{name: 1e-5})
    assert found == pytest.approx(loads(turned - force), abs=1e-10)


@pytest.mark.parametrize(
    ("label", "foot"), [("ur5 static", [0, 0, 0]), ("medrue static", [0.109, 0.139, -0.031])]
)
def test_a_base_that_gives_moves_the_sensor_about_its_own_foot(label, foot):
    scene, effect = scene_of(label), registry.load("effects", "base.compliance")
    values = effect.values(scene.robot, {"compliance": 1e-4})
    _, moved = effect.pose(scene, Pose(*scene.pose), values)
    turn = Rotation.from_rotvec(1e-4 * scene.base_moment * [1.0, 1.0, 0.0])
    assert moved == pytest.approx(foot + turn.apply(scene.pose[1] - foot), abs=1e-12)


def published(robot, joint, give, std):
    effect = registry.load("effects", "joint.compliance")
    scene = scene_of(f"{robot} static")
    variant = effect.variants(scene)[joint - 1]
    values = effect.values(scene.robot, {f"compliance.q{joint}": give})
    return effect, effect.publish(scene.robot, variant, values, std)


def test_one_joint_is_published_by_its_stiffness():
    """1/k of 5e-5 ± 1e-6 rad/(N·m): 20 000 ± 400 N·m/rad."""
    effect, told = published("ur5", 2, 5e-5, {"compliance.q2": 1e-6})
    assert set(told) == {"stiffness", "joint"}
    assert told["joint"] == {"value": 2}
    assert told["stiffness"] == {
        "value": pytest.approx(2e4), "std": pytest.approx(400.0), "unit": "N·m/rad",
    }  # fmt: skip
    back = effect.amplitudes(told)
    assert back == {"compliance.q2": {"value": pytest.approx(5e-5), "std": pytest.approx(1e-6)}}
    _, slide = published("medrue", 1, 1e-5, {})
    assert slide["stiffness"] == {"value": pytest.approx(1e5), "std": None, "unit": "N/m"}
    _, turning = published("medrue", 2, 1e-5, {})
    assert turning["stiffness"]["unit"] == "N·m/rad"


def test_a_joint_that_does_not_give_is_infinitely_stiff():
    _, told = published("ur5", 3, 0.0, {"compliance.q3": 1e-6})
    assert told["stiffness"] == {"value": np.inf, "std": None, "unit": "N·m/rad"}
    effect = registry.load("effects", "joint.compliance")
    joint = {"value": 3}
    assert effect.amplitudes({"stiffness": {"value": 0.0, "std": None}, "joint": joint}) is None
    assert effect.amplitudes({"stiffness": {"value": 1e4, "std": None}}) is None
    told = effect.amplitudes({"stiffness": {"value": 1e4, "std": None}, "joint": joint})
    assert told == {"compliance.q3": {"value": pytest.approx(1e-4), "std": None}}


@pytest.mark.parametrize("stiffness", [0.0, -1.0, "soft"])
def test_a_stiffness_is_above_zero(stiffness):
    effect, robot = registry.load("effects", "joint.compliance"), registry.load("robots", "ur5")
    with pytest.raises(ParameterError, match="must be above 0"):
        effect.values(robot, {"joint": 2, "stiffness": stiffness})
    assert effect.values(robot, {"joint": 2, "stiffness": 0.5})["compliance.q2"] == 2.0


def oriented(*turns):
    """A tool of 1 kg, 100 mm below the sensor, in orientations given by rotation vectors."""
    scene = at("oriented", Rotation.from_rotvec(np.array(turns)).as_quat()[:, [3, 0, 1, 2]])
    return replace(scene, theta=scene.robot.theta_of_tool(scene.theta, 1.0, [0.0, 0.0, 0.1]))


TURNS = np.array([[0.3, 0.0, 0.0], [0.0, 1.1, 0.2], [0.4, -0.8, 1.3]])
GIVES = {"x": (0, 0), "y": (1, 1), "z": (2, 2), "xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}


@pytest.mark.parametrize("part", GIVES)
def test_a_tool_gives_along_and_across_its_load(part):
    force = Rotation.from_rotvec(TURNS).inv().apply([0.0, 0.0, -G])
    give = np.zeros((3, 3))
    i, j = GIVES[part]
    give[i, j] = give[j, i] = 2e-5
    found = added(oriented(*TURNS), "tool.flexure", **{f"compliance__{part}": 2e-5})
    bent = np.concatenate([0.0 * force, np.cross(force @ give, force)], axis=1)
    assert found == pytest.approx(bent, abs=1e-12)


@pytest.mark.parametrize(
    ("name", "given"),
    [
        ("tool.flexure", {"compliance__x": 2e-5, "bending": 2e-3}),
        ("tool.loose", {"shift": 1e-3, "way__x": 1.0, "way__z": 0.3}),
    ],
)
def test_only_the_tool_pulls_on_the_tool(name, given):
    """The sensor's own tool side loads its gauges, but bends nothing beyond them."""
    scene = oriented(*TURNS)
    theta = scene.theta.copy()
    theta[scene.robot.parameters.index("sensor.mass")] = 0.5
    found = added(replace(scene, theta=theta), name, **given)
    assert np.abs(found).max() > 1e-4
    assert found == pytest.approx(added(scene, name, **given), abs=1e-12)


def test_a_loose_part_leans_and_without_a_way_goes_nowhere():
    """At 45° about x the load along y is −0.707 of it: with a lean of −0.7 it is nearly midway."""
    scene = oriented([np.pi / 4.0, 0.0, 0.0])
    along = -np.sqrt(0.5)
    found = added(scene, "tool.loose", shift=2e-3, way__y=2.0, way__z=0.0, lean=-0.7)[0]
    lever = 2e-3 * np.tanh((along + 0.7) / 0.05)
    assert found == pytest.approx([0, 0, 0, lever * along * G, 0, 0], abs=1e-12)
    unmoved = added(scene, "tool.loose", shift=2e-3, way__y=1.0, way__z=0.0, lean=along)
    assert np.abs(unmoved).max() < 1e-12
    assert np.abs(added(oriented(*TURNS), "tool.loose", shift=1e-3, way__z=0.0)).max() == 0.0


TIP = 0.089159 - 0.09465 - 0.012
"""Height of the tip of a UR5 at q = 0 [m]: twice as far from the sensor as the CoG."""


@pytest.mark.parametrize(
    ("given", "push", "lever"),
    [
        ({"depth": TIP - 0.01}, 0.0, [0.008, -0.012, 0.142]),
        ({"depth": TIP + 0.04}, 500.0 * 0.04, [0.008, -0.012, 0.142]),
        # Hertz: 8 times the force of 1 cm at 4 cm
        ({"depth": TIP + 0.04, "power": 1.5}, 500.0 * 0.01 * 8.0, [0.008, -0.012, 0.142]),
        ({"depth": TIP + 0.04, "normal.z": 2.0}, 500.0 * 0.04, [0.008, -0.012, 0.142]),
        ({"depth": TIP + 0.04, "reach": 0.5}, 500.0 * 0.034, [0.004, -0.006, 0.071]),
        # the sensor's y is up
        ({"depth": TIP + 0.04, "aside.y": 0.02}, 500.0 * 0.02, [0.008, 0.008, 0.142]),
    ],
)
def test_contact_pushes_by_its_law_where_it_touches(given, push, lever):
    values = {k.replace(".", "__"): v for k, v in given.items()}
    found = added(at("ur5", np.zeros(6)), "environment.contact", stiffness=500.0, **values)[0]
    force = np.array([0.0, push, 0.0])
    assert found == pytest.approx(np.concatenate([force, np.cross(lever, force)]), abs=1e-9)


def test_contact_drags_along_the_plane_at_the_robots_own_tip():
    """World x, y, z are the sensor's x, −z, y."""
    given = {"stiffness": 500.0, "depth": TIP + 0.01, "slide__x": 0.1, "slide__y": 0.2}
    found = added(at("ur5", np.zeros(6)), "environment.contact", **given)[0]
    assert found[:3] == pytest.approx([0.5, 5.0, -1.0], abs=1e-9)

    scene = scene_of("medrue static")
    _, end = scene.robot.tool_pose(scene.joints, scene.theta)
    rotation, origin = scene.pose
    reached = origin + np.einsum("mij,j->mi", rotation, scene.tip)
    assert reached == pytest.approx(end, abs=1e-9)
    assert scene_of("ur5 static").tip == pytest.approx(2.0 * COG)


def test_cables_pull_where_they_hold_and_are_untwisted_at_their_neutral_angle():
    scene = scene_of("ur5 static")
    rotation = Rotation.from_matrix(scene.pose[0])
    point, anchor, pull = [0.02, -0.05, 0.1], np.array([0.3, -0.4, 1.2]), [0.5, 1.0, -2.0]
    given = {f"point__{a}": v for a, v in zip("xyz", point, strict=True)}
    given |= {f"anchor__{a}": v for a, v in zip("xyz", anchor, strict=True)}
    given |= {f"pull__{a}": v for a, v in zip("xyz", pull, strict=True)}
    held = scene.pose[1] + rotation.apply(point)
    line = anchor - held
    far = np.linalg.norm(line, axis=1, keepdims=True)
    force = rotation.inv().apply(4.0 * line / far * np.maximum(far - 0.9, 0.0) + pull)
    found = added(scene, "cable.pull", stiffness=4.0, length=0.9, **given)
    assert 0.1 < (far < 0.9).mean() < 0.9
    assert found == pytest.approx(loads(force, point), abs=1e-9)
    q = np.zeros((3, 6))
    q[:, 5] = 0.0, 1.0, 3.0
    found = added(at("ur5", q), "cable.torsion", stiffness=5e-3, neutral=1.0)
    assert found[:, 5] == pytest.approx([5e-3, 0.0, -10e-3], abs=1e-12)


def test_backlash_and_gear_errors_of_joints():
    s = at("ur5", [np.zeros(6), [0, 0.1, 0, 0, 0, 0], [0, 0.05, 0, 0, 0, 0]])
    way = displacement(s, "joint.backlash", joint=2, approach=2e-4)
    assert way[:, 1] == pytest.approx([0.0, -2e-4, 2e-4])
    # upright axis: no torque, no side
    assert np.abs(displacement(s, "joint.backlash", joint=1, load=2e-4)).max() < 1e-12
    s = motion("ur5", seconds=2.0)
    dq = displacement(s, "joint.gear_error", joint=2, sin=3e-4, cos=1e-4, order=20.0)[..., 1]
    angle, rate = 20.0 * s.q.v[:, 1], 20.0 * s.q.d[:, 1]
    assert dq.v == pytest.approx(3e-4 * np.sin(angle) + 1e-4 * np.cos(angle))
    assert dq.d == pytest.approx(rate * (3e-4 * np.cos(angle) - 1e-4 * np.sin(angle)))


def test_tools_that_bend_or_stick():
    found = added(oriented([np.pi / 4.0, 0.0, 0.0]), "tool.flexure", bending=2e-3)[0]
    assert found == pytest.approx([0, 0, 0, 2e-3 * 0.1**2 * G**2 / 2, 0, 0], abs=1e-12)
    angle = np.deg2rad([40.0, 10.0, -10.0, -40.0, 10.0]) / 2
    s = at("oriented", np.stack([np.cos(angle), np.sin(angle), 0 * angle, 0 * angle], axis=1))
    given = {"shift": 1e-3, "way__y": 1.0, "way__z": 0.0, "grip": 0.3}
    found, slide = added(s, "tool.loose", **given)[:, 3], 0.2 * (np.sin(angle[0] * 2) - 0.3)
    assert np.sign(found).tolist() == [1, 1, 1, -1, -1]
    late = added(replace(s, t=0.1 * np.arange(5.0)), "tool.loose", **given, slide=slide)[:, 3]
    assert late / found == pytest.approx([1, 1, 1, -1, -0.5])  # half its half way, of 0.2 s


def test_a_twisted_cable_turns_back_and_rubs():
    q = np.zeros((3, 6))
    q[:, 5] = 0.0, 1.0, 0.5
    found = added(at("ur5", q), "cable.torsion", stiffness=5e-3, friction=1e-3)
    assert found[:, 5] == pytest.approx([0.0, -6e-3, -1.5e-3], abs=1e-12)
    assert np.abs(found[:, :5]).max() == 0.0
    robot = registry.load("robots", "medrue")
    s = at("medrue", robot.sample(5, np.random.default_rng(1)))
    found = added(s, "cable.torsion", stiffness=5e-3, joint_axis=1.0)[:, 3:]
    p = robot.values(s.theta)
    u = kinematics.solved(p, s.q).u
    rotation, _ = robot.sensor_pose(s.q, s.theta)
    expected = -5e-3 * s.q[:, 5:] * (np.swapaxes(rotation, 1, 2) @ u[..., None])[..., 0]
    assert found == pytest.approx(expected, abs=1e-12)


def five_bars():
    s = at("medrue", registry.load("robots", "medrue").sample(30, np.random.default_rng(2)))
    p = s.robot.values(s.theta)
    return s, p, [kinematics.five_bar(p, i, s.q[:, 2 * i - 1], s.q[:, 2 * i]) for i in (1, 2)]


def lifted(s, p, bars):
    """What another geometry of the five-bars adds to the readings (M, 6); the base is upright."""
    _, design, drawn = five_bars()
    nominal = kinematics.carried(design, s.q, *drawn).wrist
    moved = kinematics.carried(p, s.q, *bars).wrist
    sensor, _ = s.robot.sensor_pose(s.q, s.theta)
    loads = []
    for rotation in (sensor, moved @ np.swapaxes(nominal, 1, 2) @ sensor):
        force = float(s.tool.mass) * np.swapaxes(rotation, 1, 2) @ s.gravity
        loads.append(np.concatenate([force, np.cross(s.tool.cog, force)], axis=1))
    return loads[1] - loads[0]


@pytest.mark.parametrize("i", [1, 2])
def test_a_tip_with_play_hangs_lower_and_no_link_turns(i):
    s, p, bars = five_bars()
    down = np.array([0.0, -1e-5])
    bar = bars[i - 1]
    bars[i - 1] = kinematics.FiveBar(bar.B, bar.D + down, bar.E + down, bar.direction)
    found = added(s, "joint.clearance", **{f"play.{i}": 1e-5})
    expected = lifted(s, p, bars)
    assert np.linalg.norm(found - expected) < 1e-3 * np.linalg.norm(expected)


@pytest.mark.parametrize("i", [1, 2])
def test_links_with_slack_give_way_to_the_weight_that_mujoco_puts_on_them(i):
    s, p, bars = five_bars()
    angles = s.q[:, 2 * i - 1], s.q[:, 2 * i]
    names = (f"L{i}2", f"L{i}4")
    push = link_forces(s.robot, s.theta, s.q, s.gravity, names)
    changed = dict(p)
    for k, name in enumerate(names):
        changed[name] = p[name] + 1e-5 * np.tanh(push[:, k] / 0.5)
    bars[i - 1] = kinematics.five_bar(changed, i, *angles)
    found = added(s, "joint.clearance", **{f"slack.{name}": 1e-5 for name in names})
    expected = lifted(s, changed, bars)
    assert np.linalg.norm(found - expected) < 1e-3 * np.linalg.norm(expected)


def test_a_negative_play_of_tip_1_is_told_as_one_of_tip_2():
    s, _, _ = five_bars()
    effect = registry.load("effects", "joint.clearance")
    values = effect.values(s.robot, {"play.1": -2e-5})
    told = effect.publish(s.robot, effect.variants(s)[0], values, {"play.1": 1e-6})
    assert told == {"play.2": {"value": 2e-5, "std": 1e-6, "unit": "m"}}
    other = added(s, "joint.clearance", **{"play.2": 2e-5})
    assert added(s, "joint.clearance", **{"play.1": -2e-5}) == pytest.approx(other, abs=1e-6)


def test_mass_lost_beside_the_cog_takes_its_torque_along():
    """The sensor's z is up: 0.1 kg at x = 50 mm turned the tool by +0.05·0.1·g about y."""
    upright = at("oriented", np.tile([1.0, 0.0, 0.0, 0.0], (2, 1)))
    scene = replace(upright, t=np.array([0.0, 100.0]))
    found = added(scene, "tool.leak", rate=1e-3, place__x=0.05)
    assert found[1] == pytest.approx([0.0, 0.0, 0.1 * G, 0.0, -0.05 * 0.1 * G, 0.0])


LEAK = {"rate": 1e-4, "wave.1": 5e-3, "wave.3": -1e-3, "duration": 200.0}
SLIDE = {"rate.x": 1e-5, "rate.z": -4e-6, "wave.y.2": 5e-4, "duration": 200.0}


@pytest.mark.parametrize("label", ["ur5 static", "medrue static", "ur5 motion"])
def test_each_row_is_that_of_a_robot_with_the_tool_as_it_is_by_then(label):
    """MuJoCo with another mass and CoG for each row, in motion Newton and Euler."""
    scene = scene_of(label)
    tool, age = scene.tool, scene.t - scene.t[0]
    share = np.minimum(age / 200.0, 1.0)
    lost = 1e-4 * age + 5e-3 * np.sin(np.pi * share) - 1e-3 * np.sin(3.0 * np.pi * share)
    zero = np.zeros_like(age)
    moved = np.stack([1e-5 * age, 5e-4 * np.sin(2.0 * np.pi * share), -4e-6 * age], axis=1)
    for name, given, mass, cog in (
        ("tool.leak", LEAK, tool.mass - lost, tool.cog + zero[:, None]),
        ("tool.slide", SLIDE, tool.mass + zero, tool.cog + moved),
    ):
        found = change(name, label, given) + respond(scene)
        for i in range(0, len(age), 40):
            theta = scene.robot.theta_of_tool(scene.theta, float(mass[i]), cog[i].tolist())
            if scene.moving:
                whole = Scene(scene.robot, theta, scene.gravity, scene.q, scene.t, scene.held)
                expected = respond(whole)[i]
            else:
                expected = Simulation(scene.robot, theta).wrench(scene.joints[i : i + 1])[0]
            assert found[i] == pytest.approx(expected, abs=1e-9)
