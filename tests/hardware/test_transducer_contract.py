"""One contract for every registered transducer."""

import time
from collections.abc import Iterator

import numpy as np
import pytest

from devices import TRANSDUCERS
from wrenchbed import registry
from wrenchbed.errors import DriverError


def check_it_refuses_to_read_while_it_is_closed(make):
    closed = make()
    assert closed.health().state == "closed"
    for call in (closed.read, lambda: closed.at(time.monotonic())):
        with pytest.raises(DriverError, match=r"call connect\(\) first"):
            call()
    with make() as opened:
        opened.read()
    assert opened.health().state == "closed"
    opened.close()
    opened.connect()
    opened.read()
    opened.close()


def check_readings_are_six_finite_numbers_with_their_age_and_fresh_once(make):
    with make() as sensor:
        time.sleep(0.05)
        sequences = []
        for _ in range(20):
            begun = time.monotonic()
            sample = sensor.read()
            assert time.monotonic() - begun < 0.05
            assert sample.wrench.shape == (6,) and np.isfinite(sample.wrench).all()
            assert 0.0 <= sample.age < 0.5 and sample.t <= time.monotonic()
            assert sample.lost >= 0 and sample.saturated == 0
            sequences.append(sample.sequence)
            time.sleep(0.01)
        assert sequences == sorted(sequences) and sequences[-1] > sequences[0]
        seen, fresh = set(), 0
        for _ in range(50):
            sample = sensor.read()
            assert sample.fresh is ((sample.sequence, sample.t) not in seen)
            seen.add((sample.sequence, sample.t))
            fresh += sample.fresh
            time.sleep(0.002)
        assert fresh > 1
        health = sensor.health()
        assert health.ok, health
        assert health.counters and all(np.isfinite(v) for v in health.counters.values())


def check_the_past_is_known_and_the_future_is_not(make):
    with make() as sensor:
        for _ in range(30):
            newest = sensor.read()
            time.sleep(0.005)
        known = sensor.at(newest.t - 0.03)
        assert known is not None and abs(known.t - (newest.t - 0.03)) < 1e-6
        assert known.wrench.shape == (6,) and 0.0 <= known.age < 0.05
        assert sensor.at(time.monotonic() + 1.0) is None
        assert sensor.at(newest.t - 100.0) is None


CHECKS = [f for name, f in sorted(globals().items()) if name.startswith("check_")]


@pytest.fixture(scope="module", params=registry.names("transducers"))
def make(request) -> Iterator:
    with TRANSDUCERS[request.param]() as made:
        yield made


@pytest.mark.wire
@pytest.mark.parametrize("check", CHECKS, ids=lambda f: f.__name__[6:])
def test_every_transducer_keeps_the_contract(make, check):
    check(make)
