"""The driver of UR robots with an emulator: healthy, cut off, silent, stopped or taken."""

import contextlib
import os
import signal
import subprocess
import sys
import time
import warnings

import numpy as np
import pytest

import rtde_moves
from rtde_moves import HOST, NAMED_S, A, B, alive, disturbed, recovered
from wrenchbed.errors import DriverError, LinkError, SafetyStopError, StoppedError, WrenchbedWarning
from wrenchbed.hardware.device_base import GONE_S, wait_until

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


def test_a_speed_slider_is_said_and_moves_get_the_time_that_it_takes(link):
    io = pytest.importorskip("rtde_io").RTDEIOInterface(HOST)
    try:
        assert io.setSpeedSlider(0.3)
        assert wait_until(lambda: link.health().counters["arm speed scaling"] < 0.31, 2.0)
        with pytest.warns(WrenchbedWarning, match=r"slider is at 30%: moves take 3.3 times"):
            link.move(link.position() + 0.02).wait()
        assert link.pace == pytest.approx(0.3)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            link.move(link.position() - 0.02).wait()  # said once
    finally:
        assert io.setSpeedSlider(1.0)
        assert wait_until(lambda: link.health().counters["arm speed scaling"] > 0.99, 2.0)
        io.disconnect()
    link.move(link.position() + 0.02).wait()
    assert link.pace == 1.0


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


def test_it_ends_without_a_trace_and_connects_again(link):
    pid = link._control.pid
    link.close()
    link.close()
    assert not alive(pid)
    assert link.health().state == "closed"
    link.connect()
    assert link.read().mode == "running"


REFUSED = "arm refused states"


@pytest.mark.sampled
@pytest.mark.parametrize(
    "where, kind, values, words",
    [
        ("rtde", "fin", {}, "closed the connection"),
        ("rtde", "rst", {}, "stream of states ended"),
        ("control", "fin", {}, "control process"),
        ("control", "rst", {}, "control process"),
        ("rtde", "malformed", {"how": "short_header"}, "this is no RTDE"),
        ("rtde", "malformed", {"how": "garbage"}, "this is no RTDE"),
        ("rtde", "timestamp_jump", {"by": -50.0}, "clock went back"),
        ("robot", "restart", {"seconds": 0.5}, "ended"),
    ],
)
def test_a_link_that_is_gone_is_lost_at_once(bench, link, where, kind, values, words):
    seen = disturbed(bench, lambda: bench.emulator.fault(where, kind, **values), rest_from=0.8)
    assert seen.state == "lost" and words in seen.detail and "recover()" in seen.detail
    assert seen.named < 1.0 and isinstance(seen.error, LinkError)
    assert seen.ended < 1.0
    assert seen.late_travel < 1e-3
    assert recovered(link) < 8.0


def test_a_stream_that_is_cut_says_why(bench, link):
    t = np.arange(0.0, 3.0, 0.008)
    targets = link.position() + 0.1 * np.sin(t)[:, None] * np.sign(B - A + 1e-9)
    with pytest.raises(DriverError) as caught:
        for k, _ in enumerate(link.track(targets, 125.0)):
            if k == 1:
                bench.emulator.fault("control", "fin")
                begun = time.monotonic()
    assert time.monotonic() - begun < 1.5 and "control process" in str(caught.value)
    time.sleep(max(0.0, begun + 0.6 - time.monotonic()))
    assert bench.observer.travel(begun + 0.5) < 1e-3
    recovered(link)


@pytest.mark.sampled
@pytest.mark.parametrize(
    "how, counted", [("empty_data", True), ("short_data", True), ("unknown_type", False)]
)
def test_nonsense_in_the_stream_is_never_shown(bench, link, how, counted):
    """Data of a wrong length are refused and counted; an unknown packet is passed over."""
    before, odd = link.health().counters[REFUSED], bench.observer.odd
    states = []

    def disturb():
        bench.emulator.fault("rtde", "malformed", how=how)
        for _ in range(50):
            states.append(link.read())
            time.sleep(0.004)

    seen = disturbed(bench, disturb)
    assert bench.observer.odd > odd  # it was in the stream
    assert not [s for s in states if np.abs(s.q - A).max() >= 1.0 or s.safety != "normal"]
    assert (link.health().counters[REFUSED] > before) == counted
    if counted and seen.error is not None:  # it may kill ur_rtde, which commands
        assert isinstance(seen.error, LinkError | StoppedError) and seen.late_travel < 1e-3
        assert recovered(link) < 6.0
    else:
        assert seen.error is None and seen.last == "ok"


