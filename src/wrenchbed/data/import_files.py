"""Bring CSV files and robots' logs in: columns mapped, units converted, clocks merged.

The first file of the map sets the rows. Columns of other files are interpolated to its times,
orientations along the shortest rotation (slerp), and rows outside any file's time are left out.
"""

import fnmatch
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pcsv
from scipy.spatial.transform import Rotation, Slerp

from wrenchbed.data.column_map import ROTATION, ColumnMap, FileMap
from wrenchbed.data.logs import is_log
from wrenchbed.data.logs import table as log_table
from wrenchbed.data.recording import QUATERNION, Recording
from wrenchbed.errors import MapError
from wrenchbed.physics.rotations import quaternion

_ORTHONORMAL = 1e-3
"""Largest |RᵀR − I| of a rotation matrix; printed with four digits it is about 1e-4."""
_POSES_PER_SECOND = 1.0


@dataclass(frozen=True, eq=False)
class Imported:
    """A recording, and what was left out: rows outside the other files' times."""

    recording: Recording
    left_out: int


def import_files(files: Sequence[str | Path], column_map: ColumnMap) -> Imported:
    """Read files by a map.

    Raises:
        MapError: a file that the map does not know, a missing column, a value that is no number,
            a clock that does not advance, or files whose times do not overlap.
        RecordingError: the result is no valid recording.
    """
    paths = [Path(f) for f in files]
    tables = [(_matching(m, paths, column_map.name), m) for m in column_map.files]
    used = {p for p, _ in tables}
    for path in paths:
        if path not in used:
            raise MapError(f"{path}: no [[file]] of {column_map.name} matches this file")
    parts = [_columns(path, m) for path, m in tables]
    first = parts[0] | {"t": _clock(parts[0], tables[0][0], column_map)}
    t = _since(first["t"], first["t"][0])
    data = {k: v for k, v in first.items() if k != "t"}
    inside = np.ones(len(t), dtype=bool)
    for part, (path, _) in zip(parts[1:], tables[1:], strict=True):
        if "t" not in part:
            raise MapError(f"{path}: needs a clock (t) to be merged with {tables[0][0].name}")
        part["t"] = _since(part["t"], first["t"][0])
        inside &= (t >= part["t"][0]) & (t <= part["t"][-1])
        data |= _resampled(part, t, path)
    if not inside.any():
        raise MapError(f"{column_map.name}: the files' times do not overlap")
    data = {k: v[inside] for k, v in data.items()}
    left_out = int((~inside).sum())
    t = t[inside]
    columns = {"t": t - t[0]} | {k: v for k, v in data.items() if k not in ROTATION}
    for name in ("segment", "status"):
        if name in columns:
            columns[name] = columns[name].astype(np.int64)
    return Imported(Recording(column_map.metadata, columns, str(paths[0])), left_out)


def _matching(file_map: FileMap, paths: list[Path], name: str) -> Path:
    hits = [p for p in paths if fnmatch.fnmatch(p.name, file_map.match)]
    if len(hits) != 1:
        found = ", ".join(p.name for p in hits) or "none"
        raise MapError(
            f"{name}: match = {file_map.match!r} must fit one of the files, found {found}"
        )
    return hits[0]


def _columns(path: Path, file_map: FileMap) -> dict[str, np.ndarray]:
    table = _table(path, file_map)
    if table.num_rows == 0:
        raise MapError(f"{path}: the file has 0 rows")
    data: dict[str, np.ndarray] = {}
    for source in file_map.columns:
        if table.column_names.count(source.column) != 1:
            known = ", ".join(table.column_names)
            times = "appears twice" if source.column in table.column_names else "is missing"
            raise MapError(f"{path}: column {source.column!r} {times}; found {known}")
        data[source.target] = (_numbers(path, source.column, table) - source.zero) * source.factor
    if "t" in data:
        data["t"] = _times(path, table, file_map, data["t"])
    if ROTATION[0] in data:
        data |= _quaternions(path, data)
    return data


