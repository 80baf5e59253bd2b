"""One contract for every driver: simulated, replayed, and over the wire against twins.

With WRENCHBED_UR5=ADDRESS[,SENSOR] or WRENCHBED_CAN=CHANNEL in the environment, the same tests run
on hardware: small moves about where the robot stands, at a twentieth of its top speed.
"""

import os
import time
from collections.abc import Iterator

import numpy as np
import pytest

from twin_process import running
from wrenchbed import registry
from wrenchbed.campaigns.recording import run as recording_run
from wrenchbed.data.plan import Plan
from wrenchbed.data.recording import Recording
from wrenchbed.errors import DriverError, PlanError
from wrenchbed.hardware.drivers.base import Driver
from wrenchbed.hardware.drivers.sim import SimDriver, SimOptions
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.robots.motion_limits import Limits
from wrenchbed.simulation.closed_form import Model

pytestmark = pytest.mark.wire

SLOW = Limits(speed=0.05, tracking=0.05)
KINDS = ["sim-ur5", "sim-medrue", "rtde", "can"]
HARDWARE = {"real-ur5": "WRENCHBED_UR5", "real-can": "WRENCHBED_CAN"}
SMALL = 0.03


def device(name: str, robot: str, **options) -> Driver:
    kind = registry.load("drivers", name)
    return kind(kind.options(robot=robot, **options))


@pytest.fixture(
    scope="module", params=[*KINDS, *(k for k, v in HARDWARE.items() if v in os.environ)]
)
def make(request) -> Iterator:
    """A function that makes the driver; its twin runs as long as the tests."""
    kind = request.param
    if kind.startswith("sim"):
        yield lambda **more: SimDriver(SimOptions(kind.removeprefix("sim-"), **more))
    elif kind == "rtde":
        with running("ur5", "127.0.5.1"):
            yield lambda **more: device("rtde", "ur5", host="127.0.5.1", **more)
    elif kind == "can":
        with running("medrue", "127.0.5.2"):
            yield lambda **more: device("can", "medrue", host="127.0.5.2", **more)
    elif kind == "real-ur5":
        host, _, sensor = os.environ[HARDWARE[kind]].partition(",")
        yield lambda **more: device(
            "rtde", "ur5", host=host, sensor=sensor, **{"limits": SLOW} | more
        )
    else:
        channel = os.environ[HARDWARE[kind]]
        yield lambda **more: device("can", "medrue", channel=channel, **{"limits": SLOW} | more)


@pytest.fixture
def driver(make) -> Iterator[Driver]:
    with make() as link:
        yield link


def test_what_it_is_can_be_read_while_it_is_closed(make):
    closed = make()
    assert len(closed.robot.joints) == 6
    assert closed.health().state == "closed"
    for call in (closed.read, closed.read_wrench, closed.position, closed.settle):
        with pytest.raises(DriverError, match=r"call connect\(\) first"):
            call()
    closed.close()


def test_connect_moves_nothing_and_commands_wait_for_activate(make):
    link = make()
    link.connect()
    try:
        before = link.position()
        with pytest.raises(DriverError, match=r"call activate\(\) first"):
            link.move(before + SMALL)
        applied = link.write(before)
        assert applied.sent is None
        assert "activate" in applied.reason
        assert np.abs(link.position() - before).max() < 1e-4
    finally:
        link.close()
        link.close()
    assert link.health().state == "closed"


def test_reading_never_blocks_and_says_how_old_it_is(driver):
    for _ in range(20):
        begun = time.monotonic()
        arm, wrench = driver.read(), driver.read_wrench()
        assert time.monotonic() - begun < 0.05
        assert 0.0 <= arm.age < 0.1
        assert 0.0 <= wrench.age < 0.1
        assert arm.q.shape == arm.qd.shape == (6,)
        assert wrench.wrench.shape == (6,)
        assert np.isfinite(wrench.wrench).all()
        assert wrench.frame
        assert wrench.reference
        time.sleep(0.01)
    assert driver.health().ok, driver.health()


