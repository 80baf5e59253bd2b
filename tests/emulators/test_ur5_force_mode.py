"""The UR5 emulator's force: pressing on a plate, payload and protective stops, in process."""

import numpy as np
import pytest

from robot_emulators.ur.kinematics import NO_TOOL
from robot_emulators.ur.modes import SafetyMode
from ur5_bench import CYCLE, ROBOT, Bench

DOWN = np.array([0.4, -0.11, 0.45, np.pi, 0.0, 0.0])


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
    bench.run(3.0)
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
    bench.run(5.0)
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
