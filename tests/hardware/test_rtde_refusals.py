"""Controllers of UR robots that refuse, are deaf, late or off when the driver comes."""

import contextlib
import time

import numpy as np
import pytest

import rtde_moves
from emulator_process import running
from wrenchbed.errors import DriverError, LinkError, StoppedError

pytest.importorskip("rtde_control")
pytestmark = pytest.mark.wire
HOST = "127.0.2.14"


@pytest.fixture(scope="module")
def refusing():
    with running("ur5", HOST, "--set", "box=off", "--set", "power=off") as process:
        yield process


def fresh(**more):
    return rtde_moves.driver(HOST, **{"connect_s": 4.0, "power_on": True} | more)


@pytest.mark.sampled
@pytest.mark.parametrize(
    "kind, values, error, words",
    [
        ("refuse_start", {"seconds": 3.3}, LinkError, "no states|did not connect"),
        ("deaf", {"seconds": 3.0}, LinkError, "does not answer|timed out|did not connect"),
        ("not_found", {"field": "actual_qd", "seconds": 0.5}, DriverError, "actual_qd"),
    ],
)
def test_a_controller_that_refuses_is_named_in_time(refusing, kind, values, error, words):
    refusing.fault("rtde", kind, **values)
    until = time.monotonic() + values["seconds"]
    driver = fresh(connect_s=2.5)
    begun = time.monotonic()
    with contextlib.closing(driver), pytest.raises(error, match=words):
        driver.connect()
    assert time.monotonic() - begun < 3.5
    time.sleep(max(0.0, until - time.monotonic()) + 0.1)


@pytest.mark.sampled
@pytest.mark.parametrize(
    "where, kind, values, error, words",
    [
        ("rtde", "in_use", {"seconds": 2.2}, DriverError, "another client"),
        ("robot", "script_never_starts", {"seconds": 5.6}, DriverError, "program|did not connect"),
        ("rtde", "deaf", {"seconds": 2.3}, LinkError, "did not connect"),
    ],
)
def test_a_controller_that_does_not_obey_is_named_in_time(
    refusing, where, kind, values, error, words
):
    driver = fresh(connect_s=2.0 if kind != "script_never_starts" else 7.0)
    with contextlib.closing(driver):
        driver.connect()
        refusing.fault(where, kind, **values)
        begun = time.monotonic()
        until = begun + values["seconds"]
        with pytest.raises(error, match=words):
            driver.activate()
        assert time.monotonic() - begun < 8.5
        assert driver.health().state in ("ok", "stopped", "stale", "lost")
    time.sleep(max(0.0, until - time.monotonic()) + 0.1)


@pytest.mark.parametrize(
    "where, kind", [("rtde", "unlisten"), ("dashboard", "unlisten"), ("script", "unlisten")]
)
def test_a_controller_that_is_late_is_waited_for(refusing, where, kind):
    driver = fresh()
    with contextlib.closing(driver):
        driver.connect() if where != "rtde" else None
        refusing.fault(where, kind, seconds=0.4)
        driver.connect()
        driver.activate()
        assert driver.health().ok


def test_power_is_not_switched_on_unasked(refusing):
    refusing.fault("robot", "power_off")
    driver = fresh(power_on=False)
    with contextlib.closing(driver):
        driver.connect()
        assert driver.read().mode == "off" and driver.health().state == "stopped"
        with pytest.raises(StoppedError, match="power it on"):
            driver.activate()
    driver = fresh(power_on=True)
    with contextlib.closing(driver):
        driver.connect()
        driver.activate()
        assert driver.read().mode == "running"
        assert np.isfinite(driver.position()).all()