def test_a_move_is_polled_and_arrives(driver):
    goal = driver.position() + SMALL * np.array([1, -1, 1, -1, 1, 1])
    begun = time.monotonic()
    motion = driver.move(goal)
    if driver.live:
        assert time.monotonic() - begun < 0.2
    polls = 0
    while (end := motion.poll()) is None:
        polls += 1
        time.sleep(0.002 if driver.live else 0.0)
    assert polls > 3
    assert np.abs(end.q - goal).max() < 1e-3
    assert end.duration > 0.1
    assert np.abs(driver.position() - goal).max() < 1e-3


def test_a_cancelled_move_stops_on_the_way(driver):
    start = driver.position()
    goal = start + (0.5 if driver.robot.joints[0].unit == "rad" else 0.25) * np.eye(6)[0]
    motion = driver.move(goal)
    for _ in range(40):
        motion.poll()
        time.sleep(0.01 if driver.live else 0.0)
    motion.cancel()
    motion.cancel()
    with pytest.raises(DriverError, match="cancelled"):
        motion.poll()
    driver.settle()
    stopped = driver.position()
    assert np.abs(stopped - start).max() > 1e-4
    assert np.abs(stopped - goal).max() > 1e-3
    time.sleep(0.2 if driver.live else 0.0)
    assert np.abs(driver.position() - stopped).max() < 1e-3
    driver.move(start).wait()


def test_what_is_beyond_limits_is_refused_and_nothing_moves(driver):
    before = driver.position()
    far = before.copy()
    far[1] = 9.0
    with pytest.raises(PlanError, match="outside its limits"):
        driver.move(far)
    leap = driver.write(before + 0.3)
    assert leap.sent is None
    assert "its limit is" in leap.reason
    assert np.abs(driver.position() - before).max() < 1e-3


def test_a_recording_is_kept_bit_by_bit_and_its_time_only_grows(driver, tmp_path):
    q = driver.position() + SMALL * np.random.default_rng(5).standard_normal((3, 6))
    plan = Plan.of(driver.robot.name, q)
    done = recording_run.record(driver, plan, tmp_path / "r.parquet", samples=20, rate=100.0)
    rec = Recording.read(tmp_path / "r.parquet")
    rows = 20 * (4 if driver.live else 3)
    assert done.rows == len(rec) == rows
    assert (np.diff(rec.t) > 0).all()
    rec.write(tmp_path / "again.parquet")
    again = Recording.read(tmp_path / "again.parquet")
    assert again.columns.keys() == rec.columns.keys()
    assert all(np.array_equal(again.columns[c], rec.columns[c]) for c in rec.columns)
    assert again.metadata == rec.metadata
    first = rec.columns["segment"] == 0
    assert np.abs(rec.q[first] - q[0]).max() < 1e-3
    if not set(HARDWARE.values()) & os.environ.keys():  # a twin weighs what its model says
        model = Model.of(driver.robot)
        wanted = model.predict(q[:1], model.parameters.nominal)[0]
        assert np.abs(rec.wrench[first].mean(axis=0) - wanted)[:3].max() < 0.1


def test_a_trajectory_is_followed_on_an_even_clock(driver):
    start, rate = driver.position(), 125.0
    t = np.arange(150) / rate
    swing = 0.5 * (1 - np.cos(2 * np.pi * t / t[-1]))
    targets = start + 0.02 * swing[:, None] * np.array([1, 1, -1, 1, 1, 1])
    blocks = [dict(b) for b in driver.track(targets, rate)]
    rows = {k: np.concatenate([b[k] for b in blocks]) for k in blocks[0]}
    assert len(rows["t"]) == 150
    assert np.abs(np.diff(rows["t"]) - 1 / rate).max() < 1e-6
    q = np.stack([rows[f"q{j}"] for j in range(1, 7)], axis=-1)
    assert np.abs(q - targets).max() < 0.015  # a servo follows late
    assert np.abs(q[60:90] - start).max() > 0.01
    assert {"qd1", "q_target6", *CHANNELS, "status"} <= rows.keys()
    driver.settle()


def test_a_stop_holds_and_recover_makes_it_ready(driver):
    driver.stop()
    driver.stop("hard")
    driver.recover()
    assert driver.health().ok
    goal = driver.position() + 0.5 * SMALL
    assert np.abs(driver.move(goal).wait().q - goal).max() < 1e-3
