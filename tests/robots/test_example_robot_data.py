"""Every serial arm of the package example-robot-data, with its meshes: the extra ``robots``."""

from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import numpy as np
import pytest
from test_robots import random_theta

from arm_files import TOOL_COG, TOOL_MASS
from wrenchbed.robots.described import describe
from wrenchbed.simulation.closed_form import Model
from wrenchbed.simulation.simulation import Simulation

ARMS = (
    ("panda_description/urdf/panda.urdf", "panda_link8", 7),
    ("panda_description/urdf/panda_collision.urdf", "panda_link8", 7),
    ("so_arm_description/urdf/so100.urdf", "jaw", 6),
    ("so_arm_description/urdf/so101.urdf", "moving_jaw_so101_v1_link", 6),
    ("z1_description/urdf/z1.urdf", "link06", 6),
    ("ur_description/urdf/ur3_robot.urdf", "tool0", 6),
    ("ur_description/urdf/ur5_robot.urdf", "tool0", 6),
    ("ur_description/urdf/ur5_gripper.urdf", "tool0", 6),
    ("ur_description/urdf/ur10_robot.urdf", "tool0", 6),
    ("kinova_description/robots/kinova.urdf", "j2s6s200_end_effector", 6),
    ("xarm_description/urdf/xarm7.urdf", "link_eef", 7),
    ("talos_data/robots/talos_left_arm.urdf", "wrist_left_ft_link", 6),
    ("tiago_description/robots/tiago.urdf", "wrist_ft_link", 8),
    ("asr_twodof_description/urdf/TwoDofs.urdf", "Tip", 2),
    ("double_pendulum_description/urdf/double_pendulum.urdf", "link2", 2),
    ("finger_edu_description/robots/finger_edu.urdf", "finger_tip_link", 3),
)


@pytest.fixture(scope="module")
def folder() -> Path:
    try:
        found = distribution("example-robot-data")
    except PackageNotFoundError:
        pytest.skip("example-robot-data is not installed: pip install -e '.[robots]'")
    name = "cmeel.prefix/share/example-robot-data/robots"
    return Path(str(found.locate_file(name)))


@pytest.mark.parametrize(("file", "frame", "joints"), ARMS, ids=[Path(a[0]).stem for a in ARMS])
def test_an_arm_is_the_same_in_mujoco_and_in_closed_form(file, frame, joints, folder, tmp_path):
    robot = describe(
        folder / file, frame, tmp_path / "my.toml", tool_mass=TOOL_MASS, tool_cog=TOOL_COG
    ).robot
    assert len(robot.joints) == joints
    rng, model = np.random.default_rng(1), Model.of(robot)
    for k in range(6):
        theta = robot.parameters.nominal if k == 0 else random_theta(robot, rng)
        full = model.parameters.nominal
        full[: len(theta)] = theta
        q = robot.sample(200, rng)
        measured = Simulation(robot, theta).wrench(q)
        assert np.abs(measured - model.true_wrench(q, full)).max() < 1e-10
