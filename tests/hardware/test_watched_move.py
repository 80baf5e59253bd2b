"""A watched move and the limits, speeds and ticks that drivers keep, with numbers by hand."""

import numpy as np
import pytest

from wrenchbed import registry
from wrenchbed.errors import (
    DriverError,
    LateError,
    LimitError,
    LinkError,
    ParameterError,
    PlanError,
    StoppedError,
)
from wrenchbed.hardware.device_base import Health
from wrenchbed.hardware.drivers import live_base
from wrenchbed.hardware.drivers.base import ArmSample, block_of
from wrenchbed.hardware.drivers.live_base import WatchedMove, check_ready
from wrenchbed.robots.checked_moves import Limits, duration, minimum_jerk, straight


class Robot:
    """A driver whose state is set by hand, on a clock of its own."""

    def __init__(self, monkeypatch):
        self.now, self.q, self.qd, self.state = 100.0, 1.0, 0.0, "ok"
        self.stops, self.push, self.mute = [], False, False
        monkeypatch.setattr(live_base.time, "monotonic", lambda: self.now)
        monkeypatch.setattr(live_base.time, "sleep", self.later)

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
    robot.now += 0.15
    robot.q, robot.qd, robot.state = q, qd, state
    told = motion.poll()
    assert (told is not None) == arrived
    if arrived:
        assert told.duration == pytest.approx(0.15)
        assert told.q == pytest.approx([0.0, q])
        robot.q = 5.0
        assert motion.poll() is told  # it has ended
    assert robot.stops == []


def test_a_robot_moves_blind_for_two_tenths_of_a_second(robot):
    motion = move(robot)
    motion.poll()
    robot.state = "stale"
    robot.now += 0.19
    assert motion.poll() is None
    robot.now += 0.02
    with pytest.raises(LinkError):
        motion.poll()
    assert robot.stops == ["hard"]
    again = move(robot)
    for _ in range(20):  # seen now and then: never blind for long
        robot.state = "ok" if robot.state == "stale" else "stale"
        robot.now += 0.15
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
    assert robot.stops == ["hard" if state == "lost" else "soft"]  # once


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


def test_a_wait_ends_with_the_move_its_deadline_or_its_cancelling(robot):
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

    monkeypatch.setattr(live_base.time, "sleep", interrupted)
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


UR5 = registry.load("robots", "ur5")
HOME = np.asarray(UR5.home, dtype=float)
TOP = np.array([j.speed for j in UR5.joints])


@pytest.mark.parametrize(
    ("name", "allowed", "refused", "words"),
    [
        ("speed", (0.01, 1.0), (0.0, -0.1, 1.01), "speed .* above 0 and at most 1"),
        ("tracking", (0.01, 1.0), (0.0, -0.1, 1.01), "tracking .* above 0 and at most 1"),
        ("force", (0.5,), (0.0, -1.0), "largest force"),
        ("torque", (0.5,), (0.0, -1.0), "largest torque"),
    ],
)
def test_shares_are_above_0_and_at_most_1_and_loads_above_0(name, allowed, refused, words):
    for value in allowed:
        assert getattr(Limits(**{name: value}), name) == value
    for value in refused:
        with pytest.raises(ParameterError, match=words):
            Limits(**{name: value})


def test_loads_shares_and_workspaces_have_bounds_and_defaults():
    told = Limits()
    assert (told.speed, told.tracking) == (0.5, 1.0)
    told.check_wrench(np.full(6, 1e6))  # no limit of a load
    low = (0.0, 0.0, 0.0)
    Limits(workspace=(low, (1.0, 1.0, 1.0)))
    for high in ((1.0, 1.0, 0.0), (1.0, -1.0, 1.0)):
        with pytest.raises(ParameterError, match="each upper bound must be larger"):
            Limits(workspace=(low, high))


def test_the_sensor_stays_in_its_workspace():
    at = UR5.sensor_pose(HOME[None], UR5.parameters.nominal)[1][0]
    around = (tuple(at - 0.01), tuple(at + 0.01))
    Limits(workspace=around).check_path(UR5, HOME[None], "plan")
    away = HOME.copy()
    away[1] += 0.1
    path = np.stack([HOME, HOME, away, away])
    with pytest.raises(PlanError, match="plan: row 2: the sensor would be at"):
        Limits(workspace=around).check_path(UR5, path, "plan")
    for axis in range(3):  # one axis beyond one bound is enough
        for sign in (-1.0, 1.0):
            shift = np.zeros(3)
            shift[axis] = 0.02 * sign
            moved = (tuple(at - 0.01 + shift), tuple(at + 0.01 + shift))
            with pytest.raises(PlanError, match="row 0"):
                Limits(workspace=moved).check_path(UR5, HOME[None], "plan")
    outside = HOME.copy()
    outside[0] = 99.0
    with pytest.raises(PlanError):
        Limits().check_path(UR5, outside[None], "plan")


