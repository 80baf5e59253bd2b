"""The parts of the driver of UR robots that need no robot."""

import contextlib
import math
import os
import random
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wrenchbed.hardware.drivers.rtde.control_worker import sound
from wrenchbed.hardware.drivers.rtde.driver import Followed, trapezoid
from wrenchbed.hardware.drivers.rtde.shared_state import SharedState, Snapshot
from wrenchbed.hardware.drivers.rtde.state_worker import Copier, implausible
from wrenchbed.hardware.drivers.rtde.worker import Closed, pair

OK = Snapshot(t=1.0, stamp=1.0, q=(0.1,) * 6, mode=7.0, safety=1.0, runtime=2.0, major=3.0)
HAMMER = """
import sys, time
from wrenchbed.hardware.drivers.rtde.shared_state import SharedState, Snapshot
shared = SharedState(int(sys.argv[1]))
end = time.monotonic() + 1.5
k = 0
while time.monotonic() < end:
    k += 1
    v = (float(k),) * 6
    shared.write(Snapshot(k, k, *(v,) * 10, *(k,) * 13))
"""


@contextlib.contextmanager
def memory():
    shared = SharedState.create()
    try:
        yield shared
    finally:
        shared.close()


def test_a_reader_never_sees_a_torn_state():
    with memory() as shared:
        writer = subprocess.Popen(
            [sys.executable, "-c", HAMMER, str(shared.descriptor)], pass_fds=(shared.descriptor,)
        )
        seen, last = 0, 0.0
        while writer.poll() is None:
            state = shared.read()
            if state is None:
                continue
            flat = {v for value in state for v in (value if isinstance(value, tuple) else [value])}
            assert len(flat) == 1, state
            assert state.t >= last
            seen += state.t > last
            last = state.t
        assert writer.returncode == 0
        assert seen > 20  # it did read while the other wrote, however busy the machine


def test_a_writer_that_died_halfway_leaves_the_state_before_and_the_next_one_goes_on():
    with memory() as shared:
        assert shared.read() is None
        shared.write(OK)
        shared._memory[0:8] = (int.from_bytes(shared._memory[0:8], "little") + 1).to_bytes(
            8, "little"
        )
        assert shared.read() is None
        again = SharedState(os.dup(shared.descriptor))
        again.write(OK._replace(t=2.0))
        assert shared.read().t == again.read().t == 2.0
        again.close()


def test_heartbeats_age():
    with memory() as shared:
        assert shared.silence("driver") > 1.0
        shared.beat("driver")
        assert shared.silence("driver") < 0.05 < shared.silence("control")


def test_a_heartbeat_is_never_seen_half_written():
    code = HAMMER.replace("shared.write(", "shared.beat('driver') or (").replace("1.5", "0.8")
    with memory() as shared:
        shared.beat("driver")
        with subprocess.Popen(
            [sys.executable, "-c", code, str(shared.descriptor)], pass_fds=(shared.descriptor,)
        ) as writer:
            while writer.poll() is None:
                assert 0.0 <= shared.silence("driver") < 2.0


def test_messages_keep_their_borders_and_an_end_is_told():
    mine, other = pair()
    assert mine.send({"a": 1}) and mine.send({"b": [2.0]})
    assert other.recv(100) == b'{"a": 1}' and other.recv(100) == b'{"b": [2.0]}'
    assert mine.receive(0.0) is None
    other.close()
    with pytest.raises(Closed):
        mine.receive(0.1)
    assert not mine.send({"a": 1})
    mine.close()


@given(st.floats(1e-6, 6.0), st.floats(0.2, 30.0), st.floats(0.05, 3.14))
def test_a_move_uses_no_more_than_its_speed(distance, seconds, top):
    speed, acceleration = trapezoid(distance, seconds, top)
    assert speed <= max(top, 0.01) and 0.05 <= acceleration <= 15.0
    if top >= 1.5 * distance / seconds > 0.01 and 4.5 * distance / seconds**2 > 0.05:
        ramp = speed / acceleration
        took = distance / speed + ramp
        assert took == pytest.approx(seconds, rel=1e-6) or acceleration == 15.0


