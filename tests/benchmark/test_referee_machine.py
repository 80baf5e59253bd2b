"""The referee's machine at rest as closed forms say; curves that are no formula of the library."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from wrenchbed import registry
from wrenchbed.benchmark.fault import named
from wrenchbed.benchmark.referee import machine
from wrenchbed.benchmark.referee.case import as_case, robot_with_minor
from wrenchbed.benchmark.referee.machine import Mechanics, RefereeFault, ride, touched
from wrenchbed.benchmark.referee.scenario import through
from wrenchbed.diagnosis.diagnose import diagnose


def scene(name, n=6):
    robot = registry.load("robots", name)
    poses = robot.sample(n, np.random.default_rng(4))
    path = through(robot, poses, 5, 100.0, np.zeros(n))
    truth = Mechanics(
        robot.parameters.nominal, np.array(robot.gravity), np.zeros(len(robot.joints))
    )
    return robot, poses, path, truth


def weight(robot, poses, truth):
    """Force of the tool's weight in sensor axes (N, 3) [N]."""
    rotation, _ = robot.sensor_pose(poses, truth.theta)
    mass = float(robot.tool(truth.theta).mass)
    return mass * np.einsum("nij,i->nj", rotation, truth.gravity)


def held(path, x):
    return x[path.rows].reshape(-1, 5, *x.shape[1:]).mean(axis=1)


@pytest.mark.parametrize("name", ["ur5", "medrue"])
def test_a_rigid_machine_at_rest_weighs_what_statics_say(name):
    robot, poses, path, truth = scene(name)
    found = held(path, ride(robot, truth, path).load)
    force = weight(robot, poses, truth)
    torque = np.cross(robot.tool(truth.theta).cog, force)
    assert np.abs(found[:, :3] - force).max() < 2e-4
    assert np.abs(found[:, 3:] - torque).max() < 2e-5


def test_a_soft_joint_turns_by_its_torque_over_its_stiffness():
    robot, poses, path, truth = scene("ur5")
    k = 2e4
    soft = replace(truth, compliance=np.eye(6)[2] / k)
    found = held(path, ride(robot, soft, path).load)
    torque = robot.gravity_torque(poses, truth.theta, truth.gravity)
    bent = poses.copy()
    for _ in range(5):  # the torque is that of the bent arm
        bent[:, 2] = poses[:, 2] + robot.gravity_torque(bent, truth.theta, truth.gravity)[:, 2] / k
    assert np.abs(torque[:, 2] / k).max() > 1e-3
    assert np.abs(found[:, :3] - weight(robot, bent, truth)).max() < 1e-3


def test_a_gear_with_play_rests_where_the_weight_pulls():
    robot, poses, path, truth = scene("ur5")
    width = np.deg2rad(0.5)
    loose = replace(truth, backlash={1: machine.Backlash(width, 0.1)})
    found = held(path, ride(robot, loose, path).load)
    side = np.sign(robot.gravity_torque(poses, truth.theta, truth.gravity)[:, 1])
    turned = poses.copy()
    turned[:, 1] += 0.5 * width * side
    assert np.abs(found[:, :3] - weight(robot, turned, truth)).max() < 5e-3


def test_hoses_and_pads_push_and_pull_with_their_stiffness():
    robot, poses, path, truth = scene("ur5")
    hook, point = np.array([0.2, 0.1, 1.6]), np.array([0.0, 0.01, 0.05])
    rotation, position = robot.sensor_pose(poses, truth.theta)
    line = hook - (position + rotation @ point)
    length = np.linalg.norm(line, axis=1)
    slack = float(np.median(length))
    rope = replace(truth, devices=(machine.Hose(hook, point, slack, 4.0),))
    difference = held(path, ride(robot, rope, path).load - ride(robot, truth, path).load)
    pull = (4.0 * np.maximum(length - slack, 0.0) / length)[:, None] * line
    force = np.einsum("nij,ni->nj", rotation, pull)
    assert (length < slack).any()
    assert np.abs(difference[:, :3] - force).max() < 2e-3
    assert np.abs(difference[:, 3:] - np.cross(point, force)).max() < 2e-4
    tip, radius, k = np.array([0.0, 0.0, 0.14]), 0.01, 400.0
    height = (position + rotation @ tip)[:, 2]
    level = float(np.sort(height)[2])
    pad = machine.Pad(
        np.array([0.0, 0.0, level - radius]), np.array([0.0, 0.0, 1.0]), k, 0.0, tip, radius
    )
    difference = held(
        path, ride(robot, replace(truth, devices=(pad,)), path).load - ride(robot, truth, path).load
    )
    up = np.einsum("nij,nj->ni", rotation, difference[:, :3])[:, 2]
    deep = np.maximum(level - height, 0.0)
    assert up[deep > 0.01] == pytest.approx(k * deep[deep > 0.01], rel=0.05)
    assert np.abs(up[deep == 0.0]).max() < 0.02


def test_a_loose_part_lies_at_the_stop_that_is_below():
    robot, poses, path, truth = scene("ur5")
    axis, share, stop = np.array([1.0, 0.0, 0.0]), 0.1, 5e-3
    part = replace(truth, devices=(machine.LoosePart(share, axis, stop, 0.05),))
    difference = held(path, ride(robot, part, path).load - ride(robot, truth, path).load)
    force = weight(robot, poses, truth)
    shift = share * stop * np.sign(force @ axis)[:, None] * axis
    clear = np.abs(force @ axis) > 1.35  # 1 m/s² of gravity
    assert clear.sum() > 2
    wanted = np.cross(shift, force)
    assert np.abs(difference[clear, 3:] - wanted[clear]).max() < 2e-4


def wave(setting, rng, size):
    """A converter's integral nonlinearity, less its straight line, which would be a gain."""
    turns, phase = rng.uniform(2.5, 6.0), rng.uniform(0.0, 2.0 * np.pi)
    bend = 2e-3 * size * setting.full_scale * touched(rng)
    usual = setting.nominal / setting.swing
    lines = np.stack([np.polyfit(u, np.sin(turns * u + phase), 1) for u in usual.T])

    def gauge(ride, y):
        u = y / setting.swing
        return y + bend * (np.sin(turns * u + phase) - lines[:, 0] * u - lines[:, 1])

    return RefereeFault(change=gauge, stage=machine.BEND)


@pytest.mark.slow
def test_a_form_without_a_formula_has_the_name_of_its_effect():
    seed, effect = (101, 2), "sensor.nonlinearity"
    rng = np.random.default_rng([*seed, 7])
    world, minor = robot_with_minor("ur5", "static", seed, rng)
    draw, size = partial(named, effect, wave), 1.0
    for _ in range(3):  # to a gap of 15
        cause = world.measured(draw(world.setting, np.random.default_rng(seed), size))
        size *= float(np.sqrt(15.0 / cause.gap))
    assert cause.gap > 5.0
    found = diagnose(as_case("single", world, [cause], minor, rng).recording).diagnosis
    assert found.which[0]["effect"] == effect
    assert found.which[0].get("form") == "free"
    curve = found.which[0]["curve"]
    assert len(curve["x"]) == len(curve["y"]) == len(curve["std"])
    assert np.isfinite([*curve["x"], *curve["y"], *curve["std"]]).all()
