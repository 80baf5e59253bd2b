"""Bring text files and robots' logs in: columns mapped, units converted, clocks merged.

The first file of the map sets the rows. Columns of other files are interpolated to its times,
orientations along the shortest rotation (slerp), and rows outside any file's time are left out;
files without a clock are laid beside it row by row. Clocks are whole nanoseconds: an epoch time in
µs has 16 digits; a float of seconds would lose the last of them.
"""

import fnmatch
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pyarrow as pa
from scipy.spatial.transform import Rotation, Slerp

from wrenchbed import registry
from wrenchbed.data.column_map import (
    ANGLES,
    AUTO,
    ROTATION,
    UNITS,
    ColumnMap,
    FileMap,
    Source,
    turned,
)
from wrenchbed.data.holds import Split, check_at_rest, split, with_noise
from wrenchbed.data.logs import is_log
from wrenchbed.data.logs import table as log_table
from wrenchbed.data.metadata import Metadata
from wrenchbed.data.recording import QUATERNION, Recording, joint_columns
from wrenchbed.data.text_table import BLANKS, SKIP, Columns, read_text
from wrenchbed.errors import MapError, NotFoundError
from wrenchbed.physics.wrench import CHANNELS

PER_S = 1e9
"""Nanoseconds in a second."""
JITTER = 0.02
"""Steps that differ by less than this fraction are even; as `calibrate` demands of a motion."""
_GAP = 3.5
"""A step of more than so many usual ones is a gap: over two lost frames in a row a straight line is
the joints' path."""
_DEGREE, _TRIED = 5, 40
"""Degree of the polynomial that fills a gap through as long a stretch on both sides, and stretches
without a gap on which it is tried first."""
_LONGEST_S = 0.05
"""Longest gap that may be filled [s]: of all but the joints straight lines fill it, which are off
by 3 % of the amplitude of what repeats every half second."""
_LOST, _SMOOTHER = 1.7, 0.5
"""Step over the mean one from which a row was lost in between; and the ratio of squared bends of
the joints' path, by rows over by stamps, below which the rows were read evenly: either is larger
where its clock is not the true one."""
_FASTEST = 10.0
"""Top speed of arms' joints [rad/s]: a faster step is a report that passed from π to −π."""
_LATEST_S = 9e9
"""Largest time [s], in the year 2255: a larger one is in another unit."""
HOLD = "hold"
"""Column of a whole log of mode auto: the number of the row's hold from 0, −1 in a move."""
_POSES_PER_SECOND = 1.0
_FORCE_TORQUE = (CHANNELS[:3], CHANNELS[3:])
_GIVEN = {*ROTATION, *(name for three in ANGLES for name in three)}
"""Names of the columns that become a quaternion."""


def nanoseconds(values: np.ndarray, zero: float, size: float, where: str) -> np.ndarray:
    """Times (N,) [ns] of a column of whole numbers or floats.

    Args:
        values: of the column (N,).
        zero: what it shows at time 0.
        size: of its unit [s].
        where: file and column, for messages.

    Raises:
        MapError: the clock does not advance, or is not in this unit.
    """
    if values.dtype.kind in "iu":
        t = (values.astype(np.int64) - round(zero)) * round(size * PER_S)
    else:
        seconds = (values - zero) * size
        if np.abs(seconds).max(initial=0.0) > _LATEST_S:
            raise MapError(f"{where}: {seconds[-1]:.4g} s is no time: give the unit of the clock")
        t = np.rint(seconds * PER_S).astype(np.int64)
    bad = np.flatnonzero(np.diff(t) <= 0)
    if len(bad):
        raise MapError(f"{where}, row {bad[0] + 1}: the clock does not advance")
    return np.asarray(t)


