"""The UR5 emulator in process: kinematics, motions, force, safety, and what a reboot forgets."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from robot_emulators.kinematic_plant import known_arm
from robot_emulators.ur.arm import GRAVITY
from robot_emulators.ur.kinematics import NO_TOOL, Kinematics, matrix, rotation_vector
from robot_emulators.ur.modes import Runtime, SafetyMode
from robot_emulators.ur.outputs import Outputs
from ur5_bench import CYCLE, Bench
from wrenchbed import registry

ROBOT = registry.load("robots", "ur5")
TCP = np.array([0.01, -0.02, 0.15, 0.1, 0.2, -0.3])
DOWN = np.array([0.4, -0.11, 0.45, np.pi, 0.0, 0.0])


def test_the_jacobian_is_the_derivative_and_the_inverse_is_the_nearest_solution():
    kinematics, step = Kinematics(known_arm("ur5")), 1e-6
    for q in np.random.default_rng(2).uniform(-3.0, 3.0, (5, 6)):
        jacobian = kinematics.jacobian(q, TCP)
        for k in range(6):
            moved = np.eye(6)[k] * step
            ahead, behind = (kinematics.transform(q + s * moved, TCP) for s in (1, -1))
            turn = rotation_vector(ahead[0] @ behind[0].T)
            numeric = np.concatenate([ahead[1] - behind[1], turn]) / (2 * step)
            assert jacobian[:, k] == pytest.approx(numeric, abs=1e-7)
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


def test_servoj_lags_by_its_lookahead_time_and_stops_beyond_the_speed_limit():
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
    bench.run(2.5)
    assert bench.controller.modes.safety is SafetyMode.PROTECTIVE_STOP
    assert np.abs(bench.arm.q).max() <= 6.2832


def pressing(bench: Bench) -> None:
    """Bring the tool just above the plate."""
    near = DOWN.copy()
    near[2] = 0.25 + 0.142
    q = bench.arm.kinematics.inverse(near, NO_TOOL, ROBOT.home)
    bench.command(1, *q, 3.0, 10.0)
    bench.run(2.5)
    assert bench.said(0) == 2


def test_force_mode_settles_at_its_force():
    bench = Bench(table=0.25).script()
    pressing(bench)
    assert bench.controller.estimate.wrench == pytest.approx(np.zeros(6), abs=0.05)
    bench.write(i0=0)
    bench.run(2 * CYCLE)
    wrench = dict(zip([f"d{k}" for k in range(6, 12)], [0, 0, -20, 0, 0, 0], strict=True))
    frame = {f"d{k}": 0.0 for k in range(6)} | {f"d{k}": 0.05 for k in range(12, 18)}
    bench.write(**frame, **wrench, i1=2, i2=0, i3=0, i4=1, i5=0, i6=0, i7=0, i0=6)
    bench.run(2.0)
    assert bench.controller.estimate.wrench[2] == pytest.approx(20.0, abs=0.1)
    bench.command(7)
    bench.run(0.2)
    assert bench.arm.force is None and bench.said(0) == 2


def test_too_much_force_is_a_protective_stop_that_one_can_leave():
    bench = Bench(table=0.25).script()
    pressing(bench)
    bench.command(10, 0, 0, -0.05, 0, 0, 0, 0.5)
    bench.run(1.0)
    assert bench.controller.modes.safety is SafetyMode.PROTECTIVE_STOP
    assert np.linalg.norm(bench.controller.estimate.wrench[:3]) > 150.0
    bench.now += 5.0
    bench.run(CYCLE)
    assert bench.controller.modes.unlock()
    bench.write(i0=0)
    bench.script()
    bench.command(10, 0, 0, 0.05, 0, 0, 0, 0.5)
    bench.run(1.0)
    assert bench.controller.modes.safety is SafetyMode.NORMAL
    assert np.linalg.norm(bench.controller.estimate.wrench[:3]) < 5.0


def test_the_payload_is_taken_off_the_force():
    bench = Bench().script()
    bench.command(17, 0.35, 0.0, 0.0, 0.05)
    bench.run(0.1)
    assert bench.controller.estimate.wrench[2] == pytest.approx(-(1.35 - 0.35) * 9.80665, abs=1e-3)
    bench.command(8)
    bench.run(0.1)
    assert bench.controller.estimate.wrench == pytest.approx(np.zeros(6), abs=1e-6)


@pytest.fixture
def bench():
    return Bench(series="e").script()


def reboot(bench: Bench) -> dict:
    """Switch off and on; all that it says afterwards."""
    bench.controller.reboot()
    bench.write(i0=0)
    bench.run(0.5)
    outputs = Outputs(bench.controller, shared=False)
    outputs.update(1.0, set(bench.controller.fields))
    return bench.controller.values


def test_what_a_program_set_is_that_of_the_installation_again(bench):
    for command in ((29, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0), (59, 0.0, 9.0, 0.0), (21, 0.1), (8,),
                    (65, 0.35, 0.0, 0.0, 0.05, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0)):  # fmt: skip
        bench.command(*command)
        bench.run(2 * CYCLE)
    estimate = bench.controller.estimate
    assert bench.arm.tcp[2] == 0.1 and bench.arm.force_scaling == 0.1
    assert estimate.payload.mass == 0.35 and estimate.gravity[1] == -9.0
    assert np.abs(estimate._zero).max() > 5.0
    values = reboot(bench)
    assert values["tcp_offset"] == (0.0,) * 6 and bench.arm.force_scaling == 1.0
    assert values["payload"] == (pytest.approx(1.35),)
    assert values["payload_cog"] == pytest.approx((0.004, -0.006, 0.071))
    assert values["target_gravity"] == pytest.approx(tuple(-GRAVITY))
    assert values["actual_TCP_force"] == pytest.approx((0.0,) * 6, abs=1e-3)


def test_a_reboot_stops_scripts_and_the_arm_where_it_is(bench):
    bench.play("write_output_boolean_register(3, True)\n")
    assert bench.controller.load("external_control.urp")
    bench.controller.script_denied_until = float("inf")
    assert reboot(bench)["output_bit_registers0_to_31"] == (0,)
    assert not bench.controller.loaded and not bench.controller.play()
    bench.script()
    bench.controller.protective_stop()
    for reboot_first in (False, True):
        if reboot_first:
            bench.controller.reboot()
        bench.controller.estimate.wrench = np.array([0.0, 0.0, 200.0, 0.0, 0.0, 0.0])
        assert bench.controller._pressed_too_hard() is reboot_first
    bench = Bench(series="e").script()
    bench.command(1, *(bench.arm.q + 0.5), 0.5, 5.0)
    bench.run(0.5)
    q, speed = bench.arm.q.copy(), np.abs(bench.arm.qd).max()
    assert speed > 0.4
    bench.controller.reboot()
    bench.run(1.0)
    assert not bench.arm.moving and 0.0 < np.abs(bench.arm.q - q).max() < 0.03
