"""A UR robot that stops by itself or is taken by another client during a move."""

import time

import numpy as np
import pytest

from rtde_moves import A, B, disturbed, recovered
from wrenchbed.errors import DriverError, LateError, SafetyStopError, StoppedError

pytest.importorskip("rtde_control")
pytestmark = pytest.mark.wire
HOST = "127.0.2.13"
DRIVER = {"power_on": True}


@pytest.mark.sampled
@pytest.mark.parametrize(
    "kind, values, words",
    [
        ("protective_stop", {}, "protective stop"),
        ("emergency_stop", {"seconds": 0.9}, "emergency stop"),
        ("program_stop", {}, "program is stop"),
        ("power_off", {}, "is off"),
    ],
)
def test_a_robot_that_stops_is_named_at_once(bench, link, kind, values, words):
    seen = disturbed(bench, lambda: bench.emulator.fault("robot", kind, **values))
    assert isinstance(seen.error, StoppedError) and words in str(seen.error)
    assert seen.state == "stopped" and words in seen.detail
    assert seen.ended < 1.0
    assert seen.late_travel < 1e-3
    assert not link.write(link.read().q).ok
    begun = time.monotonic()
    if kind == "protective_stop":
        with pytest.raises(SafetyStopError, match="look what the robot hit"):
            link.recover(unlock=False)
    took = recovered(link)
    if kind == "protective_stop":
        assert 3.0 < took < 9.0
        assert bench.observer.travel(begun, begun + took) < 1e-3
    link.move(A).wait()


@pytest.mark.slow
def test_joints_that_do_not_follow_are_read_and_no_move_ends_before_they_do(bench, link):
    """The controller of this twin allows it; a real one may stop by itself."""
    apart = []

    def disturb():
        bench.emulator.fault(
            "robot", "follow_error", joints=[0.0, 0.0, 0.0, 0.2, 0.0, 0.0], seconds=2.5
        )
        for _ in range(100):
            time.sleep(0.01)
            state = link.read()
            apart.append(state.q[3] - state.target_q[3])

    seen = disturbed(bench, disturb)
    assert max(apart) == pytest.approx(0.2, abs=0.02)
    assert seen.error is None and seen.last == "ok"
    assert seen.ended > 1.3
    assert np.abs(link.read().q - link.read().target_q).max() < 1e-3


@pytest.mark.slow
def test_joints_that_never_arrive_are_late(bench, link):
    goal = A if np.abs(link.position() - A).max() > 0.3 else B
    motion = link.move(goal)
    bench.emulator.fault(
        "robot", "follow_error", joints=[0.0, 0.0, 0.0, 0.2, 0.0, 0.0], seconds=60.0
    )
    try:
        with pytest.raises(LateError, match=r"0\.2 off its goal"):
            motion.wait(6.0)
    finally:
        bench.emulator.fault("robot", "follow_error", joints=[0.0] * 6, seconds=0.1)
    time.sleep(0.6)
    recovered(link)


def test_an_emergency_stop_is_not_cleared_from_here(bench, link):
    bench.emulator.fault("robot", "emergency_stop", seconds=0.5)
    time.sleep(0.1)
    assert link.read().safety == "emergency stop"
    with pytest.raises(StoppedError, match="cannot be cleared from here"):
        link.recover(unlock=True)
    with pytest.raises(DriverError, match="not active"):
        link.move(A)
