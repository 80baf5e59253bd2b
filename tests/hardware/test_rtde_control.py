"""What the process that commands a UR robot tells it: moves, targets, stops."""

import math

import numpy as np
import pytest

from wrenchbed.hardware.drivers.rtde import control_worker
from wrenchbed.hardware.drivers.rtde.control_worker import Control, TargetStream

SOFT, HARD, SOFT_SERVO = 3.0, 15.0, 4.0
PERIOD = 0.008
N = 10_000


class Script:
    """What ur_rtde was told; its operation goes on until it is told otherwise."""

    def __init__(self):
        self.told, self.running, self.plays = [], False, True

    def servoJ(self, q, *_):
        self.told.append(q[0])
        return self.plays

    def servoStop(self, deceleration):
        self.told.append(deceleration)
        return self.plays

    def moveJ(self, q, speed, acceleration, asynchronous):
        self.told.append("move")
        return True

    def stopJ(self, deceleration, asynchronous):
        self.told.append(deceleration)

    def getAsyncOperationProgressEx(self):
        return self

    def isAsyncOperationRunning(self):
        return self.running

    def kickWatchdog(self):
        self.told.append("kick")
        return self.plays


class Channel:
    def __init__(self):
        self.sent = []

    def send(self, message):
        self.sent.append(message)


class Numbers:
    """Of a robot that has a speed; no state is newer than a time."""

    def __init__(self, clock):
        self.clock, self.speed, self.newest = clock, 0.0, math.inf

    def get(self, name):
        return self.speed if name == "speed" else min(self.clock[0], self.newest)

    def silence(self, name):
        return self.clock[0] - self.get("state") if name == "state" else 0.0

    def beat(self, name): ...


def told(control, script, *orders):
    for order in orders:
        do = {"do": "move", "q": [0.0] * 6, "speed": 1.0, "acceleration": 1.0}
        control._obey({"id": 1} | (do if order == "move" else {"do": "stop", "kind": order}))
    return script.told


@pytest.fixture
def clock(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(control_worker.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(control_worker.time, "sleep", lambda s: now.__setitem__(0, now[0] + s))
    return now


@pytest.fixture
def control(clock):
    script = Script()
    return Control(script, Numbers(clock), Channel(), 10.0, 0.008), script


def test_a_soft_stop_does_not_soften_a_hard_one(control):
    control, script = control
    script.running = True
    assert told(control, script, "move", "hard", "soft") == ["move", HARD]


def test_a_soft_stop_is_sent_right_after_a_move_began_and_not_at_rest(control, clock):
    control, script = control  # the robot does not say yet that the move goes on
    assert told(control, script, "move", "soft") == ["move", SOFT]
    clock[0] += 1.0
    assert told(control, script, "soft") == ["move", SOFT]


def aimed(control, *targets):
    for at, first in targets:
        control._obey({"do": "servo", "q": [first] + [0.0] * 5, "at": at})


def released(control, script, clock, seconds=0.5):
    """What is sent in the next time [s]."""
    before, end = len(script.told), clock[0] + seconds
    while clock[0] < end:
        control._release()
        clock[0] += 0.004
    return script.told[before:]


def test_targets_are_sent_when_they_are_due(control, clock):
    control, script = control
    aimed(control, (100.1, 0.1), (100.2, 0.2))
    assert released(control, script, clock, 0.05) == []
    assert released(control, script, clock, 0.1) == [0.1]
    assert released(control, script, clock) == [0.2]


@pytest.mark.parametrize("order, sent", [("hard", HARD), ("soft", SOFT_SERVO), ("move", "move")])
def test_nothing_that_waits_is_sent_after_a_stop_or_a_move(control, clock, order, sent):
    control, script = control
    aimed(control, (100.0, 0.1), *((100.1 + 0.01 * k, 0.2) for k in range(9)))
    assert released(control, script, clock, 0.05) == [0.1]
    assert sent in told(control, script, order)
    assert released(control, script, clock) == []


def test_a_program_that_ended_takes_no_target(control, clock):
    control, script = control
    script.plays = False
    aimed(control, (100.0, 0.1), (100.1, 0.2))
    assert released(control, script, clock) == [0.1]
    aimed(control, (clock[0], 0.3))
    assert released(control, script, clock) == []
    assert control._wire.sent[0] == {"event": "ended"}
    assert {m["why"] for m in control._wire.sent[1:]} == {"the robot's program does not run"}


def test_a_robot_that_nobody_sees_is_braked_and_not_kicked_any_more(control, clock):
    control, script = control
    control._shared.newest, control._shared.speed = clock[0], 0.5
    aimed(control, (100.0, 0.1))
    released(control, script, clock, 0.01)
    while clock[0] < 103.0:
        control._kick()
        clock[0] += 0.01
    braked = script.told.index(SOFT_SERVO)
    assert "kick" in script.told[:braked] and script.told[braked + 1 :] == []
    assert {"event": "ended"} in control._wire.sent


def test_of_several_that_are_due_the_newest_goes_at_any_rate():
    stream = TargetStream(PERIOD)
    for k in range(5):
        stream.add([float(k)] * 6, 1.0 + k)
    assert stream.take(3.5, 3.5) == [2.0] * 6
    stream.clear()
    assert stream.due == math.inf
    for k in range(10_000):
        stream.add([float(k)] * 6, 1.0 + k * PERIOD)
    assert stream.due == pytest.approx(1.0 + (10_000 - 256) * PERIOD)
    stream = TargetStream(PERIOD)
    for k in range(200):
        stream.add([0.0] * 6, 10.0 + 0.01 * k)
        assert stream.due == 10.0 + 0.01 * k
        stream.take(stream.due, 10.0)


def cycles(stream, drift, n=N, jitter=3e-4, period=PERIOD, spacing=PERIOD):
    """Cycle of the robot (n,) into which each target falls, its clock being off by drift."""
    rng = np.random.default_rng(4)
    robot = period * (1.0 + drift)
    fell = []
    for k in range(n):
        stream.add([0.0] * 6, 10.0 + k * spacing)
        sent = stream.due + jitter * rng.random()
        state = robot * math.floor(sent / robot) + 1e-4  # the last one that came
        assert stream.take(sent, state) is not None
        fell.append(math.floor(sent / robot))
    return np.array(fell)


@pytest.mark.parametrize("drift", [0.0, 200e-6, -500e-6])
def test_each_target_has_a_cycle_of_its_own_though_clocks_drift(drift):
    odd = np.diff(cycles(TargetStream(PERIOD), drift))[300:] != 1
    slips = abs(drift) * N  # where the clocks are a whole period apart
    assert odd.sum() <= math.ceil(slips) * 2
    free = TargetStream(PERIOD)
    free._follow = lambda phase: None
    if drift:
        assert (np.diff(cycles(free, drift))[300:] != 1).sum() > 10 * max(odd.sum(), 1)
