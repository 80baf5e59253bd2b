"""UR5 against the manufacturer's DH table, written down once more here."""

import mujoco
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from wrenchbed import registry
from wrenchbed.simulation.simulation import Simulation

ROBOT = registry.load("robots", "ur5")
# CB3 manual, "UR5 serie 3": a, d [m], alpha
DH = (
    (0.0, 0.089159, np.pi / 2), (-0.425, 0.0, 0.0), (-0.39225, 0.0, 0.0),
    (0.0, 0.10915, np.pi / 2), (0.0, 0.09465, -np.pi / 2), (0.0, 0.0823, 0.0),
)  # fmt: skip


def dh_flange(q: np.ndarray) -> np.ndarray:
    """Product of the classic 4 × 4 DH matrices."""
    pose = np.eye(4)
    for angle, (a, d, alpha) in zip(q, DH, strict=True):
        c, s, ca, sa = np.cos(angle), np.sin(angle), np.cos(alpha), np.sin(alpha)
        pose = pose @ np.array(
            [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]]
        )
    return pose


def test_the_flange_stands_where_the_dh_table_says():
    theta = ROBOT.parameters.nominal
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (1000, 6))
    rotation, position = ROBOT.flange_pose(q, theta)
    simulation = Simulation(ROBOT, theta)
    for i, row in enumerate(q):
        wanted = dh_flange(row)
        simulation.data.qpos[:] = row
        mujoco.mj_kinematics(simulation.model, simulation.data)
        flange = simulation.data.body("flange")
        for r, p in ((rotation[i], position[i]), (flange.xmat.reshape(3, 3), flange.xpos)):
            assert np.abs(r - wanted[:3, :3]).max() < 1e-12
            assert np.abs(p - wanted[:3, 3]).max() < 1e-12


def test_at_zero_the_arm_lies_along_minus_x():
    """All joints at 0: the flange's height is d1 − d5, its reach a2 + a3, its side −d4 − d6."""
    _, position = ROBOT.flange_pose(np.zeros((1, 6)), ROBOT.parameters.nominal)
    assert np.allclose(position[0], [-0.81725, -0.19145, -0.005491], atol=1e-12)


def test_the_tool_hanging_down_pulls_with_plus_m_g():
    q = np.array([[0.0, -np.pi / 2, -np.pi / 2, -np.pi / 2, np.pi / 2, 0.0]])
    theta = ROBOT.parameters.nominal
    rotation, _ = ROBOT.sensor_pose(q, theta)
    assert np.allclose(rotation[0, :, 2], [0, 0, -1], atol=1e-12)
    load = Simulation(ROBOT, theta).wrench(q)[0]
    assert np.allclose(load[:3], [0, 0, 1.35 * 9.80665], atol=1e-12)
    weight = 1.35 * 9.80665
    assert np.allclose(load[3:], np.cross([0.004, -0.006, 0.071], [0, 0, weight]), atol=1e-12)


def test_base_tilt_turns_gravity_as_the_base_sees_it():
    q = np.zeros((1, 6))
    theta = ROBOT.parameters.vector({"base.tilt.x": 0.1})
    rotation, _ = ROBOT.sensor_pose(q, theta)
    nominal, _ = ROBOT.sensor_pose(q, ROBOT.parameters.nominal)
    seen = nominal[0] @ rotation[0].T @ np.array([0.0, 0.0, -1.0])  # gravity in the base
    assert np.allclose(seen, [0.0, np.sin(0.1), -np.cos(0.1)], atol=1e-12)


@given(seed=st.integers(0, 10_000))
@settings(max_examples=50, deadline=None)
def test_inverse_kinematics_finds_the_pose_and_nothing_else(seed):
    q = ROBOT.sample(1, np.random.default_rng(seed))
    theta = ROBOT.parameters.nominal
    rotation, position = ROBOT.flange_pose(q, theta)
    ways = ROBOT.inverse(rotation[0], position[0])
    assert 2 <= len(ways) <= 8
    again, there = ROBOT.flange_pose(ways, theta)
    assert np.abs(again - rotation).max() < 1e-9
    assert np.abs(there - position).max() < 1e-9
    apart = np.abs(np.angle(np.exp(1j * (ways - q)))).max(axis=1)
    assert apart.min() < 1e-6
    assert (np.abs(ways) <= np.pi + 1e-12).all()


def test_what_is_out_of_reach_has_no_solution():
    assert len(ROBOT.inverse(np.eye(3), np.array([2.0, 0.0, 0.3]))) == 0
    assert len(ROBOT.inverse(np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.05, 0.2]))) == 0
