"""A recording: one row a sample, frozen and checked, in one Parquet file.

Whatever made it (MuJoCo, RTDE, CAN, an import), it has the same columns, SI units and sign
conventions; see ``docs/reference/nomenclature.md``.
"""

import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from wrenchbed.data import parquet
from wrenchbed.data.metadata import Metadata, parse
from wrenchbed.errors import RecordingError, WrenchbedWarning, raise_shortage
from wrenchbed.files import set_aside
from wrenchbed.physics.rotations import matrix
from wrenchbed.physics.wrench import CHANNELS

QUATERNION = ("qw", "qx", "qy", "qz")
"""Orientation of the sensor in the base, for robots without a model."""
POINT = ("px", "py", "pz")
"""Known position in the world at which the tool's tip sat; such rows are touches [m]."""
TOUCH_STD = 5e-5
"""Standard deviation of a touching tip's position per axis [m]: a ball in a socket, reached with
the repeatability of a good arm (UR5e's data sheet: 0.03 mm)."""
EFFORT_UNITS = {"tau": "N·m", "i": "A"}
"""Column prefixes of joint torques and of motor currents, with their units."""
JOURNAL = ".journal"
"""Suffix of the journal beside a recording while it is written."""


@dataclass(frozen=True, eq=False)
class Recording:
    """Columns (N,) by name with checked metadata.

    Attributes:
        metadata: what is stated about robot, tool and sensor.
        columns: read-only arrays, SI units; unknown columns are kept. Arrays that
            nobody can write are taken as they are, others are copied.
        name: file name for messages.
    """

    metadata: Metadata
    columns: Mapping[str, np.ndarray]
    name: str = "recording"

    def __post_init__(self) -> None:
        frozen = {k: _frozen(v) for k, v in self.columns.items()}
        object.__setattr__(self, "columns", frozen)
        _check(self)

    def __len__(self) -> int:
        return len(self.columns["t"])

    @property
    def t(self) -> np.ndarray:
        """Time from the start (N,) [s]."""
        return self.columns["t"]

    @property
    def wrench(self) -> np.ndarray:
        """Measured load on the sensor (N, 6) [N, N·m].

        Raises:
            RecordingError: the recording has joint torques or currents alone.
        """
        self.require_wrench()
        return np.stack([self.columns[c] for c in CHANNELS], axis=-1)

    @property
    def has_wrench(self) -> bool:
        """Whether there is a wrench; otherwise there are joint torques or currents."""
        return CHANNELS[0] in self.columns

    def require_wrench(self) -> None:
        """Refuse a recording of joint efforts alone.

        Raises:
            RecordingError: it has no wrench.
        """
        if not self.has_wrench:
            raise RecordingError(
                f"{self.name}: has no wrench fx … tz, only the effort of its joints: this needs "
                "a force/torque sensor"
            )

    @property
    def effort(self) -> str | None:
        """Prefix of the effort columns, ``tau`` [N·m] or ``i`` [A], torques first; else None."""
        return effort_prefix(self.columns)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joint columns q1…qJ, empty for a recording with orientations."""
        return joint_columns(self.columns)

    @property
    def q(self) -> np.ndarray:
        """Joint values (N, J) [rad or m], or the sensor's orientation w, x, y, z (N, 4)."""
        names = self.joints or QUATERNION
        return np.stack([self.columns[c] for c in names], axis=-1)

    def parts_of_q(self) -> Iterator[np.ndarray]:
        """Yield `q` for some rows at a time (n, J), as all of `q` would be half a large
        recording."""
        columns = [self.columns[c] for c in self.joints or QUATERNION]
        for first in range(0, len(self), parquet.ROWS_AT_ONCE):
            yield np.stack([c[first : first + parquet.ROWS_AT_ONCE] for c in columns], axis=-1)

    @property
    def rotation(self) -> np.ndarray:
        """R_base_sensor (N, 3, 3) of a recording with orientations."""
        return matrix(self.q)

    @classmethod
    def read(cls, path: str | Path) -> "Recording":
        """Read and check a file; a journal beside it (a writer that was killed) is read with it.

        Raises:
            RecordingError: names the file, the field or column, and the row.
        """
        path = Path(path)
        if path.is_dir():
            raise RecordingError(f"{path}: is a folder, not a recording")
        journal = path.with_name(path.name + JOURNAL)
        if journal.exists():
            table = _from_journal(journal, path)
            warnings.warn(
                f"{path}: the writer did not finish; {table.num_rows} rows come from its journal",
                WrenchbedWarning,
                stacklevel=2,
            )
            raw = parquet.metadata_of(table.schema, path, RecordingError)
            data = parquet.columns(table, path, RecordingError)
        else:
            data, raw = parquet.read(path, RecordingError)
        return cls(parse(raw, str(path)), data, str(path))

    def write(self, path: str | Path) -> None:
        """Write the file; the journal of a killed writer there is kept as ``…~``."""
        path = Path(path)
        parquet.write(path, parquet.table_of(self.columns, self.metadata.to_json()))
        set_aside(path.with_name(path.name + JOURNAL))