def even_clock(t: np.ndarray, bridged: float = 0.0) -> tuple[np.ndarray, str] | None:
    """The even clock (M,) [s] nearest to a clock (N,) [s], without times in gaps, and what was done
    in words; None if the clock is even already, or too short.

    Args:
        t: clock.
        bridged: longest step that is no gap [s], however many frames are lost in it.
    """
    step = np.diff(t)
    if len(step) < 2:
        return None
    usual = float(np.median(step))
    # mean step of rows that follow each other: less than a frame is lost between them
    h = float(step[(step > 0.5 * usual) & (step < 1.5 * usual)].mean())
    if np.abs(step - h).max() <= JITTER * h:
        return None
    most = max(_GAP * usual, bridged)
    breaks = np.flatnonzero(step > most)
    parts = []
    for begin, end in zip([0, *(breaks + 1)], [*breaks, len(t) - 1], strict=True):
        first = np.ceil((t[begin] - t[0]) / h - 1e-6)
        last = np.floor((t[end] - t[0]) / h + 1e-6)
        parts.append(t[0] + h * np.arange(first, last + 1))
    inside = step[step <= most]
    sentence = (
        f"steps of {1e3 * inside.min():.3g} … {1e3 * inside.max():.3g} ms resampled to "
        f"{1.0 / h:.6g} Hz"
    )
    if dropped := int(np.maximum(np.rint(inside / usual) - 1, 0).sum()):
        sentence += f", {dropped} dropped frames interpolated"
    if len(breaks):
        sentence += f", {len(breaks)} gaps of {step[breaks].sum():.3g} s in all kept"
    return np.concatenate(parts), sentence


def at_times(data: Mapping[str, np.ndarray], t: np.ndarray) -> dict[str, np.ndarray]:
    """Columns, ``t`` among them, interpolated to times (M,): linearly, orientations along the
    shortest rotation, whole numbers from the nearest row."""
    old = data["t"]
    columns: dict[str, np.ndarray] = {}
    if QUATERNION[0] in data:
        q = Rotation.from_quat(np.stack([data[c] for c in QUATERNION], axis=-1), scalar_first=True)
        turned = Slerp(old, q)(np.clip(t, old[0], old[-1]))
        columns |= quaternion_columns(turned)
    nearest = np.searchsorted((old[1:] + old[:-1]) / 2.0, t, side="right")
    for name, values in data.items():
        if name not in ("t", *QUATERNION):
            whole = name in ("segment", "status") or values.dtype.kind in "iu"
            columns[name] = values[nearest] if whole else np.interp(t, old, values)
    return columns


def quaternion_columns(rotation: Rotation) -> dict[str, np.ndarray]:
    """Columns qw qx qy qz (N,), qw ≥ 0."""
    q = rotation.as_quat(canonical=True, scalar_first=True)
    return dict(zip(QUATERNION, q.T, strict=True))


@dataclass(frozen=True, eq=False)
class Imported:
    """A recording, and what became of the rows.

    Attributes:
        recording: poses at rest, or a motion.
        left_out: rows outside the other files' times.
        notes: sentences on what was done to the clock and to the rows.
        motion: of a log of holds and moves (mode auto) all of it, the moves too; else None.
        split: its holds and moves; else None.
    """

    recording: Recording
    left_out: int
    notes: tuple[str, ...] = ()
    motion: Recording | None = None
    split: Split | None = None


def import_files(files: Sequence[str | Path], column_map: ColumnMap) -> Imported:
    """Read files by a map.

    Raises:
        MapError: a file that the map does not know, a missing column, a value that is no number,
            a clock that does not advance, or files whose times do not overlap.
        RecordingError: the result is no valid recording.
    """
    data, left_out, name, skipped = merged(files, column_map)
    metadata = column_map.metadata
    if column_map.mode != "static":
        data, unwrapped = _unwrapped(data, column_map)
        skipped += unwrapped
    if column_map.mode == "static":
        recording = _recording(data, metadata, name)
        check_at_rest(recording)
        return Imported(recording, left_out, skipped)
    if column_map.mode != AUTO:
        data, notes = _even(data)
        recording = with_noise(_recording(data, metadata, name))
        return Imported(recording, left_out, skipped + notes)
    log = _recording(data, metadata, name)
    holds = split(log)
    rest = holds.at_rest(log, replace(metadata, mode="static"))
    data, notes = _even(data | {HOLD: holds.hold})
    motion = with_noise(_recording(data, metadata, name))
    return Imported(rest, left_out, (*skipped, *notes, holds.sentence), motion, holds)


def _recording(data: Mapping[str, np.ndarray], metadata: Metadata, name: str) -> Recording:
    """A recording whose time begins at 0, with whole numbers where they are wanted."""
    columns = dict(data) | {"t": data["t"] - data["t"][0]}
    for whole in ("segment", "status"):
        if whole in columns:
            columns[whole] = columns[whole].astype(np.int64)
    return Recording(metadata, columns, name)


