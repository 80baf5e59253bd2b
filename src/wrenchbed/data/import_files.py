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
from scipy.spatial.transform import Rotation, Slerp

from wrenchbed import registry
from wrenchbed.data.column_map import (
    ANGLES,
    AUTO,
    ROTATION,
    ColumnMap,
    FileMap,
    columns_of,
    of_sensor,
    turned,
    wrench_in_sensor,
)
from wrenchbed.data.holds import Split, check_at_rest, split, with_noise
from wrenchbed.data.logs import is_log
from wrenchbed.data.logs import table as log_table
from wrenchbed.data.metadata import Metadata
from wrenchbed.data.recording import QUATERNION, Recording, joint_columns
from wrenchbed.data.text_table import BLANKS, Columns, read_text
from wrenchbed.errors import MapError, NotFoundError
from wrenchbed.physics.wrench import CHANNELS

HOLD = "hold"
"""Column of a whole log of mode auto: the number of the row's hold from 0, −1 in a move."""
JITTER = 0.02
"""Steps that differ by less than this fraction are even; as `calibrate` demands of a motion."""
_GAP = 3.5
"""A step of more than so many usual ones is a gap and is not filled: over two lost frames in a row
the joints' path is known, over more of them an acceleration would be invented."""
_POSES_PER_SECOND = 1.0
_GIVEN = {*ROTATION, *(name for three in ANGLES for name in three)}
"""Names of the columns that become a quaternion."""


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
    data, left_out, name = merged(files, column_map)
    metadata = column_map.metadata
    if column_map.mode == "static":
        recording = _recording(data, metadata, name)
        check_at_rest(recording)
        return Imported(recording, left_out)
    if column_map.mode != AUTO:
        data, notes = _even(data)
        return Imported(with_noise(_recording(data, metadata, name)), left_out, notes)
    log = _recording(data, metadata, name)
    holds = split(log)
    rest = holds.at_rest(log, replace(metadata, mode="static"))
    data, notes = _even(data | {HOLD: holds.hold})
    motion = with_noise(_recording(data, metadata, name))
    return Imported(rest, left_out, (*notes, holds.sentence), motion, holds)


def _recording(data: Mapping[str, np.ndarray], metadata: Metadata, name: str) -> Recording:
    """A recording whose time begins at 0, with whole numbers where they are wanted."""
    columns = dict(data) | {"t": data["t"] - data["t"][0]}
    for whole in ("segment", "status"):
        if whole in columns:
            columns[whole] = columns[whole].astype(np.int64)
    return Recording(metadata, columns, name)


def _even(data: dict[str, np.ndarray]) -> tuple[dict[str, np.ndarray], tuple[str, ...]]:
    """A motion of joints on an even clock, whose acceleration can be taken; and what was done."""
    clock = even_clock(data["t"]) if joint_columns(data) else None
    if clock is None:
        return data, ()
    t, sentence = clock
    return {"t": t} | at_times(data, t), (sentence,)


def merged(
    files: Sequence[str | Path], column_map: ColumnMap
) -> tuple[dict[str, np.ndarray], int, str]:
    """Columns of a recording (t, wrench in sensor axes, joints or quaternion), rows left out, and
    the first file's name.

    Raises:
        MapError: see `import_files`.
    """
    paths = [Path(f) for f in files]
    names = [_matching(m, paths, column_map.name) for m in column_map.files]
    if unused := [path for path in paths if path not in names]:
        raise MapError(f"{unused[0]}: no [[file]] of {column_map.name} matches this file")
    parts = [_columns(path, m) for path, m in zip(names, column_map.files, strict=True)]
    first = parts[0] | {"t": _clock(parts[0], names[0], column_map)}
    t = since(first["t"], first["t"][0])
    data = {k: v for k, v in first.items() if k != "t"}
    inside = np.ones(len(t), dtype=bool)
    for part, path in zip(parts[1:], names[1:], strict=True):
        if "t" not in part:
            data |= _beside(part, path, len(t), names[0])
            continue
        part["t"] = since(part["t"], first["t"][0])
        inside &= (t >= part["t"][0]) & (t <= part["t"][-1])
        data |= at_times(part, t)
    if not inside.any():
        raise MapError(f"{column_map.name}: the files' times do not overlap")
    data = {"t": t} | data
    data = _in_sensor_axes({k: v[inside] for k, v in data.items()}, column_map, names[0])
    return data, int((~inside).sum()), str(names[0])


def _matching(file_map: FileMap, paths: list[Path], name: str) -> Path:
    hits = [p for p in paths if fnmatch.fnmatch(p.name, file_map.match)]
    if len(hits) != 1:
        files = ", ".join(p.name for p in hits[:5]) or "none"
        raise MapError(
            f"{name}: match = {file_map.match!r} must fit one of the files, found {files}"
        )
    return hits[0]


