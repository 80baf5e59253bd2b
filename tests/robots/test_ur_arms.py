"""Universal Robots' arms against files of them that come from elsewhere."""

import json
import math

import numpy as np
import pytest

import wrenchbed as wb
from arm_files import DATA
from wrenchbed.physics.rotations import rot_x, rot_z
from wrenchbed.robots.ur5 import NAMES, ROBOT, ur_arm

DESCRIPTION = json.loads((DATA / "ur_description.json").read_text())
ROLL = (0.0, math.pi / 2, 0.0, 0.0, math.pi / 2, -math.pi / 2)
"""Of each link in the one before; the file's third, (pi/2, pi, pi), is the last here."""


def arm_of(name):
    return ROBOT if name == "ur5" else ur_arm(name)


def described_links(name, q):
    """Origin and axes of each link, and its CoG, by the maker's ROS description (base axes)."""
    told, turn, place, links = DESCRIPTION[name], np.eye(3), np.zeros(3), []
    for xyz, roll, cog, angle in zip(told["xyz"], ROLL, told["cog"], q, strict=True):
        place = place + turn @ np.array(xyz)
        turn = turn @ rot_x(roll) @ rot_z(angle)
        links.append((turn, place, place + turn @ np.array(cog)))
    return links


@pytest.mark.parametrize("name", ["ur5", *NAMES])
def test_an_arm_is_that_of_the_makers_ros_description(name):
    """Flange, masses, top speeds, and where each link's weight acts; other code and data."""
    arm, told = arm_of(name), DESCRIPTION[name]
    for q in arm.sample(5, np.random.default_rng(8)):
        links = described_links(name, q)
        rotation, position = arm.flange_pose(q[None], arm.parameters.nominal)
        assert np.abs(position[0] - links[-1][1]).max() < 1e-8
        assert np.abs(rotation[0] - links[-1][0]).max() < 1e-8
        turn, place = np.eye(3), np.zeros(3)
        for link, angle, (_, _, cog) in zip(arm.arm.links, q, links, strict=True):
            turn = turn @ rot_z(angle)
            off = 2.6e-3 if name == "ur20" and link is arm.arm.links[-1] else 2e-6
            assert np.abs(place + turn @ np.array(link.body.cog) - cog).max() < off
            place = place + turn @ np.array([link.a, 0.0, link.d])
            turn = turn @ rot_x(link.alpha)
    masses = [link.body.mass for link in arm.arm.links]
    if name == "ur20":  # the article's 0.846 kg
        assert masses.pop() == 0.846
    assert masses == told["mass"][: len(masses)]
    if name != "ur8long":
        assert np.degrees([link.speed for link in arm.arm.links]) == pytest.approx(told["speed"])


@pytest.mark.parametrize("name", ["ur5", *NAMES])
def test_each_arm_weighs_and_turns_back_as_it_should(name):
    arm = arm_of(name)
    theta, rng = arm.parameters.nominal, np.random.default_rng(4)
    q = arm.sample(12, rng)
    model = wb.Model.of(arm)
    measured = wb.Simulation(arm, theta).wrench(q)
    assert np.abs(measured - model.true_wrench(q, model.parameters.nominal)).max() < 1e-10
    for row in q:
        rotation, position = arm.flange_pose(row[None], theta)
        found = arm.inverse(rotation[0], position[0])
        assert 2 <= len(found) <= 8
        assert (np.abs(found) <= np.pi + 1e-12).all()
        off = np.abs(np.angle(np.exp(1j * (found - row)))).max(axis=1)
        assert off.min() < 1e-8
        turns, places = arm.flange_pose(found, theta)
        assert np.abs(places - position[0]).max() < 1e-9
        assert np.abs(turns - rotation[0]).max() < 1e-9


def test_the_tool_hanging_down_pulls_with_plus_m_g():
    q = np.array([[0.0, -np.pi / 2, -np.pi / 2, -np.pi / 2, np.pi / 2, 0.0]])
    theta = ROBOT.parameters.nominal
    rotation, _ = ROBOT.sensor_pose(q, theta)
    assert np.allclose(rotation[0, :, 2], [0, 0, -1], atol=1e-12)
    load = wb.Simulation(ROBOT, theta).wrench(q)[0]
    weight = 1.35 * 9.80665
    assert np.allclose(load[:3], [0, 0, weight], atol=1e-12)
    assert np.allclose(load[3:], np.cross([0.004, -0.006, 0.071], [0, 0, weight]), atol=1e-12)


def test_what_is_out_of_reach_has_no_solution():
    assert len(ROBOT.inverse(np.eye(3), np.array([2.0, 0.0, 0.3]))) == 0
    assert len(ROBOT.inverse(np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.05, 0.2]))) == 0
