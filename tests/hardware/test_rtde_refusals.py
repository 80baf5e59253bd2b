"""Controllers of UR robots that refuse, are deaf, late or off when the driver comes."""

import contextlib
import time

import pytest

import robot_emulators
import rtde_moves
from wrenchbed.errors import DriverError, LinkError, StoppedError
from wrenchbed.hardware.device_base import wait_until

pytest.importorskip("rtde_control")
pytestmark = pytest.mark.wire


def fresh(**more):
    return contextlib.closing(rtde_moves.driver(**{"connect_s": 4.0, "power_on": True} | more))


@pytest.mark.sampled
@pytest.mark.parametrize(
    "where, kind, values, error, words",
    [
        ("rtde", "not_found", {"field": "actual_qd", "seconds": 0.5}, DriverError, "actual_qd"),
        ("rtde", "refuse_start", {"seconds": 3.3}, LinkError, "no states|did not connect"),
        ("rtde", "deaf", {"seconds": 3.0}, LinkError, "does not answer|timed out|not connect"),
        ("rtde", "in_use", {"seconds": 2.2}, DriverError, "another client"),
        ("robot", "script_never_starts", {"seconds": 5.6}, DriverError, "program|did not connect"),
    ],
)
def test_a_controller_that_refuses_is_named_in_time(ur5, where, kind, values, error, words):
    """Those that refuse control do so when the driver activates, the others when it connects."""
    patience = 7.0 if kind == "script_never_starts" else 2.2
    with fresh(connect_s=patience) as driver:
        if kind in ("in_use", "script_never_starts"):
            driver.connect()
        ur5.fault(where, kind, **values)
        begun = time.monotonic()
        with pytest.raises(error, match=words):
            driver.connect()
            driver.activate()
        assert time.monotonic() - begun < patience + 1.5
    time.sleep(max(0.0, begun + values["seconds"] - time.monotonic()) + 0.1)


@pytest.mark.sampled
@pytest.mark.parametrize("where", ["script", "rtde", "dashboard"])
def test_a_controller_that_is_late_is_waited_for(ur5, where):
    with fresh() as driver:
        if where != "rtde":
            driver.connect()
        ur5.fault(where, "unlisten", seconds=0.4)
        driver.connect()
        driver.activate()
        assert wait_until(lambda: driver.health().ok, 2.0), driver.health()


def test_a_controller_of_another_arm_is_refused():
    ur10, refused = robot_emulators.ur5(model="ur10", box="off"), pytest.raises(DriverError)
    with ur10 as host, fresh(host=str(host)) as driver, refused as seen:
        driver.connect()
    assert "moves a UR10, and the robot is 'ur5'" in str(seen.value)


def test_power_is_not_switched_on_unasked(ur5):
    ur5.fault("robot", "power_off")
    with fresh(power_on=False) as driver:
        driver.connect()
        assert driver.read().mode == "off" and driver.health().state == "stopped"
        with pytest.raises(StoppedError, match="power it on"):
            driver.activate()
    with fresh() as driver:
        driver.connect()
        driver.activate()
        assert driver.read().mode == "running"
