"""A recording in the place of a robot: it returns measured rows and refuses other poses.

A move goes to the recording's hold at those joint values; samples are its rows in order. Times are
those of the recording, shifted where a plan visits holds in another order.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from wrenchbed import registry
from wrenchbed.data.metadata import Metadata
from wrenchbed.data.recording import Recording
from wrenchbed.errors import DriverError, RecordingError
from wrenchbed.hardware.drivers.base import Applied, ArmSample, Block, Driver, Move, Reached
from wrenchbed.hardware.transducers.base import WrenchSample
from wrenchbed.robots.motion_limits import Limits

NEAR = 1e-3
"""Farthest from a row's joint values that a pose may be [rad or m]: robots rest within 5e-4."""


@dataclass(frozen=True)
class ReplayOptions:
    """Registry name of the robot, Parquet file of a recording of its joints, limits of plans."""

    robot: str
    recording: str = ""
    limits: Limits | None = None


class ReplayDriver(Driver):
    """A recording that a plan can be run on again.

    Raises:
        RecordingError: it cannot be read, is of another robot, or holds no joints.
    """

    name = "replay"
    title = "a recording in the place of a robot; nothing moves"
    options = ReplayOptions

    def __init__(self, options: ReplayOptions) -> None:
        super().__init__(options.limits)
        self.robot = registry.load("robots", options.robot)
        if not options.recording:
            raise RecordingError("driver 'replay' needs a recording: give --recording FILE")
        self._recording = Recording.read(options.recording)
        if self._recording.metadata.robot != self.robot.name or not self._recording.joints:
            raise RecordingError(
                f"{options.recording}: is no recording of the joints of {self.robot.name!r}"
            )
        self._row = 0
        self._used = np.zeros(len(self._recording), dtype=bool)
        self._time = float(self._recording.t[0])

    def metadata(self, mode: str, rate: float) -> Metadata:
        return self._recording.metadata

    def _read(self) -> ArmSample:
        row, columns = self._row, self._recording.columns
        q, t = self._recording.q[row].astype(float), float(self._recording.t[row])
        still = np.zeros(len(self._recording))
        qd = np.array([columns.get(f"qd{j + 1}", still)[row] for j in range(len(q))], dtype=float)
        return ArmSample(self._time, t, 0.0, q, qd, mode="replay")

    def _read_wrench(self) -> WrenchSample:
        row, t = self._row, float(self._recording.t[self._row])
        status = int(self._recording.columns.get("status", np.zeros(len(self._recording)))[row])
        wrench = self._recording.wrench[row].astype(float)
        return WrenchSample(self._time, t, row, 0.0, not self._used[row], wrench, status)

    def _write(self, q: np.ndarray) -> Applied:
        return Applied(None, "a recording follows no targets: use track() with its own motion")

    def _move(self, start: np.ndarray, goal: np.ndarray, seconds: float) -> Move:
        return _InstantMove(self, goal)

    def jump(self, goal: np.ndarray) -> Reached:
        """Go to the first unused row at joint values (J,).

        Raises:
            DriverError: no row is there.
        """
        distance = np.abs(self._recording.q - goal).max(axis=1)
        at = np.flatnonzero((distance < NEAR) & ~self._used)
        if not len(at):
            miss = float(distance.min())
            raise DriverError(
                f"the recording has no further row at this pose; its nearest row is {miss:.2g} off"
            )
        self._row = int(at[0])
        return Reached(self._position(), 0.0)

    def _stop(self, kind: str) -> None:
        """Nothing moves."""

    def _sample(self, n: int, rate: float) -> Block:
        near = np.abs(self._recording.q - self._position()).max(axis=1) < NEAR
        rows = np.flatnonzero(near & ~self._used)[:n]
        if len(rows) < n:
            raise DriverError(f"the recording has {len(rows)} more rows at this pose, not {n}")
        return self._use(rows)

    def _track(self, targets: np.ndarray, rate: float) -> Iterator[Block]:
        wanted = np.stack([self._recording.columns.get(f"q_target{j + 1}", self._recording.q[:, j])
                           for j in range(targets.shape[1])], axis=-1)  # fmt: skip
        if len(targets) > len(wanted) or np.abs(wanted[: len(targets)] - targets).max() > NEAR:
            raise DriverError("the recording followed another trajectory")
        yield self._use(np.arange(len(targets)))

    def _use(self, rows: np.ndarray) -> Block:
        self._used[rows] = True
        self._row = int(rows[-1])
        t = self._recording.t[rows].astype(float)
        shift = max(0.0, self._time - t[0])
        self._time = float(np.nextafter(t[-1] + shift, np.inf))
        columns = {k: v[rows] for k, v in self._recording.columns.items() if k != "segment"}
        return columns | {"t": t + shift}


class _InstantMove(Move):
    """A move that takes no time."""

    def __init__(self, driver: ReplayDriver, goal: np.ndarray) -> None:
        super().__init__(goal)
        self._driver = driver

    def _advance(self) -> Reached:
        return self._driver.jump(self.goal)


DRIVER = ReplayDriver
