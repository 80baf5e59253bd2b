"""Bring text files and robots' logs in: columns mapped, units converted, clocks merged.

The first file of the map sets the rows. Columns of other files are interpolated to its times,
orientations along the shortest rotation (slerp), and rows outside any file's time are left out;
files without a clock are laid beside it row by row.
"""

import fnmatch
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pyarrow as pa
from scipy.spatial.transform import Rotation

from wrenchbed import registry
from wrenchbed.data.accelerometer_orientation import held, orientations
from wrenchbed.data.clock import (
    PER_S,
    at_times,
    evened,
    in_gap,
    nanoseconds,
    own_clock,
    quaternion_columns,
    unwrapped,
)
from wrenchbed.data.column_map import (
    ANGLES,
    AUTO,
    ROTATION,
    ColumnMap,
    FileMap,
    Source,
    turned,
)
from wrenchbed.data.holds import Split, check_at_rest, means_of, runs, split, with_noise
from wrenchbed.data.metadata import Metadata
from wrenchbed.data.recording import ACCELERATION, QUATERNION, Recording, joint_columns
from wrenchbed.data.rosbag_and_mcap import is_log
from wrenchbed.data.rosbag_and_mcap import table as log_table
from wrenchbed.data.text_table import BLANKS, SKIP, Columns, read_text
from wrenchbed.errors import MapError, NotFoundError
from wrenchbed.physics.wrench import CHANNELS

HOLD = "hold"
"""Column of the whole log of mode auto: number of the row's hold from 0, −1 in a move."""
_POSES_PER_SECOND = 1.0
_FORCE_TORQUE = (CHANNELS[:3], CHANNELS[3:])
_GIVEN = {*ROTATION, *(name for three in ANGLES for name in three)}
"""Names of the columns that become a quaternion."""


@dataclass(frozen=True, eq=False)
class Imported:
    """An imported recording (poses at rest, or a motion), how many rows were ``left_out`` as
    outside the other files' times, and ``notes`` on what was done to clock and rows. In mode auto
    ``motion`` is the whole log, moves included, and ``split`` its holds and moves; else both are
    None."""

    recording: Recording
    left_out: int
    notes: tuple[str, ...] = ()
    motion: Recording | None = None
    split: Split | None = None


def import_files(files: Sequence[str | Path], column_map: ColumnMap) -> Imported:
    """Read files by a column map and make a recording of them. A `MapError` for a file that the map
    does not know, a missing column, a value that is no number, a clock that does not advance, or
    files whose times do not overlap; a `RecordingError` if the result is no valid recording."""
    data, left_out, name, skipped = merged(files, column_map)
    metadata = column_map.metadata
    if column_map.mode == "static" or column_map.by_accelerometer:
        recording = _recording(data, replace(metadata, mode="static"), name)
        has_clock = any(source.target == "t" for source in column_map.files[0].columns)
        timed = has_clock or column_map.rate_hz is not None
        check_at_rest(recording, "" if timed else column_map.name)
        return Imported(recording, left_out, skipped)
    if column_map.mode != AUTO:
        data, notes = evened(data)
        recording = with_noise(_recording(data, metadata, name))
        return Imported(recording, left_out, skipped + notes)
    log = _recording(data, metadata, name)
    holds = split(log, slow=True)
    rest = holds.at_rest(log, replace(metadata, mode="static"))
    data, notes = evened(data | {HOLD: holds.hold})
    motion = with_noise(_recording(data, metadata, name))
    return Imported(rest, left_out, (*skipped, *notes, holds.sentence), motion, holds)


def _recording(data: Mapping[str, np.ndarray], metadata: Metadata, name: str) -> Recording:
    """Make a recording that begins at time 0, with integer columns where they are required."""
    columns = dict(data) | {"t": data["t"] - data["t"][0]}
    for whole in ("segment", "status"):
        if whole in columns:
            columns[whole] = columns[whole].astype(np.int64)
    return Recording(metadata, columns, name)