@pytest.mark.sampled
@pytest.mark.parametrize(
    "where, kind, values",
    [
        ("rtde", "text", {}),
        ("rtde", "timestamp_jump", {"by": 30.0}),
        ("script", "fin", {}),
        ("script", "unlisten", {"seconds": 1.0}),
        ("dashboard", "stall", {"seconds": 1.0}),
        ("dashboard", "unlisten", {"seconds": 1.0}),
    ],
)
def test_what_does_no_harm_stops_nothing(bench, link, where, kind, values):
    before = link.health().counters["arm skipped"]
    seen = disturbed(bench, lambda: bench.emulator.fault(where, kind, **values))
    assert seen.error is None and seen.last == "ok"
    if kind == "timestamp_jump":
        assert link.health().counters["arm skipped"] > before + 1000
    time.sleep(max(0.0, values.get("seconds", 0.0) - seen.ended))


@pytest.mark.sampled
@pytest.mark.parametrize(
    "kind, seconds, state",
    [
        ("drop", 0.2, "ok"),
        ("stall", 0.3, "stopped"),
        ("burst", 0.2, "ok"),
        ("stall", 1.4, "lost"),
        ("stall", 4.0, "lost"),
        ("freeze", 1.4, "lost"),
        ("drop", 1.4, "lost"),
        ("burst", 1.4, "lost"),
    ],
)
def test_silence_is_stale_and_survived_or_ends_the_move(bench, link, kind, seconds, state):
    """While it stalls nothing that is written reaches the robot: its watchdog stops the program."""
    rest_from = 1.9 if seconds > GONE_S else rtde_moves.AT_REST_S
    seen = disturbed(bench, lambda: bench.emulator.fault("rtde", kind, seconds=seconds), rest_from)
    assert seen.first == "stale" and seen.named <= NAMED_S
    if state == "ok":
        assert seen.error is None and seen.last == "ok"
        return
    assert isinstance(seen.error, LinkError | StoppedError) and seen.late_travel < 1e-3
    assert seen.ended < (0.8 if state == "stopped" else GONE_S + 1.2)
    if state == "stopped":
        assert seen.state == state and "program is stopped" in str(seen.error)
    assert recovered(link) < 6.0


def test_targets_are_refused_while_states_are_stale(bench, link):
    q = link.position()
    assert link.write(q).ok
    bench.emulator.fault("rtde", "drop", seconds=0.3)
    time.sleep(0.2)
    applied = link.write(q)
    assert not applied.ok and "stale" in applied.reason
    assert wait_until(lambda: link.health().ok, 2.0)
    link.stop()


@pytest.mark.sampled
@pytest.mark.parametrize(
    "kind, values, words",
    [
        ("program_stop", {}, "program is stop"),
        ("protective_stop", {}, "protective stop"),
        ("emergency_stop", {"seconds": 0.9}, "emergency stop"),
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


@pytest.mark.sampled
@pytest.mark.parametrize("how", ["SIGKILL", "SIGSEGV", "SIGSTOP"])
def test_a_control_process_that_dies_or_hangs_is_named(bench, link, how):
    killed = []

    def kill() -> None:
        killed.append(link._control.pid)
        os.kill(killed[0], getattr(signal, how))

    seen = disturbed(bench, kill, rest_from=0.5)
    if how == "SIGSTOP":
        assert seen.state in ("stopped", "lost")
    else:
        assert seen.state == "lost"
        assert "control process died by signal" in seen.detail and how in seen.detail
    assert seen.named <= 1.0 and isinstance(seen.error, DriverError) and seen.ended < 2.5
    assert seen.late_travel < 1e-3
    assert recovered(link) < 6.0
    assert not alive(killed[0])


START = """
import signal, sys, time
signal.signal(signal.SIGINT, signal.default_int_handler)  # background jobs of a shell ignore it
from wrenchbed.hardware.drivers.rtde import RtdeDriver, RtdeOptions
link = RtdeDriver(RtdeOptions(host=sys.argv[1], sensor="rtde"))
link.connect()
link.activate()
q = link.position()
link.move(q + [0.9 if q[0] < 0.4 else -0.9, 0, 0, 0, 0, 0])
time.sleep(0.25)
print(link._control.pid, flush=True)
"""


@pytest.mark.sampled
@pytest.mark.parametrize("how", ["exit", "SIGINT", "SIGKILL", "SIGSTOP"])
def test_a_process_that_ends_or_hangs_leaves_no_motion(bench, link, how):
    link.deactivate()
    more = "" if how == "exit" else "time.sleep(20)"
    with subprocess.Popen(
        [sys.executable, "-c", START + more, HOST],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    ) as child:  # fmt: skip
        pid = int(child.stdout.readline() or child.stderr.read())
        begun = time.monotonic()
        if how != "exit":
            child.send_signal(getattr(signal, how))
        time.sleep(1.15)
        try:
            assert bench.observer.travel(begun) > 0.0
            assert bench.observer.travel(begun + 1.0) < 1e-3
            assert not alive(pid)
        finally:
            if how == "SIGSTOP":
                child.kill()
        if how == "exit":
            assert child.wait(5.0) == 0 and child.stderr.read() == ""
