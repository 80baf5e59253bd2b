"""One contract for every registered driver: simulated and over the wire on emulators.

With WRENCHBED_UR5=ADDRESS[,SENSOR] or WRENCHBED_CAN=CHANNEL in the environment, the same tests run
on hardware: small moves about where the robot stands, at a twentieth of its top speed.
"""

import time
from collections.abc import Iterator

import numpy as np
import pytest

from devices import DRIVERS, SMALL, DriverCase
from wrenchbed import registry
from wrenchbed.campaigns.run import record
from wrenchbed.data.plan import Plan
from wrenchbed.data.recording import Recording
from wrenchbed.errors import DriverError, PlanError
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.simulation.closed_form import Model

VARIANTS = [
    pytest.param((name, variant), marks=[pytest.mark.wire] * registry.load("drivers", name).live)
    for name in registry.names("drivers")
    for variant in DRIVERS.get(name, {"without an entry in tests/support/devices.py": None})
]


def check_closed_it_refuses_and_connected_it_waits_for_activate(case, tmp_path):
    case.close()
    link = case.make()
    assert len(link.robot.joints) > 0
    assert link.health().state == "closed"
    q = np.zeros(len(link.robot.joints))
    for call in (
        link.read, link.read_wrench, link.position, link.settle, link.stop, link.recover,
        lambda: link.sample(2, 10.0), lambda: link.write(q), lambda: link.move(q),
    ):  # fmt: skip
        with pytest.raises(DriverError, match=r"call connect\(\) first"):
            call()
    link.close()
    link.connect()
    try:
        before = link.position()
        for call in (
            lambda: link.move(before + SMALL),
            lambda: next(link.track(before[None], 9.0)),
        ):
            with pytest.raises(DriverError, match=r"call activate\(\) first"):
                call()
        applied = link.write(before)
        assert not applied.ok and "activate" in applied.reason
        assert np.abs(link.position() - before).max() < 1e-4
    finally:
        link.close()
        link.close()
    assert link.health().state == "closed"


def check_reading_never_blocks_and_what_is_beyond_limits_is_refused(case, tmp_path):
    with case.ready() as driver:
        before = driver.position()
        for _ in range(20):
            begun = time.monotonic()
            arm, wrench = driver.read(), driver.read_wrench()
            assert time.monotonic() - begun < 0.05 or not driver.live
            assert 0.0 <= arm.age < 0.1
            assert 0.0 <= wrench.age < 0.1
            assert arm.q.shape == arm.qd.shape == (len(driver.robot.joints),)
            assert wrench.wrench.shape == (6,)
            assert np.isfinite(wrench.wrench).all()
            time.sleep(0.01)
        assert driver.health().ok, driver.health()
        far = before.copy()
        far[1] = 9.0
        with pytest.raises(PlanError, match="outside its limits"):
            driver.move(far)
        with pytest.raises((PlanError, ValueError)):
            driver.move(np.full(len(before), np.nan))
        jump = driver.write(before + 0.3)
        assert jump.sent is None and jump.reason
        assert "its limit is" in jump.reason
        assert np.abs(driver.position() - before).max() < 1e-3


def check_a_stop_holds_and_a_move_is_polled_and_arrives(case, tmp_path):
    with case.ready() as driver:
        driver.stop()
        driver.stop("hard")
        driver.recover()
        assert driver.health().ok
        goal = case.goals(driver)[0]
        begun = time.monotonic()
        motion = driver.move(goal)
        if driver.live:
            assert time.monotonic() - begun < 0.2
        polls = 0
        while (end := motion.poll()) is None:
            polls += 1
            time.sleep(0.002 if driver.live else 0.0)
        assert np.abs(end.q - goal).max() < 1e-3
        assert np.abs(driver.position() - goal).max() < 1e-3
        assert polls > 3
        assert end.duration > 0.1


def check_a_cancelled_move_stops_on_the_way(case, tmp_path):
    with case.ready() as driver:
        start = driver.position()
        way = 0.5 if driver.robot.joints[0].unit == "rad" else 0.25
        goal = start + way * np.eye(len(start))[0]
        motion = driver.move(goal)
        for _ in range(30):
            motion.poll()
            time.sleep(0.01 if driver.live else 0.0)
        motion.cancel()
        motion.cancel()
        with pytest.raises(DriverError, match="cancelled"):
            motion.poll()
        driver.settle()
        stopped = driver.position()
        assert np.abs(stopped - goal).max() > 1e-3
        assert np.abs(stopped - start).max() > 1e-4
        time.sleep(0.1 if driver.live else 0.0)
        assert np.abs(driver.position() - stopped).max() < 1e-3
        driver.move(start).wait()


def check_a_recording_is_kept_bit_by_bit_and_its_time_only_grows(case, tmp_path):
    with case.ready() as driver:
        q = case.goals(driver)[:1]
        plan = Plan.of(driver.robot.name, q)
        done = record(driver, plan, tmp_path / "r.parquet", samples=20, rate=100.0)
        rec = Recording.read(tmp_path / "r.parquet")
        assert done.rows == len(rec) == 20 * (2 if driver.live else 1)
        assert (np.diff(rec.t) > 0).all()
        rec.write(tmp_path / "again.parquet")
        again = Recording.read(tmp_path / "again.parquet")
        assert again.columns.keys() == rec.columns.keys()
        assert all(np.array_equal(again.columns[c], rec.columns[c]) for c in rec.columns)
        assert again.metadata == rec.metadata
        first = rec.columns["segment"] == 0
        assert np.abs(rec.q[first] - q[0]).max() < 1e-3
        if case.modelled:
            model = Model.of(driver.robot)
            wanted = model.predict(q[:1], model.parameters.nominal)[0]
            assert np.abs(rec.wrench[first].mean(axis=0) - wanted)[:3].max() < 0.1


def check_a_trajectory_is_followed_on_an_even_clock(case, tmp_path):
    with case.ready() as driver:
        start, rate = driver.position(), 125.0
        t = np.arange(80) / rate
        swing = 0.5 * (1 - np.cos(2 * np.pi * t / t[-1]))
        targets = start + 0.02 * swing[:, None] * np.ones(len(start))
        blocks = [dict(b) for b in driver.track(targets, rate)]
        rows = {k: np.concatenate([b[k] for b in blocks]) for k in blocks[0]}
        assert len(rows["t"]) == 80
        assert np.abs(np.diff(rows["t"]) - 1 / rate).max() < 1e-6
        q = np.stack([rows[f"q{j + 1}"] for j in range(len(start))], axis=-1)
        assert np.abs(q - targets).max() < 0.015  # a servo follows late
        assert np.abs(q[32:60] - start).max() > 0.01
        assert {"qd1", f"q_target{len(start)}", *CHANNELS, "status"} <= rows.keys()
        driver.settle()


CHECKS = [f for name, f in sorted(globals().items()) if name.startswith("check_")]


@pytest.fixture(scope="module", params=VARIANTS, ids="-".join)
def case(request, tmp_path_factory) -> Iterator[DriverCase]:
    name, variant = request.param
    with DRIVERS[name][variant](tmp_path_factory.mktemp(name)) as made:
        yield made


@pytest.mark.parametrize("check", CHECKS, ids=lambda f: f.__name__[6:])
def test_every_driver_keeps_the_contract(case, check, tmp_path):
    check(case, tmp_path)