def merged(
    files: Sequence[str | Path], column_map: ColumnMap
) -> tuple[dict[str, np.ndarray], int, str, tuple[str, ...]]:
    """Merge files: columns of a recording (t, wrench in sensor axes, joints or quaternion), number
    of rows outside the other files' times, the first file's name, and notes on rows left out.

    Raises:
        MapError: see `import_files`.
    """
    paths = [Path(f) for f in files]
    names = [_matching(m, paths, column_map.name) for m in column_map.files]
    if unused := [path for path in paths if path not in names]:
        raise MapError(f"{unused[0]}: no [[file]] of {column_map.name} matches this file")
    tables = [_table(p, m) for p, m in zip(names, column_map.files, strict=True)]
    first, *others = (_columns(t, m) for (t, _), m in zip(tables, column_map.files, strict=True))
    notes: tuple[str, ...] = ()
    rows, start = len(next(iter(first.values()))), 0
    if "t" in first:
        start = first["t"][0]
        t = (first.pop("t") - start) / PER_S
    elif column_map.rate_hz is None and column_map.mode != "static":
        raise MapError(f"{names[0]}: a motion without a clock needs rate_hz in [recording]")
    else:
        t = np.arange(rows) / (column_map.rate_hz or _POSES_PER_SECOND)
    data, inside = {"t": t} | first, np.ones(rows, dtype=bool)
    if column_map.mode != "static":
        data, turned_on = unwrapped(data, column_map.angles)
        data, notes = own_clock(data)
        t, notes = data["t"], turned_on + notes
    for part, path in zip(others, names[1:], strict=True):
        if "t" in part:
            part |= {"t": (part["t"] - start) / PER_S}
            part, there, more = _beside(part, t, column_map)
            data, inside, notes = data | part, inside & there, notes + more
            continue
        if (count := len(next(iter(part.values())))) != rows:
            raise MapError(
                f"{path}: without a clock (t) it is laid beside {names[0].name} row by row, but it "
                f"has {count} rows and not {rows}"
            )
        data |= part
    if not inside.any():
        raise MapError(f"{column_map.name}: the files' times do not overlap")
    data = {k: v[inside] for k, v in data.items()}
    notes += tuple(
        f"{path.name}: {skipped} rows without a value left out"
        for path, (_, skipped) in zip(names, tables, strict=True) if skipped
    )  # fmt: skip
    if column_map.by_accelerometer:
        data, sentence = _by_accelerometer(data, column_map.mode, str(names[0]))
        notes += (sentence,)
    data = _in_sensor_axes(data, column_map, names[0])
    return data, int((~inside).sum()), str(names[0]), notes


def _beside(
    part: dict[str, np.ndarray], t: np.ndarray, column_map: ColumnMap
) -> tuple[dict[str, np.ndarray], np.ndarray, tuple[str, ...]]:
    """Columns of a further file at times t (N,), which of these it has (N,), notes on its clock."""
    notes: tuple[str, ...] = ()
    gap = np.zeros(len(t), dtype=bool)
    if column_map.mode != "static":
        part, turned_on = unwrapped(part, column_map.angles)
        part, more = evened(part)
        gap, notes = in_gap(part["t"], t), turned_on + more
    there = (t >= part["t"][0]) & (t <= part["t"][-1]) & ~gap
    return at_times(part, t), there, notes


def _by_accelerometer(
    data: Mapping[str, np.ndarray], mode: str, where: str
) -> tuple[dict[str, np.ndarray], str]:
    """Replace accelerometer columns by the orientation that they show at rest, each pose a segment;
    return the columns and a sentence. Errors begin with ``where``.

    Raises:
        MapError: rows lie between poses and ``mode`` is not auto, or the sensor was not at rest.
    """
    read = np.stack([data[c] for c in ACCELERATION], axis=1)
    groups = held(read)
    if mode == AUTO:
        path = {f"q{k + 1}": column for k, column in enumerate(read.T)}
        log = Recording(Metadata("unknown", "dynamic"), dict(data) | path, where)
        rests = split(log).hold
        groups = np.array([r for k in range(rests.max() + 1) for r in runs(rests == k)])
    elif groups is None or mode != "static":
        raise MapError(
            f"{where}: no orientation is mapped, and an accelerometer gives one only at rest: "
            "--mode auto finds the rows at rest"
        )
    rotation, sentence = orientations(means_of(read, *groups.T), where)
    pose = np.repeat(np.arange(len(groups)), np.diff(groups, axis=1)[:, 0])
    rows = np.concatenate([np.arange(*group) for group in groups])
    kept = {k: v[rows] for k, v in data.items() if k not in ACCELERATION}
    return kept | quaternion_columns(rotation[pose]) | {"segment": pose}, sentence


def _matching(file_map: FileMap, paths: list[Path], name: str) -> Path:
    hits = [p for p in paths if fnmatch.fnmatch(p.name, file_map.match)]
    if len(hits) != 1:
        files = ", ".join(p.name for p in hits[:5]) or "none"
        raise MapError(
            f"{name}: match = {file_map.match!r} must fit one of the files, found {files}"
        )
    return hits[0]


def _table(path: Path, file_map: FileMap) -> tuple[Columns, int]:
    """Read a file's columns; also return the number of rows left out because they lack a value."""
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
    """Convert a table's columns to SI, times to whole ns and any orientation to a quaternion."""
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
    """Times (N,) [ns] from a clock column of numbers, of two columns, or of text stamps."""
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
    """Convert orientation to the sensor's, wrench to its axes, in ``data`` of the file ``path``."""
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
    """Orientations (N,) of the sensor in the base at joint columns, by the robot's nominal model.

    Raises:
        MapError: no joints, or no such robot; begins with ``where``.
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
