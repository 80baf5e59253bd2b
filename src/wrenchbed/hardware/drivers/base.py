"""The contract of a driver: lifecycle, reading, moving, recording; its data types. Public methods
check state and limits; a driver implements the methods with an underscore, and
tests/hardware/test_driver_contract.py runs on it."""

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Self

import numpy as np

from wrenchbed import registry
from wrenchbed.data.metadata import Metadata, SensorInfo
from wrenchbed.errors import DriverError
from wrenchbed.hardware.device_base import Device
from wrenchbed.hardware.transducers.base import WrenchSample
from wrenchbed.robots.base import Robot
from wrenchbed.robots.checked_moves import Limits, duration, entered, straight

Block = Mapping[str, np.ndarray]
"""Columns of a recording by name, each an array (n,) with one value a row."""


@dataclass(frozen=True, eq=False)
class ArmSample:
    """Newest state of a robot's arm.

    Attributes:
        t: arrival on this machine's `time.monotonic` [s]; a simulated robot's own time.
        device_time: time on the robot's own clock [s], None where it has none.
        age: time between arrival and the call that returned this [s].
        q, qd, target_q: joint values (J,) [rad or m], joint speeds (J,), and the controller's
            targets (J,) of the joint values.
        mode: ``off``, ``idle``, ``running``, ``fault`` or the device's own word.
        safety: ``normal``, ``protective stop``, ``emergency stop`` …
        program: ``playing``, ``paused``, ``stopped``; empty where the robot runs none.
        extra_columns: further columns (J,) by the name that docs/contracts.md gives them, without
            the joint's number: ``i`` stands for the columns i1… [A].
    """

    t: float
    device_time: float | None
    age: float
    q: np.ndarray
    qd: np.ndarray
    target_q: np.ndarray | None = None
    mode: str = "running"
    safety: str = "normal"
    program: str = ""
    extra_columns: Mapping[str, np.ndarray] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Applied:
    """Result of streaming a target: ``sent`` are the joint values (J,) sent to the robot, or None
    if the target was refused; ``reason`` says why."""

    sent: np.ndarray | None
    reason: str = ""

    @property
    def ok(self) -> bool:
        """Whether the target was sent to the robot."""
        return self.sent is not None


def block_of(rows: Sequence[Mapping[str, float]]) -> Block:
    """Convert rows, each a mapping column name → value, to a block: column name → array (N,)."""
    dtypes = {"status": np.uint32, "saturated": np.uint32, "lost": np.int64}
    return {k: np.array([r[k] for r in rows], dtype=dtypes.get(k, float)) for k in rows[0]}


@dataclass(frozen=True)
class Reached:
    """Result of a finished move: joint values (J,) [rad or m] and duration [s]."""

    q: np.ndarray
    duration: float


class Move(ABC):
    """A running move of a robot to ``goal`` (J,) [rad or m]: poll it, wait for it, or cancel it."""

    def __init__(self, goal: np.ndarray) -> None:
        self.goal = goal
        self._end: Reached | DriverError | None = None

    def poll(self) -> Reached | None:
        """Return the move's result, or None while it is still running; never blocks. A
        `DriverError` if the move failed or was cancelled; the robot was stopped."""
        if self._end is None:
            try:
                self._end = self._advance()
            except DriverError as error:
                self._failed(error)
                self._end = error
        if isinstance(self._end, DriverError):
            raise self._end
        return self._end

    def wait(self, timeout: float | None = None) -> Reached:
        """Wait until the move ends and return its result.

        Args:
            timeout: longest wait [s]; None: the deadline that the move itself has.

        Raises:
            LateError: the robot did not arrive in time; it was stopped.
            DriverError: the move failed or was cancelled.
        """
        try:
            while (end := self.poll()) is None:
                self._pause(timeout)
        except BaseException as error:
            if self._end is None:
                interrupted = DriverError("the move was interrupted")
                self._end = error if isinstance(error, DriverError) else interrupted
                self._failed(error)
            raise
        return end

    def cancel(self) -> None:
        """Stop the move and bring the robot to rest; does nothing if it has ended."""
        if self._end is None:
            self._end = DriverError("the move was cancelled")
            self._halt()

    @abstractmethod
    def _advance(self) -> Reached | None:
        """Return the move's result, None while it is running; raise `DriverError` if it failed."""

    def _pause(self, timeout: float | None) -> None:
        """Sleep between two polls; raise `LateError` once the wait has lasted ``timeout`` [s]."""
        return None

    def _failed(self, error: BaseException) -> None:
        """Stop the robot if it may still move after an error; by default do nothing."""
        return None

    def _halt(self) -> None:
        """Bring the robot to rest after `cancel`; by default do nothing."""
        return None