@given(st.lists(st.floats(), max_size=8))
def test_only_six_finite_angles_are_sent(q):
    assert sound(q) == (len(q) == 6 and all(math.isfinite(v) for v in q))


@pytest.mark.parametrize("q", [None, [None] * 6, ["1"] * 6, (0.0,) * 6, [float("nan")] * 6])
def test_other_things_are_no_angles(q):
    assert not sound(q)


def follow(gain, n=120):
    followed, rng = Followed(), random.Random(3)
    why = ""
    for k in range(n):
        sent = np.full(6, 0.2 * math.sin(0.05 * k))
        late = np.full(6, gain * 0.2 * math.sin(0.05 * max(0, k - 12)) + rng.gauss(0.0, 1e-5))
        why = why or followed.add(0.008 * k, sent, late)
    return why


def test_targets_that_are_followed_late_are_followed():
    assert follow(1.0) == ""


def test_targets_that_are_dropped_are_noticed():
    assert "does not follow" in follow(0.0)


@pytest.mark.parametrize(
    "change, wrong",
    [
        ({}, 0), ({"q": (float("nan"),) * 6}, 1), ({"force": (math.inf,) * 6}, 1),
        ({"q": (1e86,) * 6}, 2), ({"q": (0.0,) * 5}, 2), ({"mode": 99.0}, 2), ({"safety": 0.0}, 2),
        ({"runtime": 1e9}, 2), ({"q": (0.5,) * 6}, 3), ({"stamp": 0.992}, 4),
        ({"stamp": -0.5, "q": (0.5,) * 6}, 0), ({"stamp": 0.0, "current": (5e30,) * 6}, 2),
        ({"stamp": 0.0, "q": (3.4e-322,) * 6}, 2), ({"target_moment": (-1.5e36,) * 6}, 2),
        ({"temperatures": (1e9,) * 6}, 2), ({"qd": (60.0,) * 6}, 2),
    ],
)  # fmt: skip
def test_what_no_robot_sends_is_refused(change, wrong):
    assert implausible(OK._replace(**{"t": 1.008, "stamp": 1.008} | change), OK) == wrong


class Link:
    """A receive interface that shows states one after another."""

    def __init__(self, states):
        self.states, self.at = states, 0

    def __getattr__(self, name):
        state = self.states[self.at]
        return lambda: {
            "getTimestamp": state.stamp, "getActualQ": list(state.q), "getActualQd": list(state.qd),
            "getActualCurrent": [0.0] * 6, "getTargetQ": list(state.q),
            "getTargetQd": [0.1] * 6, "getTargetMoment": list(state.target_moment),
            "getJointTemperatures": [31.0] * 6,
            "getActualTCPPose": [0.0] * 6, "getActualTCPForce": [0.0] * 6,
            "getSpeedScaling": 1.0, "getRobotMode": state.mode, "getSafetyMode": state.safety,
            "getSafetyStatusBits": state.bits, "getRuntimeState": state.runtime,
        }[name]  # fmt: skip


def test_states_are_counted_refused_and_dated():
    stamps = [2.0, 2.0, 2.008, 2.04, 2.048, 2.032, 0.5]
    states = [OK._replace(stamp=s) for s in stamps]
    states[4] = states[4]._replace(safety=0.0)
    link = Link(states)
    with memory() as shared:
        copier = Copier(link, False, 3, 0.008, shared)
        for link.at in range(len(states)):
            copier.look()
        state = shared.read()
        assert (state.received, state.skipped, state.bad) == (4.0, 3.0, 2.0)
        assert state.back == pytest.approx(1.54)
        going_on = Copier(link, False, 3, 0.008, shared)
        going_on.look()
        assert shared.read().received == 5.0 and shared.read().back == 0.0