def _frozen(array: np.ndarray) -> np.ndarray:
    """Return the array itself if nobody can write to its memory, else a read-only copy."""
    seen: object = array
    while isinstance(seen, np.ndarray) and not seen.flags.writeable:
        seen = seen.base
    if isinstance(array, np.ndarray) and not isinstance(seen, np.ndarray):
        return array
    array = np.array(array)
    array.flags.writeable = False
    return array


def joint_columns(columns: Mapping[str, Any]) -> tuple[str, ...]:
    """Find the joint columns q1…qJ; a gap in their numbers ends them."""
    names: list[str] = []
    while f"q{len(names) + 1}" in columns:
        names.append(f"q{len(names) + 1}")
    return tuple(names)


def effort_prefix(columns: Mapping[str, Any]) -> str | None:
    """``tau`` or ``i`` of columns that have this for each joint, torques first."""
    joints = range(1, len(joint_columns(columns)) + 1)
    for prefix in EFFORT_UNITS:
        if joints and all(f"{prefix}{j}" in columns for j in joints):
            return prefix
    return None


def holds_readings(columns: Mapping[str, Any]) -> bool:
    """Whether columns hold a wrench or joint efforts, as a recording's do and a plan's do not."""
    return CHANNELS[0] in columns or effort_prefix(columns) is not None


def _from_journal(path: Path, recording: Path) -> pa.Table:
    """All complete batches of an Arrow stream whose end may be missing."""
    batches: list[pa.RecordBatch] = []
    try:
        with pa.ipc.open_stream(path.read_bytes()) as reader:
            schema = reader.schema
            while True:
                batches.append(reader.read_next_batch())
    except StopIteration:
        pass
    except (pa.ArrowException, OSError) as cause:
        raise_shortage(cause, path)
        if not batches:
            beside = f"to read {recording} without it" if recording.exists() else "and record anew"
            raise RecordingError(
                f"{path}: the journal is damaged or holds no complete second: delete or rename "
                f"it {beside}"
            ) from cause
    return pa.Table.from_batches(batches, schema)


def _check(recording: Recording) -> None:
    name, columns = recording.name, recording.columns
    wrench = CHANNELS if {*CHANNELS} & set(columns) or effort_prefix(columns) is None else ()
    missing = [c for c in ("t", *wrench) if c not in columns]
    if missing:
        bare = "q1" in columns and not {"t", "fx"} & set(columns)
        plan = "; this looks like a plan: record it first" if bare else ""
        raise RecordingError(
            f"{name}: column {missing[0]!r} is missing; found {', '.join(columns)}{plan}"
        )
    joints = joint_columns(columns)
    oriented = [c for c in QUATERNION if c in columns]
    if not joints and len(oriented) != 4:
        raise RecordingError(f"{name}: neither joint columns q1… nor the orientation qw qx qy qz")
    rows = len(columns["t"])
    if rows == 0:
        raise RecordingError(f"{name}: the recording has 0 rows")
    point = [c for c in POINT if c in columns]
    if point and len(point) != 3:
        raise RecordingError(f"{name}: {', '.join(point)} without the rest of px py pz")
    numeric = ("t", *wrench, *_effort(columns), *joints, *oriented, *point)
    for column, array in columns.items():
        if array.shape != (rows,):
            raise RecordingError(
                f"{name}: column {column!r} has shape {array.shape}, not ({rows},)"
            )
        if array.dtype.kind == "f":
            _first_bad(name, column, ~np.isfinite(array), array, "is not a finite number")
        elif array.dtype.kind not in "iu" and column in numeric:
            raise RecordingError(f"{name}: column {column!r} holds {array.dtype}, not numbers")
    t = columns["t"].astype(float, copy=False)
    late = np.concatenate([[False], t[1:] <= t[:-1]])
    _first_bad(name, "t", late, columns["t"], "does not come after the row before it")
    for column in ("segment", "status"):
        if column in columns and columns[column].dtype.kind not in "iu":
            raise RecordingError(f"{name}: column {column!r} must hold whole numbers")
    if not joints:
        norm = np.sqrt(sum(columns[c].astype(float) ** 2 for c in QUATERNION))
        bad = np.abs(norm - 1.0) > 1e-3
        _first_bad(name, "qw qx qy qz", bad, norm, "is not the length of a unit quaternion")


def _effort(columns: Mapping[str, np.ndarray]) -> tuple[str, ...]:
    prefix, joints = effort_prefix(columns), joint_columns(columns)
    return tuple(f"{prefix}{j + 1}" for j in range(len(joints))) if prefix else ()


def _first_bad(name: str, column: str, bad: np.ndarray, array: np.ndarray, complaint: str) -> None:
    if bad.any():
        row = int(np.flatnonzero(bad)[0])
        more = f" ({int(bad.sum())} such rows)" if bad.sum() > 1 else ""
        value = array[row]
        raise RecordingError(f"{name}: column {column!r}, row {row}: {value} {complaint}{more}")
