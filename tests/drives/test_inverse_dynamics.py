"""Closed-form joint torques against MuJoCo's inverse dynamics."""

import mujoco
import numpy as np
import pytest
from test_robots import random_theta

from arm_files import CASES, TOOL_COG, TOOL_MASS
from wrenchbed import registry
from wrenchbed.drives.inverse_dynamics import torque_regressor
from wrenchbed.errors import NotFoundError
from wrenchbed.physics.time_derivatives import Jet
from wrenchbed.robots.described import describe
from wrenchbed.robots.link_inertias import link_inertias
from wrenchbed.robots.ur_family import ur_arm


def inverse(robot, theta, q, gravity):
    """MuJoCo's torques (N, J) without friction, gravity compensation and the servos' damping."""
    spec = robot.spec(theta)
    spec.option.gravity = gravity
    model = spec.compile()
    model.body_gravcomp[:], model.opt.integrator = 0.0, mujoco.mjtIntegrator.mjINT_EULER
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data, found = mujoco.MjData(model), []
    for k in range(len(q.v)):
        data.qpos[:] = robot.qpos(q.v[k][None], theta)[0]
        data.qvel[:], data.qacc[:] = q.d[k], q.dd[k]
        mujoco.mj_inverse(model, data)
        found.append(data.qfrc_inverse.copy())
    return np.array(found)


def moving(robot, rng):
    """Joint values, speeds and accelerations (40, J)."""
    at = robot.sample(40, rng)
    return Jet(at, rng.normal(size=at.shape), rng.normal(0.0, 5.0, at.shape))


def agree(robot, rng):
    """Closed form and MuJoCo, at nominal and at random parameters of tool and mount."""
    gravity = np.array([0.7, -0.4, -9.7])
    for theta in (robot.parameters.nominal, random_theta(robot, rng)):
        q, inertias = moving(robot, rng), link_inertias(robot, theta)
        ours = torque_regressor(robot, theta, q, gravity) @ inertias.phi.ravel()
        ours = ours + inertias.rotor * q.dd
        theirs = inverse(robot, theta, q, gravity)
        assert np.abs(theirs).max() > 20.0
        assert np.abs(ours - theirs).max() < 1e-9


@pytest.mark.parametrize("name", ["ur5", "ur10e", "ur20"])
def test_torques_are_those_of_mujoco(name):
    robot = registry.load("robots", "ur5") if name == "ur5" else ur_arm(name)
    agree(robot, np.random.default_rng(1))


@pytest.mark.parametrize("case", CASES, ids=lambda c: c.file)
def test_torques_of_an_arm_from_its_file_are_those_of_mujoco(case, tmp_path):
    stated = {"tool_mass": TOOL_MASS, "tool_cog": TOOL_COG}
    agree(describe(case.path, case.frame, tmp_path / "my.toml", **stated).robot,
          np.random.default_rng(2))  # fmt: skip


def test_a_robot_with_loops_has_no_torque_regressor():
    robot = registry.load("robots", "medrue")
    with pytest.raises(NotFoundError, match="no serial arm"):
        link_inertias(robot, robot.parameters.nominal)
