"""A load in motion: the regressor against plain vector algebra, and its changes by differences."""

import numpy as np
import pytest

from wrenchbed import registry
from wrenchbed.physics.newton_euler import Motion, load, motion_of, regressor
from wrenchbed.physics.time_derivatives import Jet
from wrenchbed.physics.wrench import Tool
from wrenchbed.simulation.closed_form import Model

RNG = np.random.default_rng(5)
TOOL = Tool(
    np.array(1.3), np.array([0.02, -0.05, 0.08]),
    np.array([[4e-3, 2e-4, -3e-4], [2e-4, 5e-3, 1e-4], [-3e-4, 1e-4, 3e-3]]), np.array(0.2),
)  # fmt: skip
MOTION = Motion(*RNG.standard_normal((3, 3, 20)))


def by_hand(motion):
    """Force and torque row by row, with np.cross and the inertia about the centre of gravity."""
    rows = []
    for o, w, u in zip(*(x.T for x in motion), strict=True):
        centre = o + np.cross(u, TOOL.cog) + np.cross(w, np.cross(w, TOOL.cog))
        force = -TOOL.mass * centre
        couple = TOOL.inertia @ u + np.cross(w, TOOL.inertia @ w)
        rows.append([*(force - TOOL.sensor_mass * o), *(np.cross(TOOL.cog, force) - couple)])
    return np.array(rows)


def test_a_load_is_that_of_newton_and_euler_also_by_the_regressor():
    np.testing.assert_allclose(load(MOTION, TOOL.inertial), by_hand(MOTION), atol=1e-13)
    np.testing.assert_allclose(regressor(MOTION) @ TOOL.inertial, by_hand(MOTION), atol=1e-13)


@pytest.mark.parametrize("name", ["ur5", "medrue"])
def test_motion_and_its_jacobian_are_those_of_the_pose(name):
    robot = registry.load("robots", name)
    model, own = Model.of(robot), len(robot.parameters)
    q = robot.sample(8, RNG)
    jets = Jet(q, 0.3 * RNG.standard_normal(q.shape), RNG.standard_normal(q.shape))
    theta = model.parameters.nominal + 0.01 * RNG.standard_normal(len(model.parameters))

    def reading(x):
        pose = robot.sensor_pose(jets, x[:own])
        motion = motion_of(*pose, np.asarray(model.gravity))
        return model.read(load(motion, robot.tool(x[:own]).inertial), x)

    np.testing.assert_allclose(model.predict(jets, theta), reading(theta), atol=1e-12)
    columns, step = range(len(theta)), 1e-6 * np.eye(len(theta))
    expected = np.stack([reading(theta + s) - reading(theta - s) for s in step], axis=-1) / 2e-6
    np.testing.assert_allclose(model.jacobian(jets, theta, columns), expected, atol=1e-6)
