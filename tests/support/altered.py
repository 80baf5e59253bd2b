"""A recording with other columns, rows, readings or metadata, and what such changes are made of."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from wrenchbed.data.recording import Recording
from wrenchbed.physics.taylor_jets import value
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.simulation.closed_form import robot_of

QUATERNION = ("qw", "qx", "qy", "qz")


def by_name(names: Sequence[str], values: np.ndarray) -> dict[str, np.ndarray]:
    """Columns of a table (N, K)."""
    return {name: values[:, k].copy() for k, name in enumerate(names)}


def with_columns(r: Recording, columns: Mapping[str, np.ndarray]) -> Recording:
    return Recording(r.metadata, {**r.columns, **columns}, r.name)


def with_metadata(r: Recording, **metadata: object) -> Recording:
    return Recording(replace(r.metadata, **metadata), r.columns, r.name)


def with_rows(r: Recording, keep: np.ndarray) -> Recording:
    """Some rows: a mask (N,) or a slice."""
    return Recording(r.metadata, {k: v[keep] for k, v in r.columns.items()}, r.name)


def with_wrench(r: Recording, y: np.ndarray) -> Recording:
    """Other readings (N, 6)."""
    return with_columns(r, by_name(CHANNELS, y))


def with_added(r: Recording, change: np.ndarray) -> Recording:
    """A change (N, 6) of the readings."""
    return with_wrench(r, r.wrench + change)


def without_noise_stated(r: Recording) -> Recording:
    return with_metadata(r, sensor=replace(r.metadata.sensor, noise_std=None))


def stuck(r: Recording, names: Sequence[str], rows: np.ndarray, at: int | None = None) -> Recording:
    """Columns keep the values of one row in some rows (N,), those of the first of them if none."""
    row = int(np.argmax(rows)) if at is None else at
    return with_columns(r, {n: np.where(rows, r.columns[n][row], r.columns[n]) for n in names})


def swapped(r: Recording, one: str, other: str) -> Recording:
    return with_columns(r, {one: r.columns[other], other: r.columns[one]})


def opposite(r: Recording, names: Sequence[str]) -> Recording:
    return with_columns(r, {n: -r.columns[n] for n in names})


def in_degrees(r: Recording, names: Sequence[str]) -> Recording:
    return with_columns(r, {n: np.rad2deg(r.columns[n]) for n in names})


def scaled(r: Recording, force: float, torque: float) -> Recording:
    return with_wrench(r, r.wrench * np.repeat([force, torque], 3))


def posed(r: Recording, columns: Mapping[str, np.ndarray]) -> Recording:
    """Other joint columns, or of an orientation the quaternion of length 1 along them."""
    if r.joints:
        return with_columns(r, columns)
    q = np.stack([columns.get(c, r.columns[c]) for c in QUATERNION], axis=1)
    return with_columns(r, by_name(QUATERNION, q / np.linalg.norm(q, axis=1, keepdims=True)))


def at_point(force: np.ndarray, point: Sequence[float] | np.ndarray) -> np.ndarray:
    """The wrench (N, 6) of forces (N, 3) at points (3,) or (N, 3)."""
    return np.column_stack([force, np.cross(point, force)])


def turned(y: np.ndarray, turn: Rotation) -> np.ndarray:
    """Forces and torques (N, 6), turned alike."""
    return np.hstack([turn.apply(y[:, :3]), turn.apply(y[:, 3:])])


def pose_columns(r: Recording) -> tuple[str, ...]:
    """Names of the joint columns, or those of an orientation."""
    return tuple(r.joints) or QUATERNION


def orientation(r: Recording) -> Rotation:
    """Of the sensor in the base in each row."""
    if all(c in r.columns for c in QUATERNION):
        quaternion = np.stack([r.columns[c] for c in QUATERNION], axis=1)
        return Rotation.from_quat(quaternion, scalar_first=True)
    robot, q = robot_of(r), np.stack([r.columns[c] for c in r.joints], axis=1)
    return Rotation.from_matrix(value(robot.sensor_pose(q, robot.parameters.nominal)[0]))


def holds(r: Recording) -> np.ndarray:
    """Number of each row's hold (N,); of a motion tenths of a second."""
    segment = r.columns.get("segment")
    if segment is None or len(np.unique(segment)) < 3:
        return (r.t * 10.0).astype(int)
    return np.unique(segment, return_inverse=True)[1]


def run_of_holds(r: Recording, rng: np.random.Generator, fraction: float) -> np.ndarray:
    """Rows (N,) of a run of holds somewhere, one hold at least."""
    hold = holds(r)
    count = hold.max() + 1
    length = max(1, int(fraction * count))
    begin = int(rng.integers(0, max(1, count - length)))
    return (hold >= begin) & (hold < begin + length)


def of_other_holds(r: Recording, order: np.ndarray) -> Recording:
    """Hold k reads what hold ``order[k]`` read, as far as there are rows."""
    hold = holds(r)
    begin = np.searchsorted(hold, np.arange(hold.max() + 1))
    count = np.maximum(np.bincount(hold), 1)
    place = np.arange(len(hold)) - begin[hold]
    return with_wrench(r, r.wrench[begin[order[hold]] + place % count[order[hold]]])
