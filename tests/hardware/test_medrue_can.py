"""MedRUE's twin in a process of its own: faults and stops of the driver, seen by a witness."""

import subprocess
import sys
import time

import numpy as np
import pytest

from can_witness import Witness, quick_stopped
from medrue_bench import HOST, away, options, until
from wrenchbed.errors import DriverError, LimitError, LinkError, SafetyStopError
from wrenchbed.hardware.drivers.can import CanDriver, ati_gauge_board, drive_configuration
from wrenchbed.robots.checked_moves import Limits

pytestmark = pytest.mark.wire


def test_too_much_force_stops_hard(free):
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
def test_what_is_not_on_the_bus_is_named(free, monkeypatch, words, error, named):
    monkeypatch.setattr(ati_gauge_board, "ANSWER_S", 0.1)
    monkeypatch.setattr(drive_configuration, "ANSWER_S", 0.1)
    driver = CanDriver(options(**words))
    with pytest.raises(error, match=named):
        driver.connect()


@pytest.fixture
def witness(driver):
    """Connects after the driver did."""
    with Witness(HOST) as one:
        yield one


def moving(driver):
    assert until(lambda: driver.health().ok), driver.health()
    motion = driver.move(away(driver))
    time.sleep(0.25)
    return motion


@pytest.mark.sampled
@pytest.mark.parametrize("kind", ["hub_fin", "garbage_text"])
def test_a_bus_that_is_gone_is_named_and_the_drives_stop(driver, medrue, witness, kind):
    motion = moving(driver)
    begun = time.monotonic()
    medrue.fault("can", kind)
    assert until(lambda: driver.health().state == "lost", 0.5)
    with pytest.raises(LinkError, match="CAN bus"):
        motion.wait()
    last = driver.read()
    assert until(lambda: witness.all_stopped_themselves(begun)), witness.emergencies(begun)
    assert quick_stopped(HOST)
    driver.recover(unlock=True)
    assert until(lambda: driver.health().ok, 2.5), driver.health()
    assert np.abs(driver.position() - last.q).max() < 0.02  # watchdog and quick-stop ramp
    goal = driver.position() + 0.002
    assert np.abs(driver.move(goal).wait().q - goal).max() < 1e-3


def test_a_master_that_vanishes_leaves_drives_that_stop(free):
    code = (
        "import os, numpy as np, time\n"
        "from wrenchbed.hardware.drivers.can import CanDriver, CanOptions\n"
        f"d = CanDriver(CanOptions(host='{HOST}')); d.connect(); d.recover(unlock=True)\n"
        "q = d.position(); q[0] += 0.05 if q[0] < 0.05 else -0.05\n"
        "d.move(q); time.sleep(0.3); print(*d.read().q, flush=True); os._exit(9)\n"
    )
    with Witness(HOST) as witness:
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, timeout=30
        )
        last = np.array([float(word) for word in done.stdout.split()])
        ended = max(t for t, can_id, _ in witness.heard if 0x200 < can_id < 0x207)
        assert until(lambda: witness.all_stopped_themselves(ended - 0.01)), witness.emergencies(0)
        assert quick_stopped(HOST)
    with CanDriver(options(HOST)) as driver:
        assert np.abs(driver.position() - last).max() < 0.02


def test_a_drive_that_misses_its_start_is_started_again(free, monkeypatch):
    command, missed = drive_configuration.Drives._command, []

    def lossy(self, order, node):
        if order == drive_configuration.START and node == 3 and not missed:
            missed.append(node)
        else:
            command(self, order, node)

    monkeypatch.setattr(drive_configuration.Drives, "_command", lossy)
    with CanDriver(options(HOST)) as driver:
        assert missed == [3] and driver.health().ok


def test_garbage_frames_are_named_and_every_drive_is_told_to_stop(driver, medrue, witness):
    at, begun = driver.position(), time.monotonic()
    medrue.fault("can", "garbage", count=1000)
    assert until(lambda: driver.health().state in ("lost", "fault", "stopped"), 0.5)
    assert until(lambda: quick_stopped(HOST), 1.0)
    assert "drive 1" in driver.health().detail or "drive 2" in driver.health().detail
    assert not witness.emergencies(begun).keys() & {3, 4, 5, 6}  # it was no watchdog
    driver.recover(unlock=True)
    assert until(lambda: driver.health().ok, 2.5), driver.health()
    assert np.abs(driver.position() - at).max() < 1e-3


def test_a_bus_off_that_ends_by_itself_lets_the_driver_go_on(driver, medrue):
    medrue.fault("can", "bus_off", seconds=0.15)
    assert until(lambda: driver.health().state == "stale", 0.3), driver.health()
    assert until(lambda: driver.health().ok), driver.health()  # shorter than the watchdog