def _table(path: Path, file_map: FileMap) -> pa.Table:
    if is_log(path):
        return log_table(path, file_map.topic, [c.column for c in file_map.columns])
    try:
        return pcsv.read_csv(path, parse_options=pcsv.ParseOptions(delimiter=file_map.delimiter))
    except FileNotFoundError as error:
        raise MapError(f"{path}: there is no such file") from error
    except (pa.ArrowException, OSError) as error:
        raise MapError(f"{path}: not a CSV table: {str(error).splitlines()[0]}") from error


def _numbers(path: Path, name: str, table: pa.Table) -> np.ndarray:
    column = table.column(name)
    if not (pa.types.is_floating(column.type) or pa.types.is_integer(column.type)):
        row = next(
            (i for i, v in enumerate(column.to_pylist()) if not isinstance(v, int | float)), 0
        )
        raise MapError(f"{path}: column {name!r}, row {row}: {column[row].as_py()!r} is no number")
    values = column.to_numpy().astype(float)
    bad = np.flatnonzero(~np.isfinite(values))
    if len(bad):
        raise MapError(f"{path}: column {name!r}, row {bad[0]}: the value is missing or not finite")
    return values


def _times(path: Path, table: pa.Table, file_map: FileMap, scaled: np.ndarray) -> np.ndarray:
    """Times as the clock has them: whole nanoseconds if it counts, else seconds.

    An epoch time in µs has 16 digits; a float of seconds would lose the last of them.
    """
    clock = file_map.clock
    assert clock is not None
    raw = table.column(clock.column)
    t = scaled
    if pa.types.is_integer(raw.type):
        t = (raw.to_numpy().astype(np.int64) - round(clock.zero)) * round(clock.factor / 1e-9)
    bad = np.flatnonzero(np.diff(t) <= 0)
    if len(bad):
        row = bad[0] + 1
        raise MapError(f"{path}: column {clock.column!r}, row {row}: the clock does not advance")
    return t


def _since(t: np.ndarray, origin: "np.int64 | np.float64") -> np.ndarray:
    """Seconds (N,) since an origin of either kind of clock."""
    if t.dtype.kind == "i" and isinstance(origin, np.int64):
        return np.asarray((t - origin) / 1e9)
    seconds = t / 1e9 if t.dtype.kind == "i" else t
    start = float(origin) / 1e9 if isinstance(origin, np.int64) else float(origin)
    return np.asarray(seconds - start)


def _quaternions(path: Path, data: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    matrix = np.stack([data[r] for r in ROTATION], axis=-1).reshape(-1, 3, 3)
    error = np.abs(np.swapaxes(matrix, -1, -2) @ matrix - np.eye(3)).max(axis=(1, 2))
    bad = np.flatnonzero((error > _ORTHONORMAL) | (np.linalg.det(matrix) < 0))
    if len(bad):
        raise MapError(
            f"{path}: row {bad[0]}: r11…r33 is not a rotation (RᵀR off by {error[bad[0]]:.2g})"
        )
    q = quaternion(matrix)
    return dict(zip(QUATERNION, q.T, strict=True))


def _clock(part: dict[str, np.ndarray], path: Path, column_map: ColumnMap) -> np.ndarray:
    if "t" in part:
        return part["t"]
    n = len(next(iter(part.values())))
    if column_map.rate_hz is not None:
        return np.arange(n) / column_map.rate_hz
    if column_map.metadata.mode == "static":
        return np.arange(n) / _POSES_PER_SECOND
    raise MapError(f"{path}: a motion without a clock needs rate_hz in [recording]")


def _resampled(part: dict[str, np.ndarray], t: np.ndarray, path: Path) -> dict[str, np.ndarray]:
    data: dict[str, np.ndarray] = {}
    if QUATERNION[0] in part:
        turns = Rotation.from_quat(
            np.stack([part[c] for c in QUATERNION], axis=-1), scalar_first=True
        )
        slerp = Slerp(part["t"], turns)
        q = slerp(np.clip(t, part["t"][0], part["t"][-1])).as_quat(
            canonical=True, scalar_first=True
        )
        data |= dict(zip(QUATERNION, q.T, strict=True))
    for name, values in part.items():
        if name != "t" and name not in QUATERNION and name not in ROTATION:
            data[name] = np.interp(t, part["t"], values)
    return data