class Driver(Device, ABC):
    """Base class of drivers: a robot with its force/torque sensor, simulated or real.

    ``connect`` opens the link and moves nothing, ``activate`` makes the robot ready to move,
    ``deactivate`` ends that, ``close`` releases the link. As a context manager it is connected and
    active inside. Times in recordings are seconds since `connect`, monotonic across all calls.
    """

    robot: Robot
    """The robot: joints, units, limits; known before anything is connected."""
    live: ClassVar[bool] = False
    """Whether the driver runs in real time and something real may move."""
    top_rate: float = math.inf
    """Highest rate at which rows are distinct [Hz]."""

    def __init__(self, limits: Limits | None = None) -> None:
        super().__init__()
        self.limits = limits or Limits()
        self._active = False

    def activate(self) -> None:
        """Make the robot ready to move, with its watchdog on; it does not move yet. A `DriverError`
        says what to do if the robot is stopped, in fault or not powered."""
        self._check_connected()
        if not self._active:
            self._activate()
            self._active = True

    def deactivate(self) -> None:
        """Bring the robot to rest; commands are refused until the next `activate`."""
        if self._active:
            self._active = False
            self._deactivate()

    def close(self) -> None:
        """Bring the robot to rest and release it; may be called twice."""
        try:
            self.deactivate()
        finally:
            super().close()

    def read(self) -> ArmSample:
        """Return the robot's newest state without blocking."""
        self._check_connected()
        return self._read()

    def read_wrench(self) -> WrenchSample:
        """Return the force/torque sensor's newest reading without blocking."""
        self._check_connected()
        return self._read_wrench()

    def write(self, q: np.ndarray) -> Applied:
        """Send a streamed joint target (J,) [rad or m]; return what was sent, or why not."""
        self._check_connected()
        if not self._active:
            return Applied(None, f"driver {self.name!r} is not active: call activate() first")
        return self._write(np.asarray(q, dtype=float))

    def move(self, q: np.ndarray) -> Move:
        """Start a straight joint-space move that comes to rest at joint values q (J,). Raises a
        `PlanError` if the target or the path to it leaves limits, workspace or the region where the
        robot's equations can be solved, a `DriverError` if the robot is not ready."""
        self._check_active()
        start, goal = self._position(), np.asarray(q, dtype=float)
        self.limits.check_path(self.robot, entered(self.robot, straight(start, goal)), "move")
        return self._move(start, goal, duration(self.robot, start, goal, self.limits.speed))

    def stop(self, kind: str = "soft") -> None:
        """Bring the robot to rest: ``soft`` by braking, ``hard`` by the device's fastest stop."""
        self._check_connected()
        self._stop(kind)

    def recover(self, unlock: bool = False) -> None:
        """Clear what can be cleared after a stop or a fault, then `activate`; nothing moves.
        ``unlock`` also clears protective stops and drives' faults: a person must have looked first.
        Raises a `SafetyStopError` if the robot stopped to protect itself and ``unlock`` is False, a
        `DriverError`, which says who must do what, if it cannot be cleared from here."""
        self._check_connected()
        self._active = False
        self._recover(unlock)
        self.activate()

    def position(self) -> np.ndarray:
        """Return the present joint values (J,) [rad or m]."""
        self._check_connected()
        return self._position()

    def touch(self, q: np.ndarray, point: np.ndarray) -> Reached:
        """Move to the pose q (J,) near a known point of the world (3,) [m] and bring the tool's tip
        into contact with it. Raises a `PlanError` if the pose or the path to it leaves the limits
        or cannot be solved, a `DriverError` if this device cannot touch, or the tip misses the
        point."""
        self.move(q).wait()
        return self._touch(np.asarray(point, dtype=float))

    def settle(self) -> float:
        """Wait until joints are at rest and the wrench is steady; return the time taken [s]. Raises
        a `LateError` if they are not by then."""
        self._check_connected()
        return self._settle()

    def sample(self, n: int, rate: float) -> Block:
        """Record n rows at rest at ``rate`` [Hz]: columns ``t``, ``q1``…, ``fx``…, ``status``."""
        self._check_connected()
        return self._sample(n, rate)

    def track(self, targets: np.ndarray, rate: float) -> Iterator[Block]:
        """Follow joint targets (N, J), given at ``rate`` [Hz], and yield the measured rows. Raises
        a `PlanError` if they leave limits, joint speeds or the region that can be solved."""
        self._check_active()
        self.limits.check_motion(self.robot, targets, rate, "trajectory")
        yield from self._track(targets, rate)

    def full_scale(self) -> np.ndarray:
        """Measuring range (6,) [N, N·m] of the sensor; of several calibrations the smallest."""
        known = registry.load("sensors", self.robot.sensor)
        return np.asarray(known.calibration().range)

    def expect(self, plan: np.ndarray, mode: str) -> None:
        """Announce the plan's joint values (N, J) to the device before a run in a mode, ``static``
        (poses at rest) or ``dynamic`` (motion); most devices ignore it."""

    @abstractmethod
    def metadata(self, mode: str, rate: float) -> Metadata:
        """Metadata of a recording at ``rate`` [Hz] in a mode, ``static`` (poses at rest) or
        ``dynamic`` (motion)."""

    def _activate(self) -> None:
        """Hook of `activate`: switch the robot on; by default do nothing."""

    def _deactivate(self) -> None:
        """Hook of `deactivate`: switch the robot off; by default do nothing."""

    @abstractmethod
    def _read(self) -> ArmSample: ...

    @abstractmethod
    def _read_wrench(self) -> WrenchSample: ...

    @abstractmethod
    def _write(self, q: np.ndarray) -> Applied: ...

    def _position(self) -> np.ndarray:
        return np.array(self._read().q)

    @abstractmethod
    def _move(self, start: np.ndarray, goal: np.ndarray, seconds: float) -> Move: ...

    @abstractmethod
    def _stop(self, kind: str) -> None: ...

    def _recover(self, unlock: bool) -> None:
        """Hook of `recover`: clear stops and faults of the device; by default do nothing."""

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


def as_designed(
    robot: Robot,
    *,
    source: str,
    mode: str,
    rate: float,
    gravity: Sequence[float],
    sensor: str,
    noise_std: np.ndarray,
) -> Metadata:
    """Make the metadata of a recording from the nominal values of its robot.

    Args:
        robot: robot that the recording is of.
        source: where the recording is from, such as ``sim`` or ``ur_rtde``.
        mode: ``static`` (poses at rest) or ``dynamic`` (motion).
        rate: rate of the rows [Hz].
        gravity: (3,) [m/s²], in base axes.
        sensor: registry name of the sensor.
        noise_std: (6,) standard deviation of one row at rest [N, N·m].
    """
    on_flange = "mount.position.x" in robot.parameters.names
    pose = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0) if on_flange else None
    stated = SensorInfo(sensor, tuple(noise_std.tolist()), pose_flange=pose)
    tool = robot.tool(robot.parameters.nominal)
    return Metadata.of(robot.name, mode, source, rate, tool, stated, gravity)
