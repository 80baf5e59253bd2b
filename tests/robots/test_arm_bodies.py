"""What gravity does to the arm, against MuJoCo with the bodies' weight switched on."""

import mujoco
import numpy as np
import pytest
from test_robots import each_robot, feasible, random_theta

from wrenchbed import registry
from wrenchbed.errors import NotFoundError
from wrenchbed.robots.serial_arm import SerialArm

POSES = 12


class Heavy:
    """A robot in MuJoCo, every body with its weight, at random poses."""

    def __init__(self, robot, theta, seed):
        self.robot, self.theta, self.gravity = robot, theta, np.array(robot.gravity)
        self.q = feasible(robot, POSES, theta, seed)
        spec = robot.spec(theta)
        spec.option.gravity = robot.gravity
        self.model = spec.compile()
        self.model.body_gravcomp[:] = 0.0
        self.data = mujoco.MjData(self.model)
        base = self.model.body("base").id
        self.moving = [b for b in range(self.model.nbody) if b not in (0, base)]

    def at(self, q, read):
        """What ``read`` finds in MuJoCo's data at each pose (N, J)."""
        rows = []
        for row in self.robot.qpos(q, self.theta):
            self.data.qpos[:] = row
            mujoco.mj_forward(self.model, self.data)
            rows.append(read(self.data).copy())
        return np.array(rows)

    def centres(self, q):
        """(N, bodies, 3) [m]."""
        return self.at(q, lambda data: data.xipos)

    def potential(self, q):
        """(N,) [J]."""
        mass = self.model.body_mass[self.moving]
        return -(self.centres(q)[:, self.moving] @ self.gravity) @ mass


def cases(robot):
    """Two random robots."""
    rng = np.random.default_rng(11)
    return [Heavy(robot, random_theta(robot, rng), seed) for seed in range(2)]


@each_robot
def test_joints_bear_what_mujoco_says(robot):
    """The slope of its potential energy; on serial arms also what holds them, joint by joint."""
    step = 1e-5
    for heavy in cases(robot):
        q = heavy.q
        torque = robot.gravity_torque(q, heavy.theta, heavy.gravity)
        for j, aside in enumerate(step * np.eye(q.shape[1])):
            slope = (heavy.potential(q + aside) - heavy.potential(q - aside)) / (2 * step)
            assert np.abs(torque[:, j] + slope).max() < 1e-5
        if isinstance(robot, SerialArm):
            assert np.abs(torque + heavy.at(q, lambda data: data.qfrc_bias)).max() < 1e-10
            assert np.abs(torque).max() > 20.0


@each_robot
def test_the_moment_at_the_base_is_the_sum_over_mujocos_bodies(robot):
    tilted = np.array([1.5, -2.0, -9.4])
    for heavy in cases(robot):
        levers = heavy.centres(heavy.q)[:, heavy.moving] - heavy.data.body("base").xpos
        weights = heavy.model.body_mass[heavy.moving, None] * tilted
        expected = np.cross(levers, weights).sum(axis=1)
        assert np.abs(expected).max() > 10.0
        assert np.abs(robot.base_moment(heavy.q, heavy.theta, tilted) - expected).max() < 1e-9


def test_a_robot_without_links_says_so():
    robot = registry.load("robots", "oriented")
    q, theta = robot.sample(2, np.random.default_rng(0)), robot.parameters.nominal
    gravity = np.array(robot.gravity)
    for ask, more in ((robot.links, ()), (robot.gravity_torque, (gravity,)),
                      (robot.base_moment, (gravity,))):  # fmt: skip
        with pytest.raises(NotFoundError, match="'oriented' has no masses of links"):
            ask(q, theta, *more)
