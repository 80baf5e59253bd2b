"""Universal Robots' other arms against files of them that come from elsewhere."""

import numpy as np
import pytest

from arm_files import DATA
from wrenchbed.robots.described import describe
from wrenchbed.robots.ur_family import NAMES, ur_arm
from wrenchbed.simulation.closed_form import Model
from wrenchbed.simulation.simulation import Simulation

REACH = {"ur3": 0.5, "ur3e": 0.5, "ur5e": 0.85, "ur10": 1.3, "ur10e": 1.3, "ur16e": 0.9,
         "ur20": 1.75}  # fmt: skip
PAYLOAD_MASS = {"ur3": 11.0, "ur3e": 11.2, "ur5e": 20.6, "ur10": 28.9, "ur10e": 33.5,
                "ur16e": 33.1, "ur20": 64.0}  # fmt: skip
# reach [m] and weight with cable [kg] of the data sheets


@pytest.mark.parametrize(
    ("file", "frame", "name", "off"),
    [("ur10.urdf", "tool0", "ur10", 1e-5), ("ur5e.xml", "right_hand", "ur5e", 4e-3)],
)
def test_the_flange_is_where_the_file_of_others_has_it(file, frame, name, off, tmp_path):
    """ROS and robosuite turn the base by half a turn about z; robosuite rounds lengths to mm."""
    theirs = describe(
        DATA / file, frame, tmp_path / "my.toml", tool_mass=1.0, tool_cog=(0.0, 0.0, 0.05)
    ).robot
    ours = ur_arm(name)
    assert ours.joint_names == theirs.joint_names
    q = ours.sample(100, np.random.default_rng(3))
    turned, placed = theirs.sensor_pose(q, theirs.parameters.nominal)
    rotation, position = ours.flange_pose(q, ours.parameters.nominal)
    half = np.diag([-1.0, -1.0, 1.0])
    assert np.abs(turned - half @ rotation).max() < 1e-8
    assert np.abs(placed - position @ half).max() < off


@pytest.mark.parametrize("name", NAMES)
def test_each_arm_reaches_weighs_and_turns_back_as_it_should(name):
    arm = ur_arm(name)
    theta, rng = arm.parameters.nominal, np.random.default_rng(4)
    q = arm.sample(12, rng)
    model = Model.of(arm)
    measured = Simulation(arm, theta).wrench(q)
    assert np.abs(measured - model.true_wrench(q, model.parameters.nominal)).max() < 1e-10
    assert sum(link.body.mass for link in arm.arm.links) < PAYLOAD_MASS[name]  # without its base
    lengths = sum(abs(link.a) for link in arm.arm.links) + arm.arm.links[4].d
    assert lengths == pytest.approx(REACH[name], rel=0.1)
    for row in q:
        rotation, position = arm.flange_pose(row[None], theta)
        found = arm.inverse(rotation[0], position[0])
        off = np.abs(np.angle(np.exp(1j * (found - row)))).max(axis=1)
        assert off.min() < 1e-8
        turns, places = arm.flange_pose(found, theta)
        assert np.abs(places - position[0]).max() < 1e-9
        assert np.abs(turns - rotation[0]).max() < 1e-9