def _unwrapped(
    data: dict[str, np.ndarray], column_map: ColumnMap
) -> tuple[dict[str, np.ndarray], tuple[str, ...]]:
    """A motion whose joints turn on where their reports pass from π to −π, and which these are."""
    angles = {c.target for f in column_map.files for c in f.columns if UNITS[c.unit][0] == "angle"}
    turned_on = dict[str, np.ndarray]()
    for name in angles & set(joint_columns(data)):
        steps = np.diff(data[name])
        turns = np.round(steps / (2.0 * np.pi))
        turns[np.abs(steps) < _FASTEST * np.diff(data["t"])] = 0.0  # the joint may have gone there
        if turns.any():
            turned_on[name] = data[name] - 2.0 * np.pi * np.append(0.0, np.cumsum(turns))
    notes = [f"{name} passes ±180°: unwrapped" for name in sorted(turned_on)]
    return data | turned_on, tuple(notes)


def _even(data: dict[str, np.ndarray]) -> tuple[dict[str, np.ndarray], tuple[str, ...]]:
    """A motion of joints on an even clock, whose acceleration can be taken; and what was done."""
    joints = joint_columns(data)
    if not joints or len(data["t"]) < 2:
        return data, ()
    t, steps = data["t"], np.diff(data["t"])
    q = np.stack([data[name] for name in joints], axis=1)
    clock = even_clock(t, _longest_known(t, q))
    if clock is None:
        return data, ()
    if steps.max() < _LOST * steps.mean() and _read_evenly(data, joints):
        own = t[0] + np.arange(len(t)) * steps.mean()
        late = 1e3 * float(np.abs(t - own).max())
        words = f"stamps are late by up to {late:.2g} ms, the joints move by even steps of "
        words += f"{1e3 * steps.mean():.6g} ms: their own clock restored"
        return data | {"t": own}, (words,)
    t, sentence = clock
    path = _bridged(data["t"], q, t)
    return {"t": t} | at_times(data, t) | dict(zip(joints, path.T, strict=True)), (sentence,)


def _read_evenly(data: Mapping[str, np.ndarray], joints: Sequence[str]) -> bool:
    """Whether joints bend much less from row to row than by their stamps: these then are of the
    rows' arrival."""
    step = np.diff(data["t"])
    by_row = by_stamp = 0.0
    for name in joints:
        way = np.diff(data[name])
        by_row += float((np.diff(way) ** 2).sum())
        by_stamp += float((np.diff(way / step * step.mean()) ** 2).sum())
    return by_row < _SMOOTHER * by_stamp


def _longest_known(t: np.ndarray, q: np.ndarray) -> float:
    """Longest gap [s] between times (N,) that may be filled; 0 if there is none.

    Polynomials fill stretches of its length, of which the joint values (N, J) are known, with
    errors of at most twice those of a straight line over every second row, by noise or by bends.
    """
    step, longest = np.diff(t), 0.0
    most = _GAP * float(np.median(step))
    line = ((q[1:-1] - (q[:-2] + q[2:]) / 2.0) ** 2).mean(axis=0)
    for gap in np.sort(step[(step > most) & (step < _LONGEST_S)]):
        error = list[np.ndarray]()
        for middle in np.linspace(t[0] + 1.5 * gap, t[-1] - 1.5 * gap, _TRIED):
            rows = np.flatnonzero(np.abs(t - middle) < 1.5 * gap)
            near = rows[np.abs(t[rows] - middle) > 0.5 * gap]
            if len(near) > 2 * _DEGREE and np.diff(t[rows]).max() < most:
                hidden = np.setdiff1d(rows, near)
                filled = _through(t[near], q[near], t[hidden])
                error.append(((q[hidden] - filled) ** 2).mean(axis=0))
        if not error or (np.mean(error, axis=0) > 4.0 * line).any():
            break
        longest = float(gap)
    return longest


