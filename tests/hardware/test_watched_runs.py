"""Readings at a time, moves watched to their end, and stops that stay as hard as they were."""

import numpy as np
import pytest

from wrenchbed.errors import DriverError, LateError, LimitError, LinkError
from wrenchbed.hardware.device import Health
from wrenchbed.hardware.drivers.base import watched_move
from wrenchbed.hardware.drivers.base.samples import ArmSample
from wrenchbed.hardware.drivers.base.timing import Resampler
from wrenchbed.hardware.drivers.base.watched_move import WatchedMove
from wrenchbed.hardware.transducers.base import Past, WrenchSample


def sample(t, force, status=0, saturated=0, faults=()):
    wrench = np.array([force, 0.0, 0.0, 0.0, 0.0, 0.0])
    return WrenchSample(t, None, 1, 0.0, True, wrench, status=status, saturated=saturated,
                        faults=faults)  # fmt: skip


def test_a_reading_between_two_has_the_flags_of_both():
    past = Past(8)
    past.add(sample(1.00, 1.0, status=1, faults=("hot",)))
    past.add(sample(1.04, 3.0, status=2, saturated=4, faults=("hot", "wet")))
    between = past.at(1.01)
    assert between.wrench[0] == pytest.approx(1.5)
    assert (between.status, between.saturated, between.faults) == (3, 4, ("hot", "wet"))
    assert between.age == pytest.approx(0.01)


def test_of_readings_close_together_the_nearer_one_counts():
    past = Past(8)
    for t, force in ((1.0, 1.0), (1.0005, 3.0), (1.0025, 5.0)):
        past.add(sample(t, force))
    told = [past.at(t).wrench[0] for t in (1.0, 1.0002, 1.0003, 1.0005, 1.0015)]
    assert told == pytest.approx([1.0, 1.0, 3.0, 3.0, 4.0])


def test_nothing_is_told_before_after_and_in_a_gap():
    past = Past(8)
    for t in (1.0, 1.04, 1.2):
        past.add(sample(t, 0.0))
    past.add(sample(1.1, 9.0))  # older than the last: not kept
    assert past.at(0.99) is None and past.at(1.21) is None and past.at(1.1) is None
    assert past.at(1.0) is not None and past.at(1.2) is None


def test_states_too_far_apart_end_a_motion():
    even = Resampler(100.0)
    for t in (0.0, 0.01, 0.02, 0.25):
        even.add(ArmSample(t, None, 0, 0.0, True, np.zeros(6), np.zeros(6)))
    assert len(even.rows(3)) == 3
    with pytest.raises(LinkError, match=r"gap of 0\.230 s"):
        even.rows(9)


class Watched:
    """A driver whose joints come nearer by so much a look."""

    def __init__(self, step, clock, force=None):
        self.q, self.step, self.clock, self.force = np.ones(6), step, clock, force
        self.stops = []

    def read(self):
        self.clock[0] += 0.5
        self.q = self.q - self.step
        return ArmSample(self.clock[0], None, 0, 0.0, True, self.q, np.full(6, 0.01))

    def health(self):
        return Health("ok")

    def guard(self):
        if self.force is not None:
            raise LimitError("too much")

    def stop(self, kind="soft"):
        self.stops.append(kind)
        if self.force == "and the stop fails":
            raise LinkError("no answer")


@pytest.fixture
def clock(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(watched_move.time, "monotonic", lambda: now[0])
    return now


def test_a_slow_move_is_waited_for_while_it_comes_nearer(clock):
    driver = Watched(0.01, clock)
    motion = WatchedMove(driver, np.zeros(6), 1.0)
    for _ in range(80):  # forty seconds of a move of one
        assert motion.poll() is None
    driver.step = 0.0
    with pytest.raises(LateError, match="speed slider"):
        for _ in range(20):
            motion.poll()
    assert driver.stops == ["soft"]


def test_a_stop_for_too_much_force_stays_hard(clock):
    driver = Watched(0.01, clock, force="much")
    with pytest.raises(LimitError):
        WatchedMove(driver, np.zeros(6), 1.0).poll()
    assert driver.stops == ["hard"]


def test_a_stop_that_fails_is_told_too(clock):
    driver = Watched(0.01, clock, force="and the stop fails")
    with pytest.raises(LimitError) as caught:
        WatchedMove(driver, np.zeros(6), 1.0).poll()
    assert caught.value.__notes__ == ["the stop failed, too: no answer"]


def test_an_interrupted_wait_stops_the_robot(clock):
    driver = Watched(0.01, clock)
    driver.guard = lambda: (_ for _ in ()).throw(KeyboardInterrupt)
    motion = WatchedMove(driver, np.zeros(6), 1.0)
    with pytest.raises(KeyboardInterrupt):
        motion.wait()
    assert driver.stops == ["soft"]
    with pytest.raises(DriverError, match="interrupted"):
        motion.poll()
