"""A move of a live robot, monitored to its end: link, robot, wrench and deadline."""

import time
from collections.abc import Callable
from typing import Protocol

import numpy as np

from wrenchbed.errors import DriverError, LateError, LimitError, LinkError, StoppedError
from wrenchbed.hardware.device import Health
from wrenchbed.hardware.drivers.base.samples import ArmSample, Move, Reached

CALM_SPEED = 2e-3
"""Fastest joint at rest [rad/s or m/s]: with less the noise of speeds is a motion, with more rows
at rest are taken in one."""
TOLERANCE = 5e-4
"""Farthest from its goal that a joint may come to rest [rad or m]: with less an arm that stands a
little beside its goal never arrives, with more poses differ from the plan."""
BLIND_S = 0.3
"""Longest that a robot may move while its state or its sensor is stale [s]: a short stall
passes."""
STUCK_S = 3.0
"""A move beyond its time is given up when it comes no nearer for so long [s]. A speed
slider or a safety limit of the robot may make it slow."""
_NEARER = 2.0 * TOLERANCE
_POLL_S = 0.005
"""Time between two looks while waiting [s], less than a cycle of 125 Hz."""


class Watched(Protocol):
    """The methods of a driver that a move uses."""

    def read(self) -> ArmSample:
        """The robot's newest state."""

    def health(self) -> Health:
        """Its state, and what is wrong."""

    def guard(self) -> None:
        """Stop and raise when the sensor reads more than the limits allow."""

    def stop(self, kind: str = "soft") -> None:
        """Come to rest."""


class WatchedMove(Move):
    """A move during which link, robot, wrench and deadline are monitored."""

    def __init__(self, driver: Watched, goal: np.ndarray, seconds: float) -> None:
        super().__init__(goal)
        self._driver, self._begun = driver, time.monotonic()
        self._patience, self._deadline = self._begun + 2.0 * seconds + STUCK_S, np.inf
        self._seen = self._begun
        self._nearest, self._nearer = np.inf, self._begun

    def _advance(self) -> Reached | None:
        driver, now = self._driver, time.monotonic()
        health = driver.health()
        if health.ok:
            self._seen = now
        elif health.state != "stale" or now - self._seen > BLIND_S:
            check_ready(health)
        driver.guard()
        arm = driver.read()
        miss = float(np.abs(arm.q - self.goal).max())
        if health.ok and miss < TOLERANCE and np.abs(arm.qd).max() < CALM_SPEED:
            return Reached(arm.q, now - self._begun)
        if miss < self._nearest - _NEARER:
            self._nearest, self._nearer = miss, now
        if now > self._deadline or now > max(self._patience, self._nearer + STUCK_S):
            raise LateError(
                f"the move did not arrive by its deadline, {miss:.2g} off its goal: does a speed "
                "slider, a safety limit or something in its way hold it?"
            )
        return None

    def wait(self, timeout: float | None = None) -> Reached:
        if timeout is not None:
            self._deadline = min(self._deadline, time.monotonic() + timeout)
        try:
            while (end := self.poll()) is None:
                time.sleep(_POLL_S)
        except BaseException as error:
            if self._end is None:
                self._end = DriverError("the move was interrupted")
                stop_after(error, self._driver.stop)
            raise
        return end

    def _failed(self, error: DriverError) -> None:
        stop_after(error, self._driver.stop)

    def _halt(self) -> None:
        self._driver.stop("soft")


def stop_after(error: BaseException, stop: Callable[[str], None]) -> None:
    """Stop: hard after a limit was exceeded, else soft; a stop that fails is noted in the error."""
    try:
        stop("hard" if isinstance(error, LimitError) else "soft")
    except DriverError as failed:
        error.add_note(f"the stop failed, too: {failed}")


def check_ready(health: Health) -> None:
    """Raise the error that a bad state stands for.

    Raises:
        StoppedError: the robot stopped or is in fault.
        LinkError: it is silent or gone.
    """
    if health.state in ("stopped", "fault"):
        raise StoppedError(health.detail)
    if not health.ok:
        raise LinkError(health.detail or health.state)
