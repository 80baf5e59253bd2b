"""The UR5 emulator: kinematics, motions and safety, in process, without waiting for real time."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from robot_emulators.kinematic_plant import known_arm
from robot_emulators.ur.kinematics import (
    NO_TOOL,
    Kinematics,
    matrix,
    rotation_vector,
)
from robot_emulators.ur.modes import Runtime, SafetyMode
from robot_emulators.ur.motions import Pace, Profile, ToPose
from ur5_bench import CYCLE, Bench
from wrenchbed import registry
from wrenchbed.simulation.simulation import Simulation

ROBOT = registry.load("robots", "ur5")
NOMINAL = ROBOT.parameters.nominal
TCP = np.array([0.01, -0.02, 0.15, 0.1, 0.2, -0.3])
DOWN = np.array([0.4, -0.11, 0.45, np.pi, 0.0, 0.0])


def random_joints(n: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-3.0, 3.0, (n, 6))


def test_forward_kinematics_are_the_robots_and_mujocos():
    kinematics = Kinematics(known_arm("ur5"))
    simulation = Simulation(ROBOT, NOMINAL)
    for q in random_joints(20, 1):
        rotation, position = kinematics.flange(q)
        expected = ROBOT.flange_pose(q[None], NOMINAL)
        assert rotation == pytest.approx(expected[0][0], abs=1e-12)
        assert position == pytest.approx(expected[1][0], abs=1e-12)
        simulation.data.qpos[:] = ROBOT.qpos(q[None], NOMINAL)[0]
        mujoco.mj_kinematics(simulation.model, simulation.data)
        flange = simulation.data.body("flange")
        assert position == pytest.approx(flange.xpos, abs=1e-9)
        assert rotation.ravel() == pytest.approx(flange.xmat, abs=1e-9)


def test_the_jacobian_is_the_derivative():
    kinematics, step = Kinematics(known_arm("ur5")), 1e-6
    for q in random_joints(5, 2):
        jacobian = kinematics.jacobian(q, TCP)
        for k in range(6):
            moved = np.eye(6)[k] * step
            ahead, behind = (kinematics.transform(q + s * moved, TCP) for s in (1, -1))
            turn = rotation_vector(ahead[0] @ behind[0].T)
            numeric = np.concatenate([ahead[1] - behind[1], turn]) / (2 * step)
            assert jacobian[:, k] == pytest.approx(numeric, abs=1e-7)


def test_inverse_kinematics_find_the_nearest_solution():
    kinematics = Kinematics(known_arm("ur5"))
    for q in ROBOT.sample(20, np.random.default_rng(3)):
        pose = kinematics.pose(q, TCP)
        assert kinematics.inverse(pose, TCP, q + 0.001) == pytest.approx(q, abs=1e-6)
        followed = kinematics.follow(pose, TCP, q + 0.002)
        assert kinematics.pose(followed, TCP)[:3] == pytest.approx(pose[:3], abs=1e-4)
    assert kinematics.inverse(np.array([2.0, 0, 0, 0, 0, 0]), NO_TOOL, np.zeros(6)) is None


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 1.0, 3.0, 3.1, np.pi - 1e-6, np.pi])
def test_rotation_vectors_there_and_back(angle):
    rng = np.random.default_rng(4)
    for axis in [*np.eye(3), *rng.normal(size=(5, 3))]:
        rotation = Rotation.from_rotvec(axis / np.linalg.norm(axis) * angle).as_matrix()
        found = rotation_vector(rotation)
        assert np.linalg.norm(found) <= np.pi + 1e-9
        assert matrix(np.concatenate([np.zeros(3), found]))[0] == pytest.approx(rotation, abs=1e-7)


@pytest.mark.parametrize("length", [1.0, 0.01, 0.0])
def test_a_profile_keeps_speed_and_acceleration(length):
    speed, rate = 0.5, 1.0
    profile = Profile(length, speed, rate)
    t = np.linspace(0.0, profile.duration + 0.1, 4001)
    s = np.array([profile.at(x) for x in t])
    v = np.diff(s) / (t[1] - t[0])
    assert s[0] == 0.0 and s[-1] == length
    assert (v >= -1e-9).all() and v.max() <= speed + 1e-9
    assert np.abs(np.diff(v)).max() <= rate * (t[1] - t[0]) + 1e-9


def test_a_joint_move_arrives_within_its_limits():
    bench = Bench().script()
    goal = bench.arm.q + np.array([0.5, -0.2, 0.1, 0.0, 0.3, -0.5])
    bench.command(1, *goal, 0.8, 1.5)
    way = np.array(bench.run(1.6))
    assert bench.said(0) == 2
    assert bench.body.q == pytest.approx(goal, abs=1e-4)
    speed = np.diff(way, axis=0) / CYCLE
    assert np.abs(speed).max() == pytest.approx(0.8, rel=1e-6)
    assert np.abs(np.diff(speed, axis=0)).max() <= 1.5 * CYCLE + 1e-9


def test_servoj_lags_by_its_lookahead_time():
    bench = Bench().script()
    start, speed, lookahead = bench.arm.q.copy(), 0.2, 0.1
    for k in range(100):
        goal = start + speed * k * CYCLE
        bench.write(**{f"d{j}": goal[j] for j in range(6)}, d9=lookahead, d10=300, i0=11)
        bench.run(CYCLE)
    assert goal - bench.arm.q == pytest.approx(speed * lookahead, rel=0.05)
    bench.command(16, 10.0)
    bench.run(0.1)
    assert bench.said(0) == 2 and not bench.arm.moving


def test_servoj_beyond_the_speed_limit_is_a_protective_stop():
    bench = Bench().script()
    start = bench.arm.q.copy()
    goal = start + 0.4
    bench.write(**{f"d{j}": goal[j] for j in range(6)}, d9=0.1, d10=300, i0=11)
    bench.run(0.2)
    assert bench.controller.modes.safety is SafetyMode.PROTECTIVE_STOP
    assert bench.controller.modes.runtime is Runtime.PAUSED
    assert bench.arm.q == pytest.approx(start, abs=1e-9)


def test_a_paused_move_goes_on_to_its_goal():
    bench = Bench().script()
    goal = bench.arm.q + 0.5
    bench.command(1, *goal, 0.5, 1.0)
    bench.run(0.5)
    assert bench.controller.pause()
    bench.run(1.0)
    assert not bench.arm.moving and np.abs(bench.arm.q - goal).max() > 0.1
    assert bench.controller.play()
    bench.run(2.0)
    assert bench.body.q == pytest.approx(goal, abs=1e-4)


def test_joint_limits_stop_the_robot():
    bench = Bench().script()
    bench.write(**{f"d{k}": 0.0 for k in range(5)}, d5=3.0, d6=5.0, i0=9)
    bench.run(4.0)
    assert bench.controller.modes.safety is SafetyMode.PROTECTIVE_STOP
    assert np.abs(bench.arm.q).max() <= 6.2832


def test_a_way_through_the_column_is_unreachable():
    kinematics = Kinematics(known_arm("ur5"))
    q = kinematics.inverse(DOWN, NO_TOOL, ROBOT.home)
    goal = DOWN * np.array([-1.0, -1.0, 1.0, 1.0, 1.0, 1.0])
    motion = ToPose(kinematics, NO_TOOL, goal, Pace(5.0, 50.0))
    motion.begin(q, np.zeros(6))
    with pytest.raises(Exception, match="reach"):
        for _ in range(200):
            following = motion.step(q, CYCLE)
            if np.abs(following - q).max() > np.pi * CYCLE:
                raise RuntimeError("beyond reach of the joints' speed")
            q = following
