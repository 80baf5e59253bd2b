"""A real recording as the referee's setting: a rigid tool fitted to it, moved along its time axis.

Times and rates are estimates.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import cast

import numpy as np
from scipy.signal import butter, sosfiltfilt
from scipy.spatial.transform import Rotation

from wrenchbed import registry
from wrenchbed.benchmark.frame import converted, hold_means
from wrenchbed.benchmark.referee.fault import RefereeFault, mechanics, signal
from wrenchbed.benchmark.referee.laws import held, shaken
from wrenchbed.benchmark.referee.machine import Mechanics, Ride
from wrenchbed.benchmark.referee.scenario import MOVE_S, DrivePath, RefereeSetting
from wrenchbed.calibration.calibrate import identify_from_gravity
from wrenchbed.data.holds import gather
from wrenchbed.data.recording import Recording
from wrenchbed.errors import NotFoundError, ParameterError
from wrenchbed.physics.rotations import matrix
from wrenchbed.robots.base import SimulatedRobot
from wrenchbed.robots.oriented import ROBOT as ORIENTED
from wrenchbed.simulation.closed_form import robot_of

ACCELEROMETER = ("ax", "ay", "az")
AVERAGE_HZ = 25.0
"""Rate of the averages of a motion that are compared."""
_INERTIAL_HZ = 12.0
"""Measured accelerations count below this; above it the arm trembles."""
_REST_S, _REST_SHARE = 0.35, 0.3
"""Between arriving at a pose and its first row: this time, at most this share of the pause."""
_MOST = 100
"""Most instants of one move."""


@dataclass(frozen=True, eq=False)
class RealSetting(RefereeSetting):
    """A recording, and the rigid tool that fits it best.

    Attributes:
        recording: as it is.
        rotation: R_world_sensor at each instant (T, 3, 3).
        acceleration: of the tool at each instant, in sensor axes (T, 3) [m/s²].
        gravity: in world axes (3,) [m/s²].
        bias: fitted (6,) [N, N·m].
        own: noise of what is compared (6,): of a row at rest, of an average in motion.
        scatter: of a row about the mean that it belongs to (6,), not finite without repeats.
        offset: of the nominal reading (6,) [N, N·m].
    """

    recording: Recording
    rotation: np.ndarray
    acceleration: np.ndarray
    gravity: np.ndarray
    bias: np.ndarray
    own: np.ndarray
    scatter: np.ndarray
    offset: np.ndarray

    @property
    def stride(self) -> int:
        """Stride of the means that are compared: every one."""
        return 1

    @property
    def points(self) -> int:
        """Number of independent readings of a channel: rows at rest, averages in motion."""
        return len(self.path.rows) if self.mode == "static" else int(self.path.hold[-1]) + 1

    @property
    def accelerated(self) -> bool:
        """Whether accelerations are recorded."""
        return all(a in self.recording.columns for a in ACCELEROMETER)

    @cached_property
    def noise(self) -> np.ndarray:
        """Noise of the compared means (6,) [N, N·m]."""
        return self.own

    @cached_property
    def full_scale(self) -> np.ndarray:
        """The sensor's range (6,) [N, N·m]; of an unknown sensor twice the largest reading."""
        try:
            model = registry.load("sensors", str(self.metadata.sensor.model))
            return np.asarray(model.calibration().range, dtype=float)
        except NotFoundError:
            return np.asarray(2.0 * np.abs(self.recording.wrench).max(axis=0))

    @cached_property
    def tolerance(self) -> tuple[float, float, np.ndarray]:
        """Tolerances as stated, else the contract's: mass [kg], CoG [m] and bias (6,)."""
        default = {"tool.mass": 0.005 * self.mass, "tool.cog": 5e-4, "sensor.bias": 3.0 * self.own}
        dm, dc, db = (self.metadata.tolerance.get(k, v) for k, v in default.items())
        return float(dm), float(np.max(dc)), np.broadcast_to(np.asarray(db, dtype=float), 6)

    @cached_property
    def nominal(self) -> np.ndarray:
        """Readings of the rigid tool (n, 6) [N, N·m]."""
        return self.mean(self.ride().load) + self.offset

    def mean(self, signal: np.ndarray) -> np.ndarray:
        """Mean at each pose, or in motion of each average, of a signal at all instants (T, …)."""
        return self.means(signal[self.path.rows])

    def means(self, rows: np.ndarray) -> np.ndarray:
        """Mean at each pose, or of each average in motion, of recorded rows (N, …)."""
        return hold_means(rows, self.path.hold)

    def ride(self, faults: Sequence[RefereeFault] = ()) -> Ride:
        """A rigid tool along the recording, with faults of its body."""
        m = self._machine(faults)
        turn = Rotation.from_rotvec(m.mount).as_matrix()
        rotation = self.rotation @ turn
        pull = m.gravity @ rotation - self.acceleration @ turn
        tool = self.robot.tool(m.theta)
        force = float(tool.mass) * pull
        load = np.concatenate([force, np.cross(np.asarray(tool.cog), force)], axis=1)
        return Ride(self.path, load, rotation, np.zeros((len(load), 3)), m.gravity)

    def _machine(self, faults: Sequence[RefereeFault]) -> Mechanics:
        return mechanics(Mechanics(self.theta, self.gravity, np.zeros(0)), faults)

    def nuisance(self) -> np.ndarray:
        """Columns of bias, mass and first moment, which every fit removes (n, 6, 10)."""
        pull = self.mean(self.ride().load)[:, :3] / float(self.robot.tool(self.theta).mass)
        zero = np.zeros_like(pull)
        columns = [np.broadcast_to(e, (len(pull), 6)) for e in np.eye(6)]
        columns.append(np.concatenate([pull, zero], axis=1))
        columns += [np.concatenate([zero, np.cross(e, pull)], axis=1) for e in np.eye(3)]
        return np.stack(columns, axis=-1)

    def with_faults(
        self, wrench: np.ndarray, faults: Sequence[RefereeFault], rng: np.random.Generator
    ) -> np.ndarray:
        """Rows (N, 6) with faults: their difference on a rigid tool, then clocks, then rows."""
        clean, faulty = self.ride(), self.ride(faults)
        read = [replace(f, clock=None) for f in faults]
        y = wrench + (signal(faulty, read) - clean.load)[self.path.rows]
        for fault in faults:
            if fault.clock is not None:  # only in motion, where every instant is a row
                y = fault.clock(clean, y)
        changed = [f.rows for f in faults if f.rows is not None]
        for r in changed:
            more = np.sqrt(np.maximum(r.gain**2 - 1.0, 0.0))
            if more.any():
                y = y + more * self.scatter * rng.standard_normal(y.shape)
            if r.shake is not None:
                y = y + shaken(self, clean, r.shake(self.recording.t))
        y = converted(y, changed)
        for r in changed:
            y = y[held(len(y), r, rng)]
        return y

    def accelerations(self, faults: Sequence[RefereeFault]) -> np.ndarray:
        """Reading of an accelerometer on the tool with faults (N, 3) [m/s²]; minus gravity at
        rest."""
        read = np.stack([self.recording.columns[a] for a in ACCELEROMETER], axis=1)
        m, rows = self._machine(faults), self.path.rows
        rotation = self.rotation[rows]
        for fault in faults:
            if fault.rows is not None and fault.rows.shake is not None:
                read = read + np.einsum("nij,ni->nj", rotation, fault.rows.shake(self.recording.t))
        read = read - (m.gravity - self.gravity) @ rotation
        return np.asarray(read @ Rotation.from_rotvec(m.mount).as_matrix())


