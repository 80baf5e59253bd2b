"""Stops of MedRUE's twin, seen by a witness on the bus: what the drives do, not what the driver
thinks that they do."""

import subprocess
import sys
import time

import numpy as np
import pytest

from can_witness import Witness, quick_stopped, upload
from medrue_bench import HOST, away, options, until
from wrenchbed.errors import LinkError, StoppedError
from wrenchbed.hardware.drivers.can import CanDriver

pytestmark = pytest.mark.wire


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


@pytest.mark.slow
def test_a_hard_stop_holds_until_recover(driver, witness):
    moving(driver)
    begun = time.monotonic()
    assert until(lambda: len(witness.statuswords(begun)) == 6)
    assert {word & 0x6F for word in witness.statuswords(begun).values()} == {0x27}
    begun = time.monotonic()
    driver.stop("hard")
    at = driver.read().q
    assert driver.health().state == "stopped"

    def obeyed():
        words = witness.statuswords(begun)
        return len(words) == 6 and all(word & 0x6F == 0x07 for word in words.values())

    assert until(obeyed, 0.5), witness.statuswords(begun)
    time.sleep(0.1)
    assert np.abs(driver.read().q - at).max() < 5e-3
    with pytest.raises(StoppedError):
        driver.move(at)
    driver.recover(unlock=True)
    driver.move(driver.position()).wait()


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


def test_a_master_that_vanishes_leaves_drives_that_stop(medrue):
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


def test_garbage_frames_are_named_and_every_drive_is_told_to_stop(driver, medrue, witness):
    at, begun = driver.position(), time.monotonic()
    medrue.fault("can", "garbage", count=1000)
    assert until(lambda: driver.health().state in ("lost", "fault", "stopped"), 0.5)
    assert until(lambda: quick_stopped(HOST), 1.0), witness.statuswords(begun)
    assert "drive 1" in driver.health().detail or "drive 2" in driver.health().detail
    assert not witness.emergencies(begun).keys() & {3, 4, 5, 6}  # it was no watchdog
    driver.recover(unlock=True)
    assert until(lambda: driver.health().ok, 2.5), driver.health()
    assert np.abs(driver.position() - at).max() < 1e-3


@pytest.mark.slow
def test_bus_off_silences_the_master_until_it_opens_the_bus_again(driver, medrue, witness):
    motion = moving(driver)
    begun = time.monotonic()
    errors = driver.health().counters["arm error frames"]
    medrue.fault("can", "bus_off")
    assert until(lambda: not driver.health().ok, 0.3)
    assert driver.health().state in ("stale", "lost")
    with pytest.raises(LinkError):
        motion.wait()
    assert driver.health().counters["arm error frames"] >= errors + 2
    assert until(lambda: driver.health().state == "lost", 1.5), driver.health()
    assert until(lambda: witness.all_stopped_themselves(begun)), witness.emergencies(begun)
    assert not [t for t, can_id, _ in witness.heard if t > begun + 0.2 and can_id == 0x080]
    assert quick_stopped(HOST)
    at = upload(HOST, 1, 0x6064)
    time.sleep(0.2)
    assert upload(HOST, 1, 0x6064) == at
    driver.recover(unlock=True)
    assert until(lambda: driver.health().ok, 2.5), driver.health()
    goal = driver.position() + 0.002
    assert np.abs(driver.move(goal).wait().q - goal).max() < 1e-3


def test_a_bus_off_that_ends_by_itself_lets_the_driver_go_on(driver, medrue):
    medrue.fault("can", "bus_off", seconds=0.15)
    assert until(lambda: driver.health().state == "stale", 0.3), driver.health()
    assert until(lambda: driver.health().ok), driver.health()  # shorter than the watchdog


def test_a_node_that_restarted_is_told_its_periods_again(driver, medrue):
    told = {index: upload(HOST, 6, index) for index in (0x1006, 0x1017)}
    assert told == {0x1006: 4000, 0x1017: 100}
    medrue.fault("can", "node_reboot", node=6)
    assert until(lambda: driver.health().state == "lost", 0.5)
    assert {upload(HOST, 6, index) for index in told} == {0}
    driver.recover(unlock=True)
    assert {index: upload(HOST, 6, index) for index in told} == told
