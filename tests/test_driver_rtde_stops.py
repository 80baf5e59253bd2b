"""A UR robot that stops by itself or is taken by another client during a move."""

import time

import pytest

from rtde_moves import A, disturbed, recovered
from wrenchbed.errors import DriverError, StoppedError

pytest.importorskip("rtde_control")
pytestmark = pytest.mark.wire
HOST = "127.0.2.13"
DRIVER = {"power_on": True}


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
    seen = disturbed(bench, lambda: bench.twin.fault("robot", kind, **values))
    assert isinstance(seen.error, StoppedError) and words in str(seen.error)
    assert seen.state == "stopped" and words in seen.detail
    assert seen.ended < 1.0
    assert seen.late_travel < 1e-3
    assert not link.write(link.read().q).ok
    begun = time.monotonic()
    took = recovered(link)
    if kind == "protective_stop":
        assert 3.0 < took < 9.0
        assert bench.observer.travel(begun, begun + took) < 1e-3
    link.move(A).wait()


def test_an_emergency_stop_is_not_cleared_from_here(bench, link):
    bench.twin.fault("robot", "emergency_stop", seconds=0.5)
    time.sleep(0.1)
    assert link.read().safety == "emergency stop"
    with pytest.raises(StoppedError, match="cannot be cleared from here"):
        link.recover()
    with pytest.raises(DriverError, match="not active"):
        link.move(A)
