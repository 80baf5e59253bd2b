"""What a driver is: it moves a robot and reads its sensor; a simulated robot is one like any other.

The base owns the public methods and checks limits before anything moves; a device fills in the
methods with an underscore. Commands return what was really done.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import TracebackType
from typing import ClassVar

import numpy as np

from wrenchbed.errors import DriverError, PlanError
from wrenchbed.metadata import Metadata
from wrenchbed.robots.base import Robot

Block = Mapping[str, np.ndarray]
"""Columns of a recording by name, each (n,)."""

SPEED_SHARE = 0.5
"""Share of a joint's top speed that moves between poses use."""
PATH_POINTS = 33
"""Points at which a straight move is checked."""
_PEAK = 1.875
"""Peak over mean speed of a minimum-jerk move: Flash & Hogan 1985."""


@dataclass(frozen=True)
class Reached:
    """What a move really did: joint values (J,) and duration [s]."""

    q: np.ndarray
    duration: float


class Driver(ABC):
    """A robot with its sensor, simulated or real.

    Use as a context manager. Times are seconds since `connect`, monotonic across all calls.
    """

    name: str
    title: str
    robot: Robot
    options: ClassVar[type]
    """A dataclass of what the constructor takes."""

    def __init__(self) -> None:
        self._connected = False

    def connect(self) -> None:
        """Open the device.

        Raises:
            DriverError: it cannot be reached.
        """
        if not self._connected:
            self._connect()
            self._connected = True

    def close(self) -> None:
        """Leave the device at rest and let go of it; may be called twice."""
        if self._connected:
            self._connected = False
            self._close()

    def position(self) -> np.ndarray:
        """Joint values (J,) now [rad or m]."""
        self._check_connected()
        return self._position()

    def move(self, q: np.ndarray) -> Reached:
        """Move in a straight joint-space line and come to rest.

        Raises:
            PlanError: the target or the way to it leaves the limits or the solvable region.
            DriverError: the robot did not arrive.
        """
        self._check_connected()
        start = self._position()
        self.robot.check(straight(start, q), self.robot.parameters.nominal, "move")
        return self._move(start, np.asarray(q, dtype=float), duration(self.robot, start, q))

    def touch(self, q: np.ndarray, point: np.ndarray) -> Reached:
        """Move to a pose near a known point of the world (3,) [m] and seat the tool's tip there.

        Raises:
            PlanError: the pose or the way to it leaves the limits or the solvable region.
            DriverError: this device cannot touch, or the tip did not reach the point.
        """
        self.move(q)
        return self._touch(np.asarray(point, dtype=float))

    def sample(self, n: int, rate: float) -> Block:
        """n rows at rest: ``t``, ``q1``…, ``fx``…``tz``, ``status``."""
        self._check_connected()
        return self._sample(n, rate)

    def track(self, targets: np.ndarray, rate: float) -> Iterator[Block]:
        """Follow joint values (N, J), one a sample, and yield what was measured on the way.

        Raises:
            PlanError: the trajectory leaves limits, the solvable region or the joints' speed.
        """
        self._check_connected()
        check_motion(self.robot, targets, rate, "trajectory")
        yield from self._track(targets, rate)

    def expect(self, plan: np.ndarray, mode: str) -> None:
        """A plan (N, J) is about to run; most devices need not know."""
        return None

    @abstractmethod
    def metadata(self, mode: str, rate: float) -> Metadata:
        """What a recording made with this driver states."""

    @abstractmethod
    def _connect(self) -> None: ...

    @abstractmethod
    def _close(self) -> None: ...

    @abstractmethod
    def _position(self) -> np.ndarray: ...

    @abstractmethod
    def _move(self, start: np.ndarray, target: np.ndarray, seconds: float) -> Reached: ...

    @abstractmethod
    def _sample(self, n: int, rate: float) -> Block: ...

    @abstractmethod
    def _track(self, targets: np.ndarray, rate: float) -> Iterator[Block]: ...

    def _touch(self, point: np.ndarray) -> Reached:
        raise DriverError(f"driver {self.name!r} cannot touch points: run this plan with 'sim'")

    def _check_connected(self) -> None:
        if not self._connected:
            raise DriverError(f"driver {self.name!r} is not connected: call connect() first")

    def __enter__(self) -> "Driver":
        self.connect()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def straight(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Points on a straight joint-space line (`PATH_POINTS`, J)."""
    share = np.linspace(0.0, 1.0, PATH_POINTS)[:, None]
    return np.asarray(start + share * (np.asarray(end) - start))


def duration(robot: Robot, start: np.ndarray, end: np.ndarray) -> float:
    """Time of a minimum-jerk move whose fastest joint uses its share of top speed [s]."""
    speed = np.array([j.speed for j in robot.joints]) * SPEED_SHARE
    return max(0.2, float(np.max(_PEAK * np.abs(np.asarray(end) - start) / speed)))


def minimum_jerk(share: np.ndarray) -> np.ndarray:
    """Position 0 … 1 along a move at a share of its time (Flash & Hogan 1985)."""
    return share**3 * (10.0 + share * (-15.0 + 6.0 * share))


def check_motion(robot: Robot, targets: np.ndarray, rate: float, where: str) -> None:
    """Refuse a trajectory (N, J) that leaves limits, the solvable region or the joints' speed.

    Raises:
        PlanError: names the row.
    """
    robot.check(targets, robot.parameters.nominal, where)
    speed = np.abs(np.diff(targets, axis=0)) * rate
    top = np.array([j.speed for j in robot.joints])
    if (speed > top).any():
        row, joint = (int(k[0]) for k in np.nonzero(speed > top))
        unit = robot.joints[joint].unit
        raise PlanError(
            f"{where}: row {row + 1}: {robot.joints[joint].name} would move at "
            f"{speed[row, joint]:.3g} {unit}/s, its limit is {top[joint]:.3g} {unit}/s"
        )
