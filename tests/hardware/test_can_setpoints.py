"""What MedRUE's drives are told each cycle, whether they follow it, and what is refused before."""

import time

import can
import numpy as np
import pytest

from wrenchbed.errors import LinkError, ParameterError
from wrenchbed.hardware.drivers.can import CanOptions
from wrenchbed.hardware.drivers.can.bus import CanLink, open_bus
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


def test_braking_ends_at_rest_and_takes_no_longer_where_it_is_asked_for_in_every_cycle():
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
    speed = np.diff(ways[0]) / T
    assert (speed > -1e-9).all() and abs(speed[int(BRAKE_S / T) + 1 :]).max() == 0.0
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


LEAD, APART = 0.1, 0.008


def sine(t):
    return 0.1 * np.sin(3.0 * np.maximum(t, 0.0)) ** 2


def streamed(arrivals, cycles, motion=sine, lost=None):
    """Setpoints, the way of a joint whose targets for every 8 ms arrive at some times [s], and the
    times of the targets that it should be at."""
    setpoints, way, times, sent, now = points(), [], [], 0, 0.0
    for n in range(cycles):
        cycles_lost = (lost or {}).get(n, 0)
        if cycles_lost:
            setpoints.lose(cycles_lost * T)
            now += cycles_lost * T
        while sent < len(arrivals) and arrivals[sent] <= now + 1e-12:
            at = APART * sent + LEAD
            at = at if at > now else now + LEAD  # as the driver does
            setpoints.follow(np.full(6, motion(APART * sent)), at, now)
            sent += 1
        now += T
        way.append(setpoints.step()[0])
        times.append(now - LEAD)
    return setpoints, np.array(way), np.array(times)


@pytest.mark.parametrize("late", [0.0, 0.004, 0.04])
def test_targets_that_come_early_make_a_smooth_path_whenever_they_arrive(late):
    arrivals = APART * np.arange(250) + late * np.random.default_rng(1).random(250)
    arrivals[0] = 0.0
    setpoints, way, t = streamed(np.maximum.accumulate(arrivals), 480)
    assert np.abs(way - sine(t)).max() < 2e-5 and setpoints.clipped == 0
    jerk = np.diff(way, 3)[30:] / T**3
    assert np.abs(jerk).max() < 60.0  # of the motion: 10.8; of a jump in speed 0.2/(8 ms)²


def test_targets_that_fail_to_come_end_at_rest_at_the_last_one_without_a_jolt():
    arrivals = APART * np.arange(200.0)
    arrivals[100:] += 0.5  # the sender is stuck for half a second, and sends the next as planned
    setpoints, way, _ = streamed(arrivals, 400)
    stuck = way[int(0.95 / T) : int(1.28 / T)]
    assert np.ptp(stuck) == 0.0 and stuck[0] == pytest.approx(sine(99 * APART))
    assert way.max() <= 0.1 + 1e-6  # never beside its path
    growth = np.diff(way, 2)[4 : int(1.28 / T)] / T**2
    assert np.abs(growth).max() < 0.3 / 0.06 * 1.3  # top speed over the time of the brake
    arrivals[101:] += 10.0
    setpoints, way, _ = streamed(arrivals, 600)
    assert not setpoints.moving and way[-1] == pytest.approx(sine(100 * APART))


def test_few_lost_cycles_are_made_up_for_at_once_and_many_slowly():
    _, way, t = streamed(APART * np.arange(500.0), 950, lambda t: 0.1 * t, lost={300: 2, 400: 4})
    late = t - way / 0.1
    assert np.abs(late[60:400]).max() < 1e-3 and np.diff(way)[299] == pytest.approx(0.3 * T)
    assert late[400] == pytest.approx(4 * T, abs=1e-3) and abs(late[940]) < 1e-3
    assert np.diff(way)[301:].max() < 0.1 * T * 1.051


def test_a_late_target_does_not_jump_and_a_far_one_is_no_faster_than_top_speed():
    setpoints = points()
    setpoints.follow(np.full(6, 0.001), LEAD, 0.0)
    for k in range(10):
        setpoints.follow(np.full(6, 0.001 * (k + 2)), 0.101 + 1e-4 * k, 0.2)  # all overdue
    way = np.array([setpoints.step()[0] for _ in range(80)])
    assert way[-1] == pytest.approx(0.011) and np.diff(way).max() <= 1.1 * T + 1e-12
    setpoints.follow(np.full(6, 0.9), 1.0 + LEAD, 1.0)
    way = np.array([setpoints.step()[0] for _ in range(400)])
    assert np.diff(way).max() <= 1.1 * T + 1e-12 and way[-1] == pytest.approx(0.9)


