"""MedRUE's twin in a process of its own, and the driver against it: motion, faults, recovery."""

import time

import numpy as np
import pytest

from medrue_bench import away, options, until
from wrenchbed.errors import DriverError, LimitError, LinkError, SafetyStopError
from wrenchbed.hardware.drivers.can import CanDriver
from wrenchbed.robots.motion_limits import Limits

pytestmark = pytest.mark.wire


def test_too_much_force_stops_hard(medrue):
    with CanDriver(options(limits=Limits(speed=0.25, force=1.0))) as driver:
        with pytest.raises(LimitError, match="above the limit"):
            driver.move(away(driver)).wait()
        assert driver.health().state == "stopped"


ARM = {
    "mute": ({"node": 3, "seconds": 0.4}, "lost", "drive 3 is mute", 0.15),
    "emcy": ({"node": 5, "code": 0x2310}, "fault", "drive 5.*over-current", 0.15),
    "following_error": ({"node": 4}, "fault", "drive 4.*following error", 0.15),
    "frozen": ({"node": 1, "seconds": 0.6}, "fault", "drive 1 stands still", 0.5),
    "node_reboot": ({"node": 6}, "lost", "drive 6 restarted", 0.15),
    "heartbeat_loss": ({"node": 2, "seconds": 0.6}, "lost", "drive 2 sends no heartbeat", 0.6),
    "stall": ({"seconds": 0.7}, "stopped", "drive", 1.0),
}


@pytest.mark.sampled
@pytest.mark.parametrize("kind", ARM)
def test_a_fault_of_the_arm_is_named_stops_it_and_is_recovered_from(driver, medrue, kind):
    values, state, words, within = ARM[kind]
    motion = driver.move(away(driver))
    time.sleep(0.25)
    begun = time.monotonic()
    medrue.fault("can", kind, **values)
    assert until(lambda: driver.health().state == state, within + 1.0), driver.health()
    named = time.monotonic() - begun
    assert named < within + 0.5
    with pytest.raises(DriverError, match=words):
        motion.wait()
    seen = driver.read()
    time.sleep(max(0.15, begun + values.get("seconds", 0.0) + 0.1 - time.monotonic()))
    # at 62 mm/s: what it did before it was seen, a late cycle, the ramp, the servos' lag
    age = named if kind == "frozen" else seen.age  # a frozen drive's position is the fault's
    assert np.abs(driver.read().q - seen.q).max() < 0.0625 * (age + 0.15)
    assert driver.health().state == state  # named until somebody recovers
    if kind in ("emcy", "following_error"):
        with pytest.raises(SafetyStopError, match=words):
            driver.recover(unlock=False)
    driver.recover(unlock=True)
    assert until(lambda: driver.health().ok), driver.health()
    driver.move(driver.position()).wait()


SENSOR = {
    "swapped_pair": ({"seconds": 0.3}, "stale"),
    "second_frame_lost": ({"share": 1.0, "seconds": 0.3}, "stale"),
    "mute_board": ({"seconds": 0.3}, "stale"),
    "reset_board": ({}, "stale"),
    "status": ({"bits": 1 << 4, "seconds": 0.3}, "fault"),
    "id_clash": ({"seconds": 0.3}, "fault"),
}


@pytest.mark.sampled
@pytest.mark.parametrize("kind", SENSOR)
def test_a_fault_of_the_sensor_is_named_and_passes(driver, medrue, kind):
    values, state = SENSOR[kind]
    before = driver.read_wrench().wrench
    medrue.fault("can", kind, **values)
    assert until(lambda: driver.health().state == state, 0.4), driver.health()
    assert until(lambda: driver.health().ok, 2.5), driver.health()
    assert until(lambda: driver.read_wrench().age < 0.05)
    assert driver.read_wrench().wrench == pytest.approx(before, abs=0.1)


def test_a_reset_that_was_too_short_to_notice_is_found_in_the_matrix(driver, medrue):
    before = driver.read_wrench().wrench
    calibrations = driver.health().counters["wrench calibrations"]
    medrue.fault("can", "reset_board", silent=False)
    assert until(lambda: driver.health().counters["wrench calibrations"] > calibrations, 1.0)
    assert until(lambda: driver.read_wrench().age < 0.05 and driver.health().ok)
    assert driver.read_wrench().wrench == pytest.approx(before, abs=0.1)


def test_a_saturated_gauge_marks_every_channel_that_it_feeds(driver, medrue):
    medrue.fault("can", "saturated_gauge", gauge=2, seconds=0.3)
    assert until(lambda: driver.read_wrench().saturated == 0b111111, 1.0)
    assert until(lambda: driver.read_wrench().saturated == 0, 2.0)


@pytest.mark.parametrize(
    "words, error, named",
    [
        ({"slot": 7}, DriverError, "no calibration in slot 7"),
        ({"base": 0x69}, LinkError, "base 0x69"),
        ({"nodes": (1, 2, 3, 4, 5, 16)}, LinkError, "drive 16"),
    ],
)
def test_what_is_not_on_the_bus_is_named(medrue, words, error, named):
    driver = CanDriver(options(**words))
    with pytest.raises(error, match=named):
        driver.connect()
