"""Scatter of rows about what changes slowly: a line through each hold, or a smoothed motion.

Residuals come in groups, a hold or about a second of motion each. The scatter between groups is the
uncertainty of a variance, whatever tails and memory the rows have.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from wrenchbed.calibration.observations import smoothed
from wrenchbed.data.holds import gather, parts
from wrenchbed.data.recording import QUATERNION, Recording
from wrenchbed.diagnosis.prepare.configured_simulator import Configuration
from wrenchbed.diagnosis.prepare.noise import noise_in_motion
from wrenchbed.diagnosis.prepare.prepared import RATES_HZ
from wrenchbed.physics.wrench import CHANNELS

WINDOW_S = 0.6
"""Window [s] of the Savitzky–Golay filter of motions: it passes below about 3 Hz."""
GROUP_S, LEAST_GROUP = 1.0, 32
"""Length of a group of rows in motion [s], and its fewest rows."""
LEAST_HOLD, LEAST_GROUPS = 6, 12
"""Fewest rows of a hold whose scatter counts, and fewest groups of rows: from fewer a variance is
too rough to compare; more leave out short recordings."""
TAIL = 5.0
"""Largest distance of a row, in median distances; rows further out are scaled down to it."""
QUIET = 0.4
"""Least ratio of the first quartile of a motion's scatter to its mean that is steady noise."""
STEADY = 1.15
"""Largest variance of a hold's rows over the median group's: more is bursts, not noise."""
_Gathered = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


@dataclass(frozen=True, eq=False)
class Scatter:
    """Residuals of N rows in G groups, in units of ``scale``.

    Attributes:
        t: times of the rows (N,) [s].
        rows: residuals (N, 6), scaled up for the white noise that smoothing removed.
        scale: stated noise of a row (6,) [N, N·m], else the measured one.
        stated: whether the metadata state the noise.
        starts: index of the first row of each group (G,).
        count: number of rows in each group (G,).
        rotation: R_world_sensor of each group (G, 3, 3).
        lever: load [N, N·m] per acceleration of the tool in sensor axes [m/s²] (6, 3).
        kernel: smoothing weights in motion, empty at rest.
    """

    t: np.ndarray
    rows: np.ndarray
    scale: np.ndarray
    stated: bool
    starts: np.ndarray
    count: np.ndarray
    rotation: np.ndarray
    lever: np.ndarray
    kernel: np.ndarray

    @property
    def rate(self) -> float:
        """Rows per second [Hz]."""
        return 1.0 / float(np.median(np.diff(self.t)))

    def means(self, x: np.ndarray) -> np.ndarray:
        """Mean of values x (N, …) over each group of rows (G, …)."""
        return self.means_of(lambda at: x[at])

    def means_of(self, make: Callable[[slice], np.ndarray]) -> np.ndarray:
        """Mean over each group (G, …) of values (n, …) that ``make`` gives for a slice of rows."""
        total = [
            np.add.reduceat(make(at), self.starts[some] - at.start)
            for some, at in parts(self.count)
        ]
        return np.asarray((np.concatenate(total).T / self.count).T)

    def steady(self, x: np.ndarray) -> np.ndarray:
        """Whether x² (N, …) is about equal in all groups of a motion's rows (…); true at rest."""
        groups = self.means_of(lambda at: x[at] ** 2)
        even = np.quantile(groups, 0.25, axis=0) >= QUIET * groups.mean(axis=0)
        return np.asarray(even if len(self.kernel) else np.ones_like(even))

    def passed(self, frequency: float) -> float:
        """Share of a sine's power at a frequency [Hz] that remains in ``rows`` after smoothing."""
        if not len(self.kernel):
            return 1.0
        m = np.arange(len(self.kernel)) - len(self.kernel) // 2
        course = self.kernel @ np.cos(2.0 * np.pi * frequency / self.rate * m)
        return float((1.0 - course) ** 2 / (1.0 - self.kernel.max()))

    def variance(self) -> tuple[np.ndarray, np.ndarray]:
        """Variance of a row in each channel (6,), in ``scale``², and its standard uncertainty (6,).

        In motion it leaves out scatter that reversals, jumps and friction add for a part of the
        time, or at frequencies just above those of the smoothed motion.
        """
        groups = self.means(self.rows**2)
        std = groups.std(axis=0, ddof=1) / np.sqrt(len(groups))
        if len(self.kernel):
            stride = max(1, round(self.rate / RATES_HZ[1]))
            noise, _ = noise_in_motion(self.rows, 1.0 / self.rate, stride)
            return noise * (1.0 - self.kernel.max()), std
        return np.minimum(groups.mean(axis=0), STEADY * np.median(groups, axis=0)), std