def test_a_trajectory_keeps_its_share_of_top_speed():
    rate, limits = 100.0, Limits(tracking=0.8)
    targets = np.stack([HOME, HOME, HOME])
    targets[1, 3] += 0.3 * 0.8 * TOP[3] / rate
    targets[2, 4] += 0.8 * TOP[4] / rate
    limits.check_motion(UR5, targets, rate, "trajectory")
    targets[2, 4] += 0.002 * TOP[4] / rate
    name = UR5.joints[4].name
    with pytest.raises(PlanError, match=f"row 2: {name} would move at .*0.802 of its top"):
        limits.check_motion(UR5, targets, rate, "trajectory")
    targets[2:, 1] = 99.0
    with pytest.raises(PlanError):
        limits.check_motion(UR5, targets, 1e-9, "trajectory")


def test_streamed_targets_are_whole_within_limits_and_hardly_faster():
    limits = Limits(tracking=0.5)
    near, far = HOME.copy(), HOME.copy()
    near[2] += 1.04 * 0.5 * TOP[2] * 0.01
    far[2] -= 1.06 * 0.5 * TOP[2] * 0.01
    assert limits.check_step(UR5, HOME, near, 0.01) == ""
    told = limits.check_step(UR5, HOME, far, 0.01)
    assert told.startswith(f"{UR5.joints[2].name} would move at")
    assert f"its limit is {0.5 * TOP[2]:.3g}" in told
    assert limits.check_step(UR5, HOME, far, 0.02) == ""
    assert "would move" in limits.check_step(UR5, HOME, near, 0.0)
    limits = Limits()
    bad = HOME.copy()
    bad[1] = np.nan
    assert limits.check_step(UR5, HOME, bad, 0.01) == "a target must be 6 finite numbers"
    assert limits.check_step(UR5, HOME, HOME[:5], 0.01) == "a target must be 6 finite numbers"
    bad[1] = 99.0
    assert "target" in limits.check_step(UR5, HOME, bad, 1e9)


@pytest.mark.parametrize(
    ("wrench", "told"),
    [
        ([3.0, 4.0, 0, 0, 0, 0], None),
        ([3.0, 4.1, 0, 0, 0, 0], "measured force 5.1 N is above the limit 5 N"),
        ([0, 0, 0, 0.6, 0.8, 0], None),
        ([0, 0, 0, 0.6, 0, -0.9], "measured torque 1.08 N·m is above the limit 1 N·m"),
    ],
)
def test_a_load_is_refused_above_its_norm(wrench, told):
    limits = Limits(force=5.0, torque=1.0)
    if told is None:
        limits.check_wrench(np.array(wrench))
        return
    with pytest.raises(LimitError, match=told):
        limits.check_wrench(np.array(wrench))


def test_a_move_is_straight_of_minimum_jerk_and_as_long_as_its_fastest_joint_needs():
    end = HOME.copy()
    end[0] += 1.0
    end[5] -= 0.9
    path = straight(HOME, end)
    assert path.shape == (33, 6)
    assert path[0] == pytest.approx(HOME) and path[-1] == pytest.approx(end)
    assert path[8] == pytest.approx(HOME + 0.25 * (end - HOME))
    expected = 1.875 * max(1.0 / TOP[0], 0.9 / TOP[5]) / 0.5
    assert duration(UR5, HOME, end) == pytest.approx(expected)
    assert duration(UR5, HOME, end, 0.1) == pytest.approx(5.0 * expected)
    assert duration(UR5, HOME, HOME) == 0.2
    s = np.array([0.0, 0.25, 0.5, 1.0])
    expected = 10 * s**3 - 15 * s**4 + 6 * s**5
    assert minimum_jerk(s) == pytest.approx(expected)
    fine = np.linspace(0.0, 1.0, 2001)
    assert (np.diff(minimum_jerk(fine)) * 2000).max() == pytest.approx(1.875, rel=1e-5)


def test_rows_become_columns_of_their_kind():
    block = block_of([{"fx": k, "status": 3 + k, "lost": k - 1, "saturated": 0} for k in (0, 1)])
    assert [block[k].dtype for k in ("fx", "status", "saturated", "lost")] == [
        np.float64, np.uint32, np.uint32, np.int64,
    ]  # fmt: skip
    assert list(block["lost"]) == [-1, 0]