def _columns(path: Path, file_map: FileMap) -> dict[str, np.ndarray]:
    table = _table(path, file_map)
    if table.table.num_rows == 0:
        raise MapError(f"{path}: the file has 0 rows")
    data: dict[str, np.ndarray] = {}
    for source in file_map.columns:
        values = table.numbers(source.column)
        data[source.target] = (values / source.per - source.zero) * source.factor
    if "t" in data:
        data["t"] = _times(path, table.table, file_map, data["t"])
    given = turned(data, str(path))
    kept = {k: v for k, v in data.items() if k not in _GIVEN}
    return kept if given is None else kept | columns_of(given)


def _table(path: Path, file_map: FileMap) -> Columns:
    """The file's table."""
    if is_log(path):
        names = [c.column for c in file_map.columns]
        return Columns(log_table(path, file_map.topic, names), str(path))
    return read_text(path, BLANKS if file_map.delimiter in (" ", "\t ") else file_map.delimiter)


def _times(path: Path, table: pa.Table, file_map: FileMap, scaled: np.ndarray) -> np.ndarray:
    """Times as the clock has them: whole nanoseconds if it counts, else seconds.

    An epoch time in µs has 16 digits; a float of seconds would lose the last of them.
    """
    clock = file_map.clock
    assert clock is not None
    raw = table.column(clock.column)
    t = scaled
    if pa.types.is_integer(raw.type) and clock.per == 1.0:
        t = (raw.to_numpy().astype(np.int64) - round(clock.zero)) * round(clock.factor / 1e-9)
    bad = np.flatnonzero(np.diff(t) <= 0)
    if len(bad):
        row = bad[0] + 1
        raise MapError(f"{path}: column {clock.column!r}, row {row}: the clock does not advance")
    return t


def _clock(part: dict[str, np.ndarray], path: Path, column_map: ColumnMap) -> np.ndarray:
    if "t" in part:
        return part["t"]
    n = len(next(iter(part.values())))
    if column_map.rate_hz is not None:
        return np.arange(n) / column_map.rate_hz
    if column_map.mode == "static":
        return np.arange(n) / _POSES_PER_SECOND
    raise MapError(f"{path}: a motion without a clock needs rate_hz in [recording]")


def _beside(
    part: dict[str, np.ndarray], path: Path, rows: int, first: Path
) -> dict[str, np.ndarray]:
    """Columns of a file without clock, row by row beside the first file's."""
    count = len(next(iter(part.values())))
    if count != rows:
        raise MapError(
            f"{path}: without a clock (t) it is laid beside {first.name} row by row, but it has "
            f"{count} rows and not {rows}"
        )
    return part


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
    given = turned(data, str(path))
    rotation = None if given is None else of_sensor(given, conventions, pose)
    if rotation is not None:
        data |= columns_of(rotation)
    if conventions.wrench_axes == "sensor":
        return data
    if conventions.wrench_axes == "base" and rotation is None:
        rotation = sensor_by_joints(data, stated, str(path))
    wrench = np.stack([data[c] for c in CHANNELS], axis=1)
    wrench = wrench_in_sensor(wrench, conventions, rotation, pose)
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


def since(t: np.ndarray, origin: np.int64 | np.float64) -> np.ndarray:
    """Seconds (N,) since an origin; times and origin are whole nanoseconds or seconds each.

    An epoch time in µs has 16 digits; a float of seconds would lose the last of them.
    """
    if t.dtype.kind == "i" and isinstance(origin, np.int64):
        return np.asarray((t - origin) / 1e9)
    seconds = t / 1e9 if t.dtype.kind == "i" else t
    start = float(origin) / 1e9 if isinstance(origin, np.int64) else float(origin)
    return np.asarray(seconds - start)


def even_clock(t: np.ndarray) -> tuple[np.ndarray, str] | None:
    """The even clock (M,) [s] nearest to a clock (N,) [s], without times in gaps, and what was done
    in words; None if the clock is even already, or too short."""
    step = np.diff(t)
    if len(step) < 2:
        return None
    usual = float(np.median(step))
    # mean step of rows that follow each other: less than a frame is lost between them
    h = float(step[(step > 0.5 * usual) & (step < 1.5 * usual)].mean())
    if np.abs(step - h).max() <= JITTER * h:
        return None
    breaks = np.flatnonzero(step > _GAP * usual)
    parts = []
    for begin, end in zip([0, *(breaks + 1)], [*breaks, len(t) - 1], strict=True):
        first = np.ceil((t[begin] - t[0]) / h - 1e-6)
        last = np.floor((t[end] - t[0]) / h + 1e-6)
        parts.append(t[0] + h * np.arange(first, last + 1))
    inside = step[step <= _GAP * usual]
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
        quaternion = turned.as_quat(canonical=True, scalar_first=True)
        columns |= dict(zip(QUATERNION, quaternion.T, strict=True))
    nearest = np.searchsorted((old[1:] + old[:-1]) / 2.0, t, side="right")
    for name, values in data.items():
        if name in ("t", *QUATERNION):
            continue
        whole = name in ("segment", "status") or values.dtype.kind in "iu"
        columns[name] = values[nearest] if whole else np.interp(t, old, values)
    return columns
