"""The contract of a driver: lifecycle, reading, moving, recording.

The public methods check state and limits; a driver fills in the methods with an underscore.
"""

import math
from abc import abstractmethod
from collections.abc import Iterator
from typing import ClassVar, Self

import numpy as np

from wrenchbed import registry
from wrenchbed.data.metadata import Metadata
from wrenchbed.errors import DriverError
from wrenchbed.hardware.device import Device
from wrenchbed.hardware.drivers.base.samples import Applied, ArmSample, Block, Move, Reached
from wrenchbed.hardware.transducers.base import WrenchSample
from wrenchbed.robots.base import Robot
from wrenchbed.robots.motion_limits import Limits, check_motion, duration, straight


class Driver(Device):
    """A robot with its sensor, simulated or real.

    ``connect`` opens the link and moves nothing, ``activate`` makes it ready to move,
    ``deactivate`` ends that, ``close`` releases the link. As a context manager it is connected and
    active inside. Times in recordings are seconds since `connect`, monotonic across all calls.
    """

    robot: Robot
    """Known before anything is connected: joints, units, limits."""
    live: ClassVar[bool] = False
    """Whether time is this machine's and something real may move."""
    top_rate: float = math.inf
    """Highest rate of distinct rows [Hz]."""

    def __init__(self, limits: Limits | None = None) -> None:
        super().__init__()
        self.limits = limits or Limits()
        self._active = False

    def activate(self) -> None:
        """Make the robot ready to move, with its watchdog on; it does not move yet.

        Raises:
            DriverError: it is stopped, in fault or not powered; the message says what to do.
        """
        self._check_connected()
        if not self._active:
            self._activate()
            self._active = True

    def deactivate(self) -> None:
        """Bring the robot to rest; commands are refused until `activate`."""
        if self._active:
            self._active = False
            self._deactivate()

    def close(self) -> None:
        """Leave the device at rest and release it; may be called twice."""
        try:
            self.deactivate()
        finally:
            super().close()

    def read(self) -> ArmSample:
        """The robot's newest state; never blocks."""
        self._check_connected()
        return self._read()

    def joints(self) -> tuple[np.ndarray, np.ndarray]:
        """Values (J,) and speeds (J,) of the newest state; a driver may have them sooner than
        all of it."""
        arm = self.read()
        return arm.q, arm.qd

    def read_wrench(self) -> WrenchSample:
        """The sensor's newest reading; never blocks."""
        self._check_connected()
        return self._read_wrench()

    def write(self, q: np.ndarray) -> Applied:
        """Stream one target (J,); the result is what was sent, or why it was refused."""
        self._check_connected()
        if not self._active:
            return Applied(None, f"driver {self.name!r} is not active: call activate() first")
        return self._write(np.asarray(q, dtype=float))

    def move(self, q: np.ndarray) -> Move:
        """Start a straight joint-space move that comes to rest at q (J,).

        Raises:
            PlanError: the target or the path to it leaves limits, workspace or solvable region.
            DriverError: the robot is not ready.
        """
        self._check_active()
        start, goal = self._position(), np.asarray(q, dtype=float)
        self.limits.check_path(self.robot, straight(start, goal), "move")
        return self._move(start, goal, duration(self.robot, start, goal, self.limits.speed))

    def stop(self, kind: str = "soft") -> None:
        """Come to rest: ``soft`` by braking, ``hard`` by the device's fastest stop."""
        self._check_connected()
        self._stop(kind)

    def recover(self, unlock: bool = False) -> None:
        """Clear what can be cleared after a stop or a fault; nothing moves.

        Args:
            unlock: also clear a stop by which the robot protected itself, or a drive's fault:
                somebody has looked at the robot.

        Raises:
            SafetyStopError: it protected itself, and ``unlock`` is False.
            DriverError: it cannot be cleared from here; the message says who must do what.
        """
        self._check_connected()
        self._active = False
        self._recover(unlock)
        self.activate()

    def position(self) -> np.ndarray:
        """Joint values (J,) now [rad or m]."""
        self._check_connected()
        return self._position()

    def touch(self, q: np.ndarray, point: np.ndarray) -> Reached:
        """Move to a pose near a known point of the world (3,) [m] and seat the tool's tip there.

        Raises:
            PlanError: the pose or the path to it leaves the limits or the solvable region.
            DriverError: this device cannot touch, or the tip did not reach the point.
        """
        self.move(q).wait()
        return self._touch(np.asarray(point, dtype=float))

    def settle(self) -> float:
        """Wait until joints and wrench are steady; the time that it took [s].

        Raises:
            LateError: they are not steady by the deadline.
        """
        self._check_connected()
        return self._settle()

    def sample(self, n: int, rate: float) -> Block:
        """n rows at rest: ``t``, ``q1``…, ``fx``…``tz``, ``status``."""
        self._check_connected()
        return self._sample(n, rate)

    def track(self, targets: np.ndarray, rate: float) -> Iterator[Block]:
        """Follow joint values (N, J), one a sample, and yield the measured rows.

        Raises:
            PlanError: the trajectory leaves limits, the solvable region or the joints' speed.
        """
        self._check_active()
        check_motion(self.robot, targets, rate, "trajectory")
        self.limits.check_speed(self.robot, targets, rate, "trajectory")
        self.limits.check_path(self.robot, targets, "trajectory")
        yield from self._track(targets, rate)

    def full_scale(self) -> np.ndarray:
        """Where the sensor's range ends (6,) [N, N·m]; the smaller where more is known than one."""
        known = registry.load("sensors", self.robot.sensor)
        return np.asarray(known.calibration().range)

    def expect(self, plan: np.ndarray, mode: str) -> None:
        """A plan (N, J) is about to run; most devices ignore it."""
        return None

    @abstractmethod
    def metadata(self, mode: str, rate: float) -> Metadata:
        """Metadata of a recording made with this driver."""

    def _activate(self) -> None:
        """Nothing to switch on."""
        return None

    def _deactivate(self) -> None:
        """Nothing to switch off."""
        return None

    @abstractmethod
    def _read(self) -> ArmSample: ...

    @abstractmethod
    def _read_wrench(self) -> WrenchSample: ...

    @abstractmethod
    def _write(self, q: np.ndarray) -> Applied: ...

    @abstractmethod
    def _position(self) -> np.ndarray: ...

    @abstractmethod
    def _move(self, start: np.ndarray, goal: np.ndarray, seconds: float) -> Move: ...

    @abstractmethod
    def _stop(self, kind: str) -> None: ...

    def _recover(self, unlock: bool) -> None:
        """Nothing to clear."""
        return None

    def _settle(self) -> float:
        return 0.0

    @abstractmethod
    def _sample(self, n: int, rate: float) -> Block: ...

    @abstractmethod
    def _track(self, targets: np.ndarray, rate: float) -> Iterator[Block]: ...

    def _touch(self, point: np.ndarray) -> Reached:
        raise DriverError(f"driver {self.name!r} cannot touch points: run this plan with 'sim'")

    def _check_active(self) -> None:
        self._check_connected()
        if not self._active:
            raise DriverError(f"driver {self.name!r} is not active: call activate() first")

    def __enter__(self) -> Self:
        self.connect()
        try:
            self.activate()
        except BaseException:
            self.close()
            raise
        return self