def setting_of(recording: Recording) -> RealSetting:
    """A setting of a recording, with a tool and a noise that are fitted where none are stated.

    Raises:
        CalibrationError: the orientations cannot separate mass from bias.
        ParameterError: it states no noise and has no repeats.
        RecordingError: nothing is known of its robot.
    """
    meta, robot = recording.metadata, robot_of(recording)
    gravity = np.array(meta.gravity or robot.gravity, dtype=float)
    seen = matrix(recording.q) if not recording.joints else np.broadcast_to(
        robot.sensor_pose(recording.q, robot.parameters.nominal)[0], (len(recording), 3, 3)
    )  # fmt: skip
    moving = meta.mode == "dynamic"
    hold = _averages(recording.t) if moving else _poses(recording)
    acceleration = np.zeros((len(recording), 3))
    if moving and all(a in recording.columns for a in ACCELEROMETER):
        acceleration = _inertial(recording, gravity @ seen)
    stated = meta.sensor.noise_std
    scatter = _scatter(recording.wrench, hold)
    if stated is None and not np.isfinite(scatter).all():
        raise ParameterError(f"{recording.name}: states no sensor.noise_std and has no repeats")
    noise = scatter if stated is None else np.array(stated)
    own = np.maximum(_rough(recording.wrench, hold), 1e-9) if moving else noise
    pull = hold_means(gravity @ seen - acceleration, hold)
    load = identify_from_gravity(pull, hold_means(recording.wrench, hold), 1.0 / own**2)
    tool = meta.tool
    tool = replace(
        tool,
        mass=round(load.mass, 4) if tool.mass is None else tool.mass,
        cog=tuple(np.round(load.cog, 5).tolist()) if tool.cog is None else tool.cog,
    )
    known = replace(meta.sensor, noise_std=tuple(float(s) for s in noise))
    if moving:
        path, rotation = _along(recording, seen, hold), seen
    else:
        path, rotation = _through(recording.t, seen, hold)
        acceleration = np.zeros((len(path.t), 3))
    warm = recording.columns.get("temperature")
    return RealSetting(
        cast(SimulatedRobot, ORIENTED),  # it is asked for its tool and parameters only
        path, replace(meta, tool=tool, sensor=known),
        ORIENTED.theta_of_tool(ORIENTED.parameters.nominal, load.mass, load.cog.tolist()),
        None if warm is None else np.interp(path.t, recording.t, warm),
        recording, rotation, acceleration, gravity, load.bias, own, scatter, np.zeros(6),
    )  # fmt: skip