def _through(t: np.ndarray, q: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Values (M, J) at times (M,) of the polynomials through values (N, J) at times (N,)."""
    middle, half = (t[0] + t[-1]) / 2.0, (t[-1] - t[0]) / 2.0
    powers = np.polynomial.polynomial.polyvander((t - middle) / half, _DEGREE)
    slopes = np.linalg.lstsq(powers, q, rcond=None)[0]
    return np.polynomial.polynomial.polyvander((at - middle) / half, _DEGREE) @ slopes


def _bridged(old: np.ndarray, q: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Joint values (N, J) of times (N,) at times (M,), in gaps by a polynomial through the rows on
    both sides."""
    step = np.diff(old)
    result = np.stack([np.interp(t, old, x) for x in q.T], axis=1)
    for k in np.flatnonzero(step > _GAP * np.median(step)):
        inside = (t > old[k]) & (t < old[k + 1])
        near = (old > old[k] - step[k]) & (old < old[k + 1] + step[k])
        if inside.any() and near.sum() > 2 * _DEGREE:
            result[inside] = _through(old[near], q[near], t[inside])
    return result


def merged(
    files: Sequence[str | Path], column_map: ColumnMap
) -> tuple[dict[str, np.ndarray], int, str, tuple[str, ...]]:
    """Columns of a recording (t, wrench in sensor axes, joints or quaternion), rows outside the
    other files' times, the first file's name, and notes on rows without a value.

    Raises:
        MapError: see `import_files`.
    """
    paths = [Path(f) for f in files]
    names = [_matching(m, paths, column_map.name) for m in column_map.files]
    if unused := [path for path in paths if path not in names]:
        raise MapError(f"{unused[0]}: no [[file]] of {column_map.name} matches this file")
    tables = [_table(p, m) for p, m in zip(names, column_map.files, strict=True)]
    first, *others = (_columns(t, m) for (t, _), m in zip(tables, column_map.files, strict=True))
    rows, start = len(next(iter(first.values()))), 0
    if "t" in first:
        start = first["t"][0]
        t = (first.pop("t") - start) / PER_S
    elif column_map.rate_hz is None and column_map.mode != "static":
        raise MapError(f"{names[0]}: a motion without a clock needs rate_hz in [recording]")
    else:
        t = np.arange(rows) / (column_map.rate_hz or _POSES_PER_SECOND)
    data, inside = {"t": t} | first, np.ones(rows, dtype=bool)
    for part, path in zip(others, names[1:], strict=True):
        if "t" in part:
            times = (part["t"] - start) / PER_S
            inside &= (t >= times[0]) & (t <= times[-1])
            data |= at_times(part | {"t": times}, t)
            continue
        if (count := len(next(iter(part.values())))) != rows:
            raise MapError(
                f"{path}: without a clock (t) it is laid beside {names[0].name} row by row, but it "
                f"has {count} rows and not {rows}"
            )
        data |= part
    if not inside.any():
        raise MapError(f"{column_map.name}: the files' times do not overlap")
    data = _in_sensor_axes({k: v[inside] for k, v in data.items()}, column_map, names[0])
    notes = tuple(
        f"{path.name}: {skipped} rows without a value left out"
        for path, (_, skipped) in zip(names, tables, strict=True) if skipped
    )  # fmt: skip
    return data, int((~inside).sum()), str(names[0]), notes


def _matching(file_map: FileMap, paths: list[Path], name: str) -> Path:
    hits = [p for p in paths if fnmatch.fnmatch(p.name, file_map.match)]
    if len(hits) != 1:
        files = ", ".join(p.name for p in hits[:5]) or "none"
        raise MapError(
            f"{name}: match = {file_map.match!r} must fit one of the files, found {files}"
        )
    return hits[0]


def _table(path: Path, file_map: FileMap) -> tuple[Columns, int]:
    """Columns of a file, and how many rows of it were left out because they lack a value."""
    if is_log(path):
        wanted = [c.column for c in file_map.columns]
        table = Columns(log_table(path, file_map.topic, wanted), str(path))
    else:
        blanks = file_map.delimiter in (" ", "\t ")
        table = read_text(path, BLANKS if blanks else file_map.delimiter)
    rows = table.table.num_rows
    if file_map.skip_incomplete:
        table = table.complete([c.column for c in file_map.columns])
    if table.table.num_rows == 0:
        raise MapError(f"{path}: the file has 0 rows{' with all values' if rows else ''}")
    return table, rows - table.table.num_rows


def _columns(table: Columns, file_map: FileMap) -> dict[str, np.ndarray]:
    """Columns in SI, times in whole ns, any orientation as a quaternion."""
    data: dict[str, np.ndarray] = {}
    for source in file_map.columns:
        if source.target == "t":
            data["t"] = _clock(table, source)
        else:
            values = table.numbers(source.column, SKIP)
            data[source.target] = (values / source.per - source.zero) * source.factor
    given = turned(data, table.where)
    kept = {k: v for k, v in data.items() if k not in _GIVEN}
    return kept if given is None else kept | quaternion_columns(given)


def _clock(table: Columns, source: Source) -> np.ndarray:
    """Times (N,) [ns] of numbers in a unit, of two columns, or of stamps in text."""
    where = f"{table.where}: column {source.column!r}"
    if (stamps := table.times(source.column)) is not None:
        return nanoseconds(stamps, 0.0, 1.0 / PER_S, where)
    values, raw = table.numbers(source.column, SKIP), table.table.column(source.column)
    if source.nanoseconds is not None:
        parts = np.rint(table.numbers(source.nanoseconds)).astype(np.int64)
        t = np.rint(values).astype(np.int64) * round(source.factor * PER_S) + parts
        return nanoseconds(t, source.zero, 1.0 / PER_S, where)
    if pa.types.is_integer(raw.type) and source.per == 1.0:
        values = raw.to_numpy()
    values = values / source.per if source.per != 1.0 else values
    return nanoseconds(values, source.zero, source.factor, where)


def _in_sensor_axes(
    data: dict[str, np.ndarray], column_map: ColumnMap, path: Path
) -> dict[str, np.ndarray]:
    """The orientation made the sensor's, and the wrench turned into its axes."""
    conventions, stated = column_map.conventions, column_map.metadata
    pose = stated.sensor.pose_flange
    rows = len(data["t"])
    if conventions.constant is not None:
        still = np.tile(np.asarray(conventions.constant), (rows, 1))
        data |= dict(zip(QUATERNION, still.T, strict=True))
    flange = None if pose is None else Rotation.from_quat(pose[3:], scalar_first=True)
    rotation = turned(data, str(path))
    if rotation is not None:
        rotation = rotation.inv() if conventions.inverse else rotation
        if conventions.of == "flange" and flange is not None:
            rotation = rotation * flange
        data |= quaternion_columns(rotation)
    about = np.asarray(conventions.about)
    if conventions.wrench_axes == "sensor" and not about.any():
        return data
    force, torque = (np.stack([data[c] for c in three], axis=1) for three in _FORCE_TORQUE)
    if conventions.wrench_axes == "flange":
        assert pose is not None and flange is not None  # the map was refused without
        back, torque = flange.inv(), torque - np.cross(np.asarray(pose[:3]), force)
    elif conventions.wrench_axes == "sensor":
        back = Rotation.identity()
    else:
        if rotation is None:
            rotation = sensor_by_joints(data, stated, str(path))
        back = rotation.inv()
    force, torque = back.apply(force), back.apply(torque)
    wrench = np.concatenate([force, torque + np.cross(about, force)], axis=1)
    return data | dict(zip(CHANNELS, wrench.T, strict=True))


def sensor_by_joints(data: Mapping[str, np.ndarray], metadata: Metadata, where: str) -> Rotation:
    """The sensor in the base (N,) from joint values, by the nominal model of the robot.

    Args:
        data: columns q1… (N,) [rad or m].
        metadata: names the robot, and states how the sensor sits on its flange.
        where: name of the file, for messages.

    Raises:
        MapError: no joints, or no such robot.
    """
    joints = joint_columns(data)
    if not joints:
        raise MapError(f"{where}: a wrench in the base's axes needs an orientation or joints")
    try:
        robot = registry.load("robots", metadata.robot)
    except NotFoundError as error:
        raise MapError(f"{where}: joints without an orientation need a robot: {error}") from error
    if len(joints) != len(robot.joints):
        raise MapError(f"{where}: has {len(joints)} joints, {robot.name} has {len(robot.joints)}")
    pose, mount = metadata.sensor.pose_flange, {}
    if pose is not None and "mount.rotation.x" in robot.parameters.names:
        turn = Rotation.from_quat(pose[3:], scalar_first=True).as_rotvec()
        mount = {f"mount.rotation.{a}": float(v) for a, v in zip("xyz", turn, strict=True)}
    q = np.stack([data[c] for c in joints], axis=1)
    rotation, _ = robot.sensor_pose(q, robot.parameters.vector(mount))
    return Rotation.from_matrix(rotation)
