"""What gravity does to the arm, against MuJoCo with the bodies' weight switched on."""

import mujoco
import numpy as np
import pytest
from test_robots import ROBOTS, each_robot, feasible, random_theta

from wrenchbed import registry
from wrenchbed.errors import NotFoundError
from wrenchbed.physics.gravity import ArmBodies
from wrenchbed.robots.serial_arm import SerialArm

SERIAL = [robot for robot in ROBOTS if isinstance(robot, SerialArm)]
POSES = 12


class Heavy:
    """A robot in MuJoCo, every body with its weight."""

    def __init__(self, robot, theta):
        self.robot, self.theta = robot, theta
        spec = robot.spec(theta)
        spec.option.gravity = robot.gravity
        self.model = spec.compile()
        self.model.body_gravcomp[:] = 0.0
        self.data = mujoco.MjData(self.model)
        self.gravity = np.array(robot.gravity)
        base = self.model.body("base").id
        self.moving = [b for b in range(self.model.nbody) if b not in (0, base)]

    def centres(self, q):
        """(N, bodies, 3) [m]."""
        return np.array([self._stand(row).xipos.copy() for row in self._qpos(q)])

    def bias(self, q):
        """What holds the arm at each coordinate (N, nv) [N·m]."""
        result = []
        for row in self._qpos(q):
            mujoco.mj_forward(self.model, self._stand(row))
            result.append(self.data.qfrc_bias.copy())
        return np.array(result)

    def potential(self, q):
        """(N,) [J]."""
        mass = self.model.body_mass[self.moving]
        return -(self.centres(q)[:, self.moving] @ self.gravity) @ mass

    def _qpos(self, q):
        return self.robot.qpos(q, self.theta)

    def _stand(self, row):
        self.data.qpos[:] = row
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        return self.data


def cases(robot):
    """Two random robots, each at random poses."""
    rng = np.random.default_rng(11)
    for seed in range(2):
        theta = random_theta(robot, rng)
        yield Heavy(robot, theta), feasible(robot, POSES, theta, seed), theta


@each_robot
def test_the_table_of_links_is_that_of_the_mjcf(robot):
    assert robot.gear_ratio == {"ur5": (101.0,) * 6}.get(robot.name, ())
    model = mujoco.MjModel.from_xml_path(str(robot.mjcf))
    moving = {model.body(b).name for b in range(model.nbody)} - {"world", "base"}
    assert {link.body for link in robot.bodies} == moving - {"tool", "sensor_side"}
    for link in robot.bodies:
        body = model.body(link.body)
        assert body.mass[0] == link.mass
        assert np.array_equal(body.ipos, link.cog)


@each_robot
def test_the_centres_of_gravity_are_where_mujoco_puts_them(robot):
    for heavy, q, theta in cases(robot):
        own = [heavy.model.body(link.body).id for link in robot.bodies]
        masses, centres = robot.links(q, theta)
        assert np.array_equal(heavy.model.body_mass[own], masses)
        assert np.abs(heavy.centres(q)[:, own] - centres).max() < 1e-9


@pytest.mark.parametrize("robot", SERIAL, ids=lambda r: r.name)
def test_joints_of_serial_arms_bear_what_mujoco_says(robot):
    for heavy, q, theta in cases(robot):
        torque = robot.gravity_torque(q, theta, heavy.gravity)
        assert np.abs(torque).max() > 20.0
        assert np.abs(torque + heavy.bias(q)).max() < 1e-6
        general = ArmBodies.gravity_torque(robot, q, theta, heavy.gravity)
        assert np.abs(torque - general).max() < 1e-7


@each_robot
def test_the_torque_is_the_slope_of_mujocos_potential_energy(robot):
    step = 1e-5
    for heavy, q, theta in cases(robot):
        torque = robot.gravity_torque(q, theta, heavy.gravity)
        assert torque.shape == q.shape
        for j in range(q.shape[1]):
            aside = step * np.eye(q.shape[1])[j]
            slope = (heavy.potential(q + aside) - heavy.potential(q - aside)) / (2 * step)
            assert np.abs(torque[:, j] + slope).max() < 1e-5


@each_robot
def test_the_moment_at_the_base_is_the_sum_over_mujocos_bodies(robot):
    tilted = np.array([1.5, -2.0, -9.4])
    for heavy, q, theta in cases(robot):
        levers = heavy.centres(q)[:, heavy.moving] - heavy.data.body("base").xpos
        weights = heavy.model.body_mass[heavy.moving, None] * tilted
        expected = np.cross(levers, weights).sum(axis=1)
        assert np.abs(expected).max() > 10.0
        assert np.abs(robot.base_moment(q, theta, tilted) - expected).max() < 1e-9


def test_a_robot_without_links_says_so():
    robot = registry.load("robots", "oriented")
    q, theta = robot.sample(2, np.random.default_rng(0)), robot.parameters.nominal
    gravity = np.array(robot.gravity)
    for ask in (
        lambda: robot.links(q, theta),
        lambda: robot.gravity_torque(q, theta, gravity),
        lambda: robot.base_moment(q, theta, gravity),
    ):
        with pytest.raises(NotFoundError, match="'oriented' has no masses of links"):
            ask()
