"""Data types of drivers: states, applied targets, moves, rows, and a recording's metadata."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from wrenchbed.data.metadata import Metadata, SensorInfo, ToolInfo
from wrenchbed.errors import DriverError
from wrenchbed.robots.base import INERTIA_AXES, Robot

Block = Mapping[str, np.ndarray]
"""Columns of a recording by name, each (n,)."""
Onlooker = Callable[[float, np.ndarray, np.ndarray], None]
"""Called with each reading of a driver, in the thread that reads, and must not block: the time
since `connect` [s], joint values (J,) and wrench (6,) [N, N·m]."""


@dataclass(frozen=True, eq=False)
class ArmSample:
    """State of a robot.

    Attributes:
        t: `time.monotonic` of this machine when it arrived [s]; a simulated robot's own time.
        device_time: on the robot's own clock [s], None where it has none.
        sequence: of the states received.
        age: time between arrival and the call that returned this [s].
        fresh: newer than what the call before returned.
        q: joint values (J,) [rad or m].
        qd: their speeds (J,).
        target_q: where the robot's own controller wants its joints (J,).
        mode: ``off``, ``idle``, ``running``, ``fault`` or what the device calls it.
        safety: ``normal``, ``protective stop``, ``emergency stop`` …
        program: ``playing``, ``paused``, ``stopped``; empty where the robot runs none.
        evidence: what recordings keep beside the joints, (J,) by the name of its columns without
            their number, as ``i`` of motor currents i1… [A].
    """

    t: float
    device_time: float | None
    sequence: int
    age: float
    fresh: bool
    q: np.ndarray
    qd: np.ndarray
    target_q: np.ndarray | None = None
    mode: str = "running"
    safety: str = "normal"
    program: str = ""
    evidence: Mapping[str, np.ndarray] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Applied:
    """The result of a target: joint values (J,) as sent, or None and why they were refused."""

    sent: np.ndarray | None
    reason: str = ""

    @property
    def ok(self) -> bool:
        """Whether anything was sent."""
        return self.sent is not None


def block_of(rows: Sequence[Mapping[str, float]]) -> Block:
    """Rows as columns."""
    dtypes = {"status": np.uint32, "saturated": np.uint32, "lost": np.int64}
    return {k: np.array([r[k] for r in rows], dtype=dtypes.get(k, float)) for k in rows[0]}


@dataclass(frozen=True)
class Reached:
    """The result of a move: joint values (J,) and duration [s]."""

    q: np.ndarray
    duration: float


class Move(ABC):
    """A move of a robot towards ``goal`` (J,): polled, awaited with a deadline, or cancelled."""

    def __init__(self, goal: np.ndarray) -> None:
        self.goal = goal
        self._end: Reached | DriverError | None = None

    def poll(self) -> Reached | None:
        """Where it ended, None while it moves; never blocks.

        Raises:
            DriverError: it failed or was cancelled; the robot was stopped.
        """
        if self._end is None:
            try:
                self._end = self._advance()
            except DriverError as error:
                self._failed(error)
                self._end = error
        if isinstance(self._end, DriverError):
            raise self._end
        return self._end

    @abstractmethod
    def wait(self, timeout: float | None = None) -> Reached:
        """Block until it ends; the move's own deadline if no timeout [s] is given.

        Raises:
            LateError: it did not arrive in time; the robot was stopped.
            DriverError: it failed or was cancelled.
        """

    def cancel(self) -> None:
        """Stop here and come to rest; harmless when it has ended."""
        if self._end is None:
            self._end = DriverError("the move was cancelled")
            self._halt()

    @abstractmethod
    def _advance(self) -> Reached | None:
        """Where it ended, None while it moves; raises DriverError where it failed."""

    def _failed(self, error: DriverError) -> None:
        """Stop a robot that may still move after an error; nothing by default."""
        return None

    def _halt(self) -> None:
        """Bring the robot to rest after `cancel`; nothing by default."""
        return None


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
    """Metadata of the nominal robot; ``noise_std`` (6,) is of one row at rest [N, N·m]."""
    nominal = robot.parameters.nominal
    tool, values = robot.tool(nominal), robot.values(nominal)
    on_flange = "mount.position.x" in robot.parameters.names
    return Metadata(
        robot=robot.name,
        mode=mode,
        source=source,
        rate_hz=rate,
        tool=ToolInfo(
            mass=float(tool.mass),
            cog=tuple(float(c) for c in tool.cog),
            inertia=tuple(float(values[f"tool.inertia.{a}"]) for a in INERTIA_AXES),
        ),
        sensor=SensorInfo(
            model=sensor,
            noise_std=tuple(float(s) for s in noise_std),
            mass=float(values["sensor.mass"]),
            pose_flange=(0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0) if on_flange else None,
        ),
        gravity=tuple(gravity),
    )
