"""The driver of UR robots with a healthy emulator: what the contract of all drivers leaves out."""

import contextlib
import time

import numpy as np
import pytest

import rtde_moves
from rtde_moves import A, B, alive
from wrenchbed.errors import DriverError
from wrenchbed.hardware.device import wait_until

pytest.importorskip("rtde_control")
pytestmark = pytest.mark.wire


@pytest.mark.sampled
@pytest.mark.parametrize("kind", ["soft", "hard"])
def test_a_stop_brings_it_to_rest_and_the_next_move_works(bench, link, kind):
    goal = A if np.abs(link.position() - A).max() > 0.3 else B
    motion = link.move(goal)
    time.sleep(0.3)
    begun = time.monotonic()
    link.stop(kind)
    took = time.monotonic() - begun
    assert took < 1.0
    time.sleep(0.2)
    assert bench.observer.travel(begun + took + 0.05) < 1e-3
    assert np.abs(link.position() - goal).max() > 0.05
    assert wait_until(lambda: link.health().ok, 2.0), link.health()
    motion.cancel()
    back = link.position() + 0.02
    assert link.move(back).wait().q == pytest.approx(back, abs=5e-4)


def test_rows_at_rest_are_fresh_and_evenly_spaced(link):
    link.settle()
    block = link.sample(40, 100.0)
    step = np.diff(block["t"])
    assert (step > 0.0).all() and np.median(step) == pytest.approx(0.01, rel=0.5)
    assert len({tuple(block[f"q{j}"]) for j in range(1, 7)}) == 6
    assert block["age"].max() < 0.08


def test_after_a_stop_targets_are_held_against_where_the_robot_is(link):
    q = link.position()
    for k in range(60):
        link.write(q + 0.006 * k * np.eye(6)[5])
        time.sleep(0.008)
    link.stop("hard")
    behind = q + 0.006 * 59 * np.eye(6)[5] - link.position()
    assert behind[5] > 0.02
    applied = link.write(link.position() + behind)
    assert not applied.ok and "q6 would move" in applied.reason


def test_a_second_client_does_not_take_the_robot_away_and_waiting_keeps_the_watchdog(link):
    with contextlib.closing(rtde_moves.driver()) as other:
        other.connect()
        with pytest.raises(DriverError, match="someone else"):
            other.activate()
    assert wait_until(lambda: link.health().ok, 2.0), link.health()
    counters = link.health().counters
    assert counters["arm states"] > 50 and "arm skipped" in counters


def test_the_own_wrench_is_stated_in_the_recording(link):
    stated = link.metadata("static", 100.0).to_json()["wrench"]
    assert stated["source"] == "actual_TCP_force" and stated["reference"] == "tcp"


def test_it_ends_without_a_trace_and_connects_again(link):
    pid = link._control.pid
    link.close()
    link.close()
    assert not alive(pid)
    assert link.health().state == "closed"
    link.connect()
    assert link.read().mode == "running"
