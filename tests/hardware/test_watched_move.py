"""A watched move: when it has arrived, how long it may be blind, late or stuck, and how it ends."""

import numpy as np
import pytest

from wrenchbed.errors import DriverError, LateError, LimitError, LinkError, StoppedError
from wrenchbed.hardware.device import Health
from wrenchbed.hardware.drivers import live
from wrenchbed.hardware.drivers.base import ArmSample
from wrenchbed.hardware.drivers.live import WatchedMove, check_ready


class Robot:
    """A driver whose state is set by hand, on a clock of its own."""

    def __init__(self, monkeypatch):
        self.now, self.q, self.qd, self.state = 100.0, 1.0, 0.0, "ok"
        self.stops, self.push, self.mute = [], False, False
        monkeypatch.setattr(live.time, "monotonic", lambda: self.now)
        monkeypatch.setattr(live.time, "sleep", self.later)

    def later(self, seconds):
        self.now += seconds

    def read(self):
        q, qd = np.array([0.0, self.q]), np.array([0.0, self.qd])
        return ArmSample(self.now, None, 0.0, q, qd)

    def health(self):
        return Health(self.state)

    def guard(self):
        if self.push:
            raise LimitError("too much")

    def stop(self, kind="soft"):
        self.stops.append(kind)
        if self.mute:
            raise LinkError("no answer")


@pytest.fixture
def robot(monkeypatch):
    return Robot(monkeypatch)


def move(robot, seconds=1.0):
    return WatchedMove(robot, np.zeros(2), seconds)


@pytest.mark.parametrize(
    ("q", "qd", "state", "arrived"),
    [
        (4.9e-4, 1.9e-3, "ok", True),
        (-5.1e-4, 0.0, "ok", False),
        (0.0, -2.1e-3, "ok", False),
        (0.0, 0.0, "stale", False),
    ],
)
def test_a_move_has_arrived_near_its_goal_at_rest_and_seen(robot, q, qd, state, arrived):
    motion = move(robot)
    robot.now += 0.25
    robot.q, robot.qd, robot.state = q, qd, state
    told = motion.poll()
    assert (told is not None) == arrived
    if arrived:
        assert told.duration == pytest.approx(0.25)
        assert told.q == pytest.approx([0.0, q])
        robot.q = 5.0
        assert motion.poll() is told  # it has ended
    assert robot.stops == []


def test_a_robot_moves_blind_for_three_tenths_of_a_second(robot):
    motion = move(robot)
    motion.poll()
    robot.state = "stale"
    robot.now += 0.29
    assert motion.poll() is None
    robot.now += 0.02
    with pytest.raises(LinkError):
        motion.poll()
    assert robot.stops == ["soft"]
    again = move(robot)
    for _ in range(20):  # seen now and then: never blind for long
        robot.state = "ok" if robot.state == "stale" else "stale"
        robot.now += 0.2
        robot.q *= 0.9
        assert again.poll() is None


@pytest.mark.parametrize(("state", "error"), [("stopped", StoppedError), ("lost", LinkError)])
def test_a_stop_or_a_lost_link_ends_a_move_at_once(robot, state, error):
    motion = move(robot)
    robot.state = state
    with pytest.raises(error):
        motion.poll()
    robot.state, robot.q = "ok", 0.0
    with pytest.raises(error):
        motion.poll()
    assert robot.stops == ["soft"]  # once


def test_a_stuck_move_is_given_up_after_twice_its_time_and_three_seconds(robot):
    motion = move(robot, seconds=2.0)
    motion.poll()
    robot.now = 106.9
    assert motion.poll() is None
    robot.now = 107.1
    with pytest.raises(LateError, match="1 off its goal"):
        motion.poll()
    assert robot.stops == ["soft"]


def test_beyond_its_time_a_move_must_come_nearer_by_a_millimetre_in_three_seconds(robot):
    for step, error in ((1.1e-3, False), (0.45e-3, True)):
        motion = move(robot, seconds=0.5)
        robot.q = 1.0
        motion.poll()
        begun = robot.now
        try:
            for _ in range(6):
                robot.now += 2.9
                robot.q -= step
                motion.poll()
        except LateError:
            assert error
            assert robot.now - begun < 10.0
        else:
            assert not error


def test_a_wait_ends_with_the_move_or_its_deadline(robot):
    motion = move(robot, seconds=10.0)
    with pytest.raises(LateError):
        motion.wait(0.5)
    assert robot.now == pytest.approx(100.5, abs=0.02)
    assert robot.stops == ["soft"]
    robot.q = 0.0
    assert move(robot).wait().duration == 0.0


def test_a_cancelled_move_stops_once_and_stays_cancelled(robot):
    motion = move(robot)
    motion.cancel()
    motion.cancel()
    assert robot.stops == ["soft"]
    with pytest.raises(DriverError, match="cancelled"):
        motion.poll()
    assert robot.stops == ["soft"]
    robot.q = 0.0
    done = move(robot)
    done.poll()
    done.cancel()
    assert robot.stops == ["soft"]


def test_an_interrupt_stops_the_robot(robot, monkeypatch):
    def interrupted(_):
        raise KeyboardInterrupt

    monkeypatch.setattr(live.time, "sleep", interrupted)
    motion = move(robot)
    with pytest.raises(KeyboardInterrupt):
        motion.wait()
    assert robot.stops == ["soft"]
    with pytest.raises(DriverError, match="interrupted"):
        motion.poll()


def test_a_stop_for_too_much_force_stays_hard_and_one_that_fails_is_noted(robot):
    robot.push = robot.mute = True
    with pytest.raises(LimitError) as caught:
        move(robot).poll()
    assert robot.stops == ["hard"]
    assert caught.value.__notes__ == ["the stop failed, too: no answer"]


@pytest.mark.parametrize(
    ("state", "error"),
    [("stopped", StoppedError), ("fault", StoppedError), ("stale", LinkError), ("lost", LinkError)],
)
def test_a_bad_state_raises_what_it_calls_for(state, error):
    check_ready(Health("ok"))
    with pytest.raises(error) as raised:
        check_ready(Health(state))
    assert type(raised.value) is error
    assert error is not LinkError or str(raised.value) == state
