"""The rigid tool by hand, in motion by Newton and Euler, and jets of time derivatives."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import wrenchbed as wb
from wrenchbed.calibration.calibrate import identify_from_gravity
from wrenchbed.errors import CalibrationError
from wrenchbed.physics import taylor_jets as td
from wrenchbed.physics.rigid_load_regressor import Motion, load, motion_of, regressor
from wrenchbed.physics.rotations import euler, euler_rates, exp, matrix, quaternion, rotation_vector
from wrenchbed.physics.taylor_jets import Jet
from wrenchbed.physics.wrench import Tool, physical_inertia, wrench

G = np.array([0.0, 0.0, -9.80665])


def tool(mass=2.0, cog=(0.1, 0.0, 0.0), inertia=(0.01, 0.02, 0.03), own=0.0) -> Tool:
    return Tool(np.array(mass), np.array(cog), np.diag(inertia), np.array(own))


def test_weight_acts_at_the_centre_of_gravity_and_only_bodies_have_inertias():
    load = wrench(np.eye(3)[None], np.zeros((1, 3)), tool(own=0.5), G)[0]
    assert np.allclose(load, [0, 0, -2.5 * 9.80665, 0, 0.1 * 2 * 9.80665, 0])
    assert physical_inertia((1.0, 1.0, 1.9, 0, 0, 0))
    assert physical_inertia((0, 0, 0, 0, 0, 0))
    assert not physical_inertia((1.0, 1.0, 2.1, 0, 0, 0))
    assert not physical_inertia((1.0, 1.0, 1.0, 2.0, 0, 0))


@pytest.mark.parametrize("vector", [(0.1, -0.2, 0.3), (2.0, 2.0, -1.0), (0, 0, np.pi), (0, 0, 0)])
def test_a_rotation_vector_makes_its_quaternion_and_back(vector):
    turn = Rotation.from_rotvec(vector)
    for length in (1.0, -2.0):
        assert np.allclose(rotation_vector(length * turn.as_quat(scalar_first=True)), vector)


def test_the_closed_form_is_the_weighted_least_squares_solution():
    rng = np.random.default_rng(1)
    rotation = matrix(rng.normal(size=(40, 4)))
    weight = rng.uniform(0.5, 2.0, 6) ** 2
    y = rng.normal(size=(40, 6)) + wrench(rotation, np.zeros((40, 3)), tool(), G)
    g = G @ rotation
    design = np.zeros((40, 6, 10))
    design[:, :3, 0] = g
    for k, axis in enumerate(np.eye(3)):
        design[:, 3:, 1 + k] = np.cross(axis, g)
    design[:, :, 4:] = np.eye(6)
    root = np.sqrt(weight)
    a = (design * root[:, None]).reshape(-1, 10)
    wanted = np.linalg.lstsq(a, (y * root).ravel(), rcond=None)[0]
    found = identify_from_gravity(G @ rotation, y, weight)
    assert np.isclose(found.mass, wanted[0])
    assert np.allclose(found.cog, wanted[1:4] / wanted[0])
    assert np.allclose(found.bias, wanted[4:])


def test_one_orientation_is_refused_and_two_give_the_shortest_moment():
    rotation = matrix(np.random.default_rng(2).normal(size=(2, 4)))
    y = wrench(rotation, np.zeros((2, 3)), tool(), G)
    found = identify_from_gravity(G @ rotation, y)
    g = G @ rotation
    unseen = g[0] - g[1]
    torque = np.cross(found.mass * found.cog, g) + found.bias[3:]
    assert np.allclose(torque, y[:, 3:], atol=1e-12)
    assert abs(unseen @ found.cog) < 1e-12 < abs(unseen @ tool().cog)
    rotation = np.repeat(np.eye(3)[None], 8, axis=0)
    with pytest.raises(CalibrationError, match="one orientation"):
        identify_from_gravity(G @ rotation, np.ones((8, 6)))


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
    robot = wb.load("robots", name)
    model, own = wb.Model.of(robot), len(robot.parameters)
    q = robot.sample(8, RNG)
    jets = Jet(q, 0.3 * RNG.standard_normal(q.shape), RNG.standard_normal(q.shape))
    theta = model.parameters.nominal + 0.01 * RNG.standard_normal(len(model.parameters))

    def reading(x, jets=jets):
        pose = robot.sensor_pose(jets, x[:own])
        motion = motion_of(*pose, np.asarray(model.gravity))
        return model.read(load(motion, robot.tool(x[:own]).inertial), x)

    other, later = theta + 0.01, jets[::-1]  # the motion that a model keeps is that of these values
    for moved, x in ((jets, theta), (jets, other), (later, other), (jets, theta)):
        np.testing.assert_allclose(model.predict(moved, x), reading(x, moved), atol=1e-12)
    columns, step = range(len(theta)), 1e-6 * np.eye(len(theta))
    expected = np.stack([reading(theta + s) - reading(theta - s) for s in step], axis=-1) / 2e-6
    np.testing.assert_allclose(model.jacobian(jets, theta, columns), expected, atol=1e-6)


finite = st.floats(-3.0, 3.0, allow_nan=False)
positive = st.floats(0.3, 3.0, allow_nan=False)


def jet(v: float, d: float, dd: float) -> Jet:
    return Jet(np.array(v), np.array(d), np.array(dd))


def close(found: Jet, wanted: tuple[float, float, float]) -> bool:
    return np.allclose([found.v, found.d, found.dd], wanted, rtol=1e-11, atol=1e-11)


@given(finite, finite, finite)
def test_a_jet_of_sine_cosine_and_root(v, d, dd):
    s, c = np.sin(v), np.cos(v)
    assert close(td.sin(jet(v, d, dd)), (s, c * d, c * dd - s * d * d))
    assert close(td.cos(jet(v, d, dd)), (c, -s * d, -s * dd - c * d * d))
    x = 4.0 + v
    root = np.sqrt(x)
    wanted = (root, d / (2 * root), dd / (2 * root) - d * d / (4 * root**3))
    assert close(td.jet_sqrt(jet(x, d, dd)), wanted)


@given(positive, finite, finite, positive, finite, finite)
def test_a_quotient_times_its_divisor_is_the_dividend(a, da, dda, b, db, ddb):
    x, y = jet(a, da, dda), jet(b, db, ddb)
    assert close((x / y) * y, (a, da, dda))
    assert close((1.0 / y) * y, (1.0, 0.0, 0.0))
    assert close(x - y + y, (a, da, dda))
    assert close((2.0 - x) + x, (2.0, 0.0, 0.0))


@given(finite, finite, finite, positive, finite)
def test_the_angle_of_a_vector_that_turns_and_grows(angle, rate, acceleration, radius, growth):
    turning, length = jet(angle, rate, acceleration), jet(radius, growth, 0.0)
    found = td.atan2(length * td.sin(turning), length * td.cos(turning))
    assert np.allclose([found.d, found.dd], [rate, acceleration], atol=1e-9)
    assert np.isclose(np.cos(found.v - angle), 1.0)


def test_a_fixed_matrix_is_a_jet_that_stands_still():
    a = Jet(*np.random.default_rng(0).normal(size=(3, 4, 3, 3)))
    m = np.random.default_rng(1).normal(size=(3, 3))
    still = Jet(m, 0.0 * m, 0.0 * m)
    for x, y in ((m @ a, still @ a), (a @ m, a @ still), (m * a, still * a)):
        assert np.allclose([x.v, x.d, x.dd], [y.v, y.d, y.dd])


@given(finite, finite, finite)
def test_rotations_and_quaternions_are_scipys(x, y, z):
    turns = Rotation.from_euler("XYZ", [z, y, x]), Rotation.from_rotvec([x, y, z])
    made = euler(x, y, z), exp(np.array(x), np.array(y), np.array(z))
    for rotation, turn in zip(made, turns, strict=True):
        assert np.allclose(rotation, turn.as_matrix(), atol=1e-12)
        q = quaternion(rotation)
        of_scipy = Rotation.from_matrix(rotation).as_quat(canonical=True, scalar_first=True)
        assert q[0] >= 0 and np.allclose(q, of_scipy, rtol=0, atol=1e-15)
        assert np.allclose(matrix(q), rotation, atol=1e-12)


def test_euler_rates_give_the_angular_velocity_in_turned_axes():
    angles = np.array([0.3, -0.4, 0.7])
    for k in range(3):
        rate = np.zeros(3)
        rate[k] = 1.0
        turning = [
            Jet(np.array(a), np.array(r), np.array(0.0)) for a, r in zip(angles, rate, strict=True)
        ]
        rotation = euler(*turning)
        spin = rotation.v.T @ rotation.d
        omega = [spin[2, 1], spin[0, 2], spin[1, 0]]
        assert np.allclose(omega, euler_rates(*angles)[:, k])
