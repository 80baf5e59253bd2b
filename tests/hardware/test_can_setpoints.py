"""What the drives are told each cycle, and whether they follow it."""

import numpy as np
import pytest

from wrenchbed.hardware.drivers.can.cycle import Following
from wrenchbed.hardware.drivers.can.setpoints import BRAKE_S, Setpoints

T = 0.004
TOP = np.ones(6)


def points(q=0.0):
    setpoints = Setpoints(T, -np.ones(6), np.ones(6), TOP)
    setpoints.hold(np.full(6, q))
    return setpoints


def test_a_move_begins_and_ends_at_rest_and_is_never_faster_than_told():
    setpoints = points()
    setpoints.move(np.full(6, 0.3), 1.0)
    way = np.array([setpoints.step()[0] for _ in range(260)])
    assert way[-1] == pytest.approx(0.3) and not setpoints.moving
    speed = np.diff(way) / T
    assert speed.max() == pytest.approx(1.875 * 0.3, rel=0.01)
    assert speed[0] < 0.02 and abs(speed[240:]).max() < 0.02


def test_no_cycle_goes_further_than_top_speed_or_beyond_the_limits():
    setpoints = points()
    setpoints.stream(np.full(6, 5.0), 1.0)
    way = np.array([setpoints.step()[0] for _ in range(20)])
    assert np.diff(way).max() <= 1.1 * T + 1e-12 and setpoints.clipped > 0
    setpoints = points(0.999)
    setpoints.move(np.full(6, 2.0), 4.0)
    assert max(setpoints.step()[0] for _ in range(1200)) <= 1.0


def test_a_late_cycle_does_not_jump():
    setpoints = points()
    setpoints.move(np.full(6, 0.3), 1.0)
    for _ in range(100):
        setpoints.step()
    before = setpoints.command[0]  # however late the next step is asked for
    assert abs(setpoints.step()[0] - before) < 0.3 * 1.875 * T + 1e-9


def test_braking_ends_at_rest_without_a_jerk_back():
    setpoints = points()
    setpoints.move(np.full(6, 0.8), 1.5)
    for _ in range(180):
        setpoints.step()
    setpoints.brake()
    way = np.array([setpoints.step()[0] for _ in range(60)])
    speed = np.diff(way) / T
    assert (speed > -1e-9).all() and not setpoints.moving
    assert abs(speed[int(BRAKE_S / T) + 1 :]).max() == 0.0


def test_braking_that_is_asked_for_in_every_cycle_takes_no_longer():
    once, again = points(), points()
    for setpoints in (once, again):
        setpoints.move(np.full(6, 0.8), 1.5)
        for _ in range(180):
            setpoints.step()
        setpoints.brake()
    ways: list[list[float]] = [[], []]
    for _ in range(60):
        again.brake()
        for way, setpoints in zip(ways, (once, again), strict=True):
            way.append(setpoints.step()[0])
    assert ways[0] == ways[1] and not again.moving
    again.move(np.zeros(6), 1.0)  # and what is told after it is done as ever
    again.step()
    again.brake()
    assert again.moving


def test_a_joint_beyond_its_limits_is_held_there_and_only_let_in():
    setpoints = points(-1.4)
    assert setpoints.outside(np.full(6, -1.4)) == (0, -1.0, 1.0)
    assert setpoints.outside(np.full(6, -1.0005)) is None
    assert setpoints.outside(np.array([0, 0, 0, np.nan, 0, 0]))[0] == 3
    held = [setpoints.step()[0] for _ in range(50)]
    assert set(held) == {-1.4} and setpoints.clipped == 0
    setpoints.move(np.full(6, -2.0), 1.0)
    assert min(setpoints.step()[0] for _ in range(300)) == -1.4 and setpoints.clipped > 0
    setpoints.move(np.zeros(6), 4.0)
    way = [setpoints.step()[0] for _ in range(1010)]
    assert way[-1] == pytest.approx(0.0) and (np.diff(way) >= -1e-12).all()
    setpoints.move(np.full(6, -1.4), 4.0)
    assert min(setpoints.step()[0] for _ in range(1010)) == -1.0  # once in, it stays in


def test_a_stream_reaches_each_target_in_the_time_between_them():
    setpoints = points()
    for k in range(1, 40):
        setpoints.stream(np.full(6, 0.002 * k), 1.0 + 0.008 * k)
        steps = [setpoints.step()[0] for _ in range(2)]
    assert steps[-1] == pytest.approx(0.002 * 39)
    assert setpoints.clipped == 0


def test_a_drive_whose_position_stays_while_its_target_moves_is_stuck():
    follow = Following(TOP)
    counts, target = np.zeros(6, dtype=int), np.zeros(6)
    found = None
    for k in range(60):
        target = np.full(6, 1e-3 * k)
        counts = np.array([k, k, 0, k, k, k])
        found = follow.check(counts, target - 0.005, target)
        if found:
            break
    assert found[0] == 2 and k == 11
    assert follow.check(counts + 1, target, target) is None
