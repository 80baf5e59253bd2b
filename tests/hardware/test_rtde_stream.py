"""Streamed targets that wait for their time, and fall into one cycle of the robot each."""

import math

import numpy as np
import pytest

from wrenchbed.hardware.drivers.rtde.control_worker import TargetStream

PERIOD = 0.008
N = 20_000


def test_a_target_waits_for_its_time():
    stream = TargetStream(PERIOD)
    assert stream.due == math.inf and stream.take(1e9, 0.0) is None
    stream.add([1.0] * 6, 5.0)
    stream.add([2.0] * 6, 5.5)
    assert stream.due == 5.0
    assert stream.take(4.999, 4.999) is None
    assert stream.take(5.0, 5.0) == [1.0] * 6
    assert stream.due == 5.5


def test_of_several_that_are_due_the_newest_goes():
    stream = TargetStream(PERIOD)
    for k in range(5):
        stream.add([float(k)] * 6, 1.0 + k)
    assert stream.take(3.5, 3.5) == [2.0] * 6
    stream.clear()
    assert stream.due == math.inf


def test_it_does_not_grow_for_ever():
    stream = TargetStream(PERIOD)
    for k in range(10_000):
        stream.add([float(k)] * 6, 1.0 + k * PERIOD)
    assert stream.due == pytest.approx(1.0 + (10_000 - 256) * PERIOD)


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


@pytest.mark.parametrize("drift", [0.0, 200e-6, -200e-6, 500e-6, -500e-6])
def test_each_target_has_a_cycle_of_its_own_though_clocks_drift(drift):
    odd = np.diff(cycles(TargetStream(PERIOD), drift))[300:] != 1
    slips = abs(drift) * N  # where the clocks are a whole period apart
    assert odd.sum() <= math.ceil(slips) * 2
    free = TargetStream(PERIOD)
    free._follow = lambda phase: None
    if drift:
        assert (np.diff(cycles(free, drift))[300:] != 1).sum() > 10 * max(odd.sum(), 1)


def test_targets_at_another_rate_are_sent_when_they_are_due():
    stream = TargetStream(PERIOD)
    for k in range(200):
        stream.add([0.0] * 6, 10.0 + 0.01 * k)
        assert stream.due == 10.0 + 0.01 * k
        stream.take(stream.due, 10.0)
