"""Effects of joints, links, tool, cable and contact against statics done by hand."""

from dataclasses import replace

import numpy as np
import pytest
from effect_scenes import added, at, change, displacement, motion, scene_of

from wrenchbed import registry
from wrenchbed.benchmark.lookalikes.mechanics import link_forces
from wrenchbed.effects.chain import respond
from wrenchbed.effects.scene import Scene
from wrenchbed.robots.medrue import kinematics
from wrenchbed.simulation.simulation import Simulation

G = 9.80665


def test_backlash_and_gear_errors_of_joints():
    s = at("ur5", [np.zeros(6), [0, 0.1, 0, 0, 0, 0], [0, 0.05, 0, 0, 0, 0]])
    load = displacement(s, "joint.backlash", joint=2, load=2e-4)
    assert load[:, 1] == pytest.approx(2e-4)
    way = displacement(s, "joint.backlash", joint=2, approach=2e-4)
    assert way[:, 1] == pytest.approx([0.0, -2e-4, 2e-4])
    idle = displacement(s, "joint.backlash", joint=1, load=2e-4)
    assert np.abs(idle).max() < 1e-12  # upright axis: no torque, no side
    s = motion("ur5", seconds=2.0)
    dq = displacement(s, "joint.gear_error", joint=2, sin=3e-4, cos=1e-4, order=20.0)[..., 1]
    angle, rate = 20.0 * s.q.v[:, 1], 20.0 * s.q.d[:, 1]
    assert dq.v == pytest.approx(3e-4 * np.sin(angle) + 1e-4 * np.cos(angle))
    assert dq.d == pytest.approx(rate * (3e-4 * np.cos(angle) - 1e-4 * np.sin(angle)))


def at_45_degrees(sign=1.0):
    """A tool of 1 kg at 45° about x: 6.93 N along −y (+y for sign −1) and −z of the sensor."""
    half = np.deg2rad(22.5)
    s = at("oriented", [np.cos(half), sign * np.sin(half), 0.0, 0.0])
    theta = s.robot.theta_of_tool(s.theta, 1.0, [0.0, 0.0, 0.1])
    return replace(s, theta=theta)


def test_tools_that_bend_or_stick():
    found = added(at_45_degrees(), "tool.flexure", bending=2e-3)[0]
    assert found == pytest.approx([0, 0, 0, 2e-3 * 0.1**2 * G**2 / 2, 0, 0], abs=1e-12)
    angle = np.deg2rad([40.0, 10.0, -10.0, -40.0, 10.0]) / 2
    zero = np.zeros(5)
    s = at("oriented", np.stack([np.cos(angle), np.sin(angle), zero, zero], axis=1))
    found = added(s, "tool.loose", shift=1e-3, way__y=1.0, way__z=0.0, grip=0.3)[:, 3]
    assert np.sign(found).tolist() == [1, 1, 1, -1, -1]


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


# ---- five-bars -------------------------------------------------------------------------------


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


# ---- tools that leak or slide ------------------------------------------------------------------


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
