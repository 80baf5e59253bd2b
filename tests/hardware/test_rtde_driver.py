"""The driver of UR robots with a healthy twin: lifecycle, reading, moving, streaming, stopping."""

import contextlib
import time
from itertools import pairwise

import numpy as np
import pytest

import rtde_moves
from emulator_process import running
from rtde_moves import A, B, alive
from rtde_observer import Observer
from wrenchbed.errors import DriverError, PlanError

pytest.importorskip("rtde_control")
pytestmark = pytest.mark.wire
HOST = "127.0.2.11"


@pytest.fixture(scope="module")
def twin():
    with running("ur5", HOST) as process:
        yield process


@pytest.fixture(scope="module")
def observer(twin):
    with Observer(HOST) as watching:
        yield watching


@pytest.fixture(scope="module")
def link(twin):
    driver = rtde_moves.driver(HOST)
    with contextlib.closing(driver):
        driver.connect()
        yield driver


@pytest.fixture
def ready(link):
    link.activate()
    return link


@pytest.mark.slow
def test_connecting_and_reading_moves_nothing(link, observer):
    begun = time.monotonic()
    link.deactivate()
    samples = []
    while time.monotonic() < begun + 0.5:
        samples.append(link.read())
        time.sleep(0.002)
    fresh = [after for before, after in pairwise(samples) if after.t > before.t]
    assert 10 < len(fresh) < len(samples)
    assert np.all(np.diff([s.device_time for s in fresh]) > 0.0)
    assert np.median([s.age for s in samples]) < 0.012
    last = samples[-1]
    assert (last.mode, last.safety) == ("running", "normal")
    assert last.target_q.shape == (6,)
    assert observer.travel(begun) < 1e-4


def test_nothing_is_sent_before_it_is_active(link):
    link.deactivate()
    assert "not active" in link.write(A).reason
    with pytest.raises(DriverError, match="not active"):
        link.move(A)


@pytest.mark.slow
def test_a_move_arrives_and_keeps_to_its_speed(ready, observer):
    begun = time.monotonic()
    for goal in (B, A):
        reached = ready.move(goal).wait()
        assert reached.q == pytest.approx(goal, abs=5e-4)
    rows = [(t, q) for t, q in observer.rows if t > begun]
    t, q = (np.array(x) for x in zip(*rows, strict=True))
    wide = 8
    speed = np.abs(q[wide:] - q[:-wide]) / (t[wide:] - t[:-wide])[:, None]
    assert 0.4 < np.median(np.sort(speed.max(axis=1))[-20:]) < 1.15 * 0.3 * np.pi


def test_a_goal_out_of_reach_is_refused_and_nothing_moves(ready, observer):
    begun = time.monotonic()
    for goal in (np.full(6, 9.0), np.full(6, np.nan)):
        with pytest.raises((PlanError, ValueError)):
            ready.move(goal)
    time.sleep(0.1)
    assert observer.travel(begun) < 1e-4 and ready.health().ok


@pytest.mark.sampled
@pytest.mark.parametrize("kind", ["soft", "hard"])
def test_a_stop_brings_it_to_rest_and_the_next_move_works(ready, observer, kind):
    goal = A if np.abs(ready.position() - A).max() > 0.3 else B
    motion = ready.move(goal)
    time.sleep(0.4)
    begun = time.monotonic()
    ready.stop(kind)
    took = time.monotonic() - begun
    assert took < 1.0
    time.sleep(0.2)
    assert observer.travel(begun + took + 0.05) < 1e-3
    assert np.abs(ready.position() - goal).max() > 0.05
    assert ready.health().ok
    motion.cancel()
    ready.move(goal).wait()


def test_rows_at_rest_are_fresh_and_evenly_spaced(ready):
    ready.settle()
    block = ready.sample(60, 100.0)
    step = np.diff(block["t"])
    assert (step > 0.0).all() and step.mean() == pytest.approx(0.01, rel=0.3)
    assert len({tuple(block[f"q{j}"]) for j in range(1, 7)}) == 6
    assert block["age"].max() < 0.08


@pytest.mark.slow
def test_a_trajectory_is_followed_and_recorded(ready):
    ready.move(A).wait()
    t = np.arange(0.0, 1.6, 0.008)
    swing = 0.08 * np.sin(2 * np.pi * t / 1.6) * np.sin(np.pi * t / 1.6)
    targets = A + swing[:, None] * [1.0, 0.5, -0.5, 1.0, 1.0, 1.0]
    blocks = list(ready.track(targets, 125.0))
    rows = {k: np.concatenate([b[k] for b in blocks]) for k in blocks[0]}
    assert len(rows["t"]) == len(targets) and (np.diff(rows["t"]) > 0.0).all()
    q = np.column_stack([rows[f"q{j}"] for j in range(1, 7)])
    lag = min(range(80), key=lambda k: np.abs(q[k:] - targets[: len(q) - k]).max())
    assert 0 < lag < 79
    assert np.abs(q[lag:] - targets[: len(q) - lag]).max() < 0.03
    assert ready.health().ok
    assert np.abs(ready.position() - targets[-1]).max() < 0.01
    ready.move(B).wait()


def test_a_target_that_jumps_is_refused(ready):
    q = ready.position()
    applied = ready.write(q + 0.5)
    assert not applied.ok and "limit" in applied.reason
    assert ready.write(q).ok
    ready.stop()


def test_after_a_stop_targets_are_held_against_where_the_robot_is(ready):
    q = ready.position()
    for k in range(60):
        ready.write(q + 0.006 * k * np.eye(6)[5])
        time.sleep(0.008)
    ready.stop("hard")
    behind = q + 0.006 * 59 * np.eye(6)[5] - ready.position()
    assert behind[5] > 0.03
    applied = ready.write(ready.position() + behind)
    assert not applied.ok and "q6 would move" in applied.reason
    ready.move(A).wait()


def test_a_program_that_hangs_on_nothing_keeps_the_watchdog_alive(ready):
    time.sleep(0.8)
    assert ready.health().ok


def test_a_second_client_does_not_take_the_robot_away(ready):
    other = rtde_moves.driver(HOST)
    with contextlib.closing(other):
        other.connect()
        with pytest.raises(DriverError, match="someone else"):
            other.activate()
    assert ready.health().ok


def test_the_own_wrench_is_stated_in_the_recording(ready):
    told = ready.metadata("static", 100.0).to_json()["wrench"]
    assert told["source"] == "actual_TCP_force" and told["reference"] == "tcp"


def test_its_health_counts(ready):
    counters = ready.health().counters
    assert counters["arm states"] > 50 and counters["arm restarts"] == 0
    assert "arm skipped" in counters


def test_a_net_ft_at_the_same_host_is_read(link, twin):
    link.deactivate()
    port = twin.addresses["http"].rpartition(":")[2]
    other = rtde_moves.driver(HOST, sensor=f"netft://{HOST}?http={port}")
    with contextlib.closing(other):
        other.connect()
        other.activate()
        block = other.sample(20, 100.0)
        assert np.hypot(block["fx"], np.hypot(block["fy"], block["fz"])).mean() > 5.0


def test_it_ends_without_a_trace_and_connects_again(link):
    link.activate()
    pids = [link._control.pid]
    link.close()
    link.close()
    assert not any(alive(pid) for pid in pids)
    assert link.health().state == "closed"
    link.connect()
    assert link.read().mode == "running"