def _poses(recording: Recording) -> np.ndarray:
    holds = gather(recording, np.ones(len(recording), dtype=bool))
    return np.repeat(np.arange(len(holds)), holds.count)


def _averages(t: np.ndarray) -> np.ndarray:
    index = np.floor((t - t[0]) * AVERAGE_HZ).astype(int)
    return np.unique(index, return_inverse=True)[1]


def _scatter(wrench: np.ndarray, group: np.ndarray) -> np.ndarray:
    """Standard deviation of a row about its group's mean (6,), not finite without repeats."""
    free = len(wrench) - int(group[-1]) - 1
    if free == 0:
        return np.full(6, np.inf)
    about = wrench - hold_means(wrench, group)[group]
    return np.sqrt((about**2).sum(axis=0) / free)


def _rough(wrench: np.ndarray, group: np.ndarray) -> np.ndarray:
    """Noise of an average (6,) by second differences, in which a smooth motion cancels."""
    bend = np.diff(hold_means(wrench, group), 2, axis=0)
    return np.sqrt((bend**2).mean(axis=0) / 6.0)


def _inertial(recording: Recording, pull: np.ndarray) -> np.ndarray:
    """Acceleration of the tool (N, 3): what weight does not explain of slow accelerometer rows.

    The accelerometer's gains, axes and zero are fitted, so that at rest nothing is left.
    """
    read = np.stack([recording.columns[a] for a in ACCELEROMETER], axis=1)
    basis = np.concatenate([pull, np.ones((len(pull), 1))], axis=1)
    residual = read - basis @ np.linalg.lstsq(basis, read, rcond=None)[0]
    rate = 1.0 / float(np.median(np.diff(recording.t)))
    if rate < 4.0 * _INERTIAL_HZ:
        return residual
    return np.asarray(sosfiltfilt(butter(2, _INERTIAL_HZ, fs=rate, output="sos"), residual, axis=0))


def _along(recording: Recording, rotation: np.ndarray, hold: np.ndarray) -> DrivePath:
    n = len(recording)
    q, still = Rotation.from_matrix(rotation).as_quat(), np.zeros((n, 4))
    return DrivePath(recording.t - recording.t[0], q, still, still, np.arange(n), hold)


def _through(t: np.ndarray, rotation: np.ndarray, hold: np.ndarray) -> tuple[DrivePath, np.ndarray]:
    """Minimum-jerk turns between poses, and every recorded row: path and orientations."""
    times, turns, rows = [], [], []
    starts = np.concatenate([[0], np.flatnonzero(np.diff(hold)) + 1, [len(t)]])
    count = 0
    for k in range(len(starts) - 1):
        first, end = int(starts[k]), int(starts[k + 1])
        if k:
            when, turn = _turn(t[first - 1], t[first], rotation[first - 1], rotation[first])
            times.append(when)
            turns.append(turn)
            count += len(when)
        times.append(t[first:end])
        turns.append(rotation[first:end])
        rows.append(np.arange(count, count + end - first))
        count += end - first
    every, turned = np.concatenate(times), np.concatenate(turns)
    q, still = Rotation.from_matrix(turned).as_quat(), np.zeros((len(every), 4))
    return DrivePath(every - t[0], q, still, still, np.concatenate(rows), hold), turned


def _turn(
    begin: float, end: float, start: np.ndarray, goal: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Instants strictly between two rows, and the orientations of a turn that ends before."""
    pause = end - begin
    lasts = pause - min(_REST_S, _REST_SHARE * pause)
    n = int(np.clip(round(lasts / MOVE_S), 2, _MOST))
    s = np.arange(1, n + 1) / n
    progress = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    vector = Rotation.from_matrix(start.T @ goal).as_rotvec()
    turn = Rotation.from_rotvec(progress[:, None] * vector).as_matrix()
    return begin + s * lasts, start @ turn