def scatter(
    recording: Recording, configuration: Configuration, stale: np.ndarray
) -> Scatter | None:
    """Residuals of rows not ``stale`` (N,), a mask of repeats; None with too few groups of rows."""
    moving = recording.metadata.mode == "dynamic"
    gathered = _in_motion(recording, stale) if moving else _at_rest(recording, stale)
    if gathered is None or len(gathered[2]) < LEAST_GROUPS:
        return None
    index, rows, starts, kernel = gathered
    count = np.diff(np.append(starts, len(index)))
    std = recording.metadata.sensor.noise_std
    scale = np.zeros(6) if std is None else np.asarray(std, dtype=float)
    stated = bool((scale > 0.0).all())
    if not stated:
        scale = np.maximum(rows.std(axis=0), 1e-12)
    rows = rows / scale
    distance = np.sqrt(np.square(rows) @ np.maximum(rows.std(axis=0), 1e-12) ** -2.0)
    limit = TAIL * max(float(np.median(distance)), 1e-12)  # far rows shrink as a whole
    rows = rows * np.minimum(1.0, limit / np.maximum(distance, 1e-12))[:, None]
    rotation, lever = _carried(recording, configuration, index[starts + count // 2])
    return Scatter(recording.t[index], rows, scale, stated, starts, count, rotation, lever, kernel)


def _at_rest(recording: Recording, stale: np.ndarray) -> _Gathered | None:
    kept = np.flatnonzero(~stale)
    if len(kept) < LEAST_HOLD:
        return None
    holds = gather(recording, ~stale)
    long = np.flatnonzero(holds.count >= LEAST_HOLD)
    if not len(long):
        return None
    use = np.repeat(holds.count >= LEAST_HOLD, holds.count)
    index, count = kept[use], holds.count[long]
    starts = np.concatenate([[0], np.cumsum(count)[:-1]])

    def about(x: np.ndarray) -> np.ndarray:
        return np.asarray(x - np.repeat(np.add.reduceat(x, starts) / count, count))

    t, grown = about(recording.t[index]), np.repeat(np.sqrt(count / (count - 2.0)), count)
    square, y = np.add.reduceat(t**2, starts), np.empty((len(index), 6))
    for k, name in enumerate(CHANNELS):  # one at a time: rows may be a million
        x = about(recording.columns[name][index])
        y[:, k] = (x - t * np.repeat(np.add.reduceat(t * x, starts) / square, count)) * grown
    return index, y, starts, np.zeros(0)


def _in_motion(recording: Recording, stale: np.ndarray) -> _Gathered | None:
    t, y = recording.t, np.array(recording.wrench)
    step = float(np.median(np.diff(t))) if len(t) > 1 else 1.0
    window = max(11, 2 * round(WINDOW_S / step / 2) + 1)
    size = max(LEAST_GROUP, round(GROUP_S / step))
    fresh = np.flatnonzero(~stale)
    if len(t) < 4 * window or len(fresh) < LEAST_GROUPS * LEAST_GROUP:
        return None
    if stale.any():
        y = np.stack([np.interp(t, t[fresh], x[fresh]) for x in y.T], axis=-1)
    kernel = smoothed(np.eye(window), window)[window // 2]
    y = (y - smoothed(y, window)) / np.sqrt(1.0 - kernel.max())
    index = fresh[(fresh >= window // 2) & (fresh < len(t) - window // 2)]
    groups = max(1, len(index) // size)
    return index, y[index], np.arange(groups) * (len(index) // groups), kernel


def _carried(
    recording: Recording, configuration: Configuration, rows: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """R_world_sensor (G, 3, 3) at G row indices; load per acceleration (6, 3) [N, N·m per m/s²]."""
    robot, mass = configuration.model.robot, configuration.mass
    q = np.stack([recording.columns[c][rows] for c in recording.joints or QUATERNION], axis=-1)
    rotation = np.asarray(robot.sensor_pose(q, configuration.robot_theta)[0])
    if recording.metadata.tool.mass is None or mass <= 0.0:
        mass = max(mass, 1.0)
    force = np.eye(3) * (mass + float(configuration.tool.sensor_mass))
    torque = mass * configuration.tool.lever
    return np.broadcast_to(rotation, (len(rows), 3, 3)), np.vstack([force, torque])
