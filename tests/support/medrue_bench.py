"""What tests of MedRUE's emulator and driver share."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from wrenchbed.hardware.drivers.can import CanDriver, CanOptions

HOST, SLOT = "127.0.4.3", 2
"""Address of the emulator that all tests share, and the calibration of its board: another one than
a restarted board selects."""
WORDS = ("--set", f"slot={SLOT}", "--noise", "off")
"""Further words of the command line that starts it."""


def options(host: str = HOST, **more: Any) -> CanOptions:
    """A patient watchdog: other processes may keep this machine busy for a tenth of a second."""
    slot = SLOT if host == HOST else 0
    return CanOptions(**({"host": host, "watchdog": 0.3, "slot": slot} | more))


def readied(one: CanDriver) -> CanDriver:
    one.connect()
    if not one.health().ok:
        one.recover(unlock=True)
    one.activate()
    assert until(lambda: one.health().ok), one.health()
    return one


def until(done: Callable[[], Any], seconds: float = 2.0) -> Any:
    """Wait until something is so; what it was last."""
    end = time.monotonic() + seconds
    while not done() and time.monotonic() < end:
        time.sleep(0.002)
    return done()


def away(driver: CanDriver) -> np.ndarray:
    """A goal that joint 1 takes half a second or more to reach."""
    q = driver.position()
    q[0] += 0.05 if q[0] < 0.05 else -0.05
    return q
