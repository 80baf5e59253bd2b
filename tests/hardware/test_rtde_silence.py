"""A UR robot that falls silent during a move: named, and nothing moves on."""

import time

import pytest

from rtde_moves import NAMED_S, disturbed, recovered
from wrenchbed.errors import LinkError, StoppedError
from wrenchbed.hardware.device import GONE_S

pytest.importorskip("rtde_control")
pytestmark = pytest.mark.wire
HOST = "127.0.2.12"


@pytest.mark.sampled
@pytest.mark.parametrize(
    "where, kind, values",
    [
        ("rtde", "stall", {"seconds": 1.4}),
        ("rtde", "stall", {"seconds": 4.0}),
        ("rtde", "freeze", {"seconds": 1.4}),
        ("rtde", "drop", {"seconds": 1.4}),
        ("rtde", "burst", {"seconds": 1.4}),
    ],
)
def test_silence_is_stale_then_lost(bench, link, where, kind, values):
    seen = disturbed(bench, lambda: bench.emulator.fault(where, kind, **values), rest_from=1.9)
    assert seen.first == "stale" and seen.named <= NAMED_S
    assert isinstance(seen.error, LinkError | StoppedError)
    assert seen.ended < GONE_S + 1.2
    assert seen.late_travel < 1e-3
    assert recovered(link) < 6.0


def test_a_short_stall_is_named_and_the_robots_watchdog_stops_it(bench, link):
    """Nothing that is written reaches the robot meanwhile."""
    seen = disturbed(bench, lambda: bench.emulator.fault("rtde", "stall", seconds=0.3))
    assert seen.first == "stale" and seen.named <= NAMED_S
    assert isinstance(seen.error, StoppedError) and "program is stopped" in str(seen.error)
    assert seen.state == "stopped" and 0.25 < seen.ended < 0.8
    assert seen.late_travel < 1e-3
    assert recovered(link) < 6.0


@pytest.mark.sampled
@pytest.mark.parametrize("kind", ["drop", "burst"])
def test_a_short_silence_is_named_and_survived(bench, link, kind):
    seen = disturbed(bench, lambda: bench.emulator.fault("rtde", kind, seconds=0.3))
    assert seen.first == "stale" and seen.named <= NAMED_S
    assert seen.error is None and seen.last == "ok"


def test_targets_are_refused_while_states_are_stale(bench, link):
    q = link.position()
    assert link.write(q).ok
    bench.emulator.fault("rtde", "drop", seconds=0.4)
    time.sleep(0.2)
    applied = link.write(q)
    assert not applied.ok and "stale" in applied.reason
    time.sleep(0.5)
    link.stop()