@pytest.mark.parametrize("lost", [0, 2])
def test_a_stop_brakes_from_the_speed_of_the_motion_and_drops_the_targets_that_wait(lost):
    setpoints = points()
    for k in range(60):
        setpoints.follow(np.full(6, 0.002 * k), APART * k + LEAD, 0.0)
    for _ in range(80):
        setpoints.step()
    setpoints.lose(lost * T)
    at = setpoints.step()[0]
    setpoints.brake()
    way = np.array([setpoints.step()[0] for _ in range(60)])
    assert (np.diff(way) > -1e-12).all() and not setpoints.moving
    assert way[-1] - at == pytest.approx(0.25 * BRAKE_S / 2.0, rel=0.05)
    setpoints.follow(np.full(6, 0.5), 1.0 + LEAD, 1.0)
    setpoints.hold(np.zeros(6))
    assert setpoints.step()[0] == 0.0


pytest.importorskip("canopen")


class Full:
    """A python-can bus whose transmit queue is full some times; then another error, if any."""

    def __init__(self, times, then=None):
        self.times, self.then, self.sent = times, then, 0

    def send(self, message, timeout):
        if self.times > 0:
            self.times -= 1
            raise can.CanOperationError("Failed to transmit: No buffer space available", 105)
        if self.then is not None:
            raise self.then
        self.sent += 1

    def recv(self, timeout):
        time.sleep(timeout)

    def shutdown(self):
        pass


def test_a_full_transmit_queue_is_waited_for():
    bus = Full(3)
    link = CanLink(bus)
    link.send(0x123, b"")
    link.close()
    assert (bus.sent, link.full, link.failures) == (1, 3, 0)


@pytest.mark.parametrize(
    "bus, least", [(Full(10**9), 0.05), (Full(0, can.CanOperationError("down", 100)), 0.0)]
)
def test_a_bus_that_takes_nothing_is_given_up(bus, least):
    link, begun = CanLink(bus), time.monotonic()
    with pytest.raises(LinkError, match="takes no frames"):
        link.send(0x123, b"")
    passed = time.monotonic() - begun
    link.close()
    assert least <= passed < 3.0 and "takes no frames" in link.dead
    assert (link.full > 0) == (least > 0)


@pytest.mark.parametrize("host", ["192.168..1", "[::1", "a" * 300])
def test_a_host_that_is_none_is_told(host):
    with pytest.raises(LinkError, match="CAN server at"):
        open_bus("", "can0", host, 29536, 1_000_000)


ONES = (1e6,) * 5
BAD = [
    ({"counts_per_unit": (float("nan"), *ONES)}, "finite"), ({"robot": "ur5"}, "driver 'rtde'"),
    ({"counts_per_unit": (*ONES, float("inf"))}, "finite"), ({"bitrate": 0}, "bitrate"),
    ({"counts_per_unit": (*ONES, 1e9)}, "q6 do not fit"), ({"rate": float("nan")}, "rate"),
    ({"nodes": (1, 2, 3, 4, 5, 6.5)}, "whole"), ({"watchdog": float("nan")}, "watchdog"),
    ({"port": 70000}, "port"), ({"slot": 16}, "slot"), ({"robot": "panda"}, "driver 'sim'"),
    ({"rate": 600.0}, "tenths"), ({"rate": 500.0, "bitrate": 250_000}, "% of a bus"),
    ({"nodes": (1, 2, 3)}, "six"), ({"nodes": (1, 1, 2, 3, 4, 5)}, "different"),
    ({"watchdog": 0.001}, "watchdog"), ({"counts_per_unit": (0.0,) * 6}, "none may be 0"),
]  # fmt: skip


@pytest.mark.parametrize("words, named", BAD)
def test_options_that_no_drive_can_follow(words, named):
    with pytest.raises(ParameterError, match=named):
        CanOptions(**words)


def test_a_drive_may_count_the_other_way():
    assert CanOptions(counts_per_unit=(-1e6, *ONES)).counts_per_unit[0] < 0
