"""A recording: one row a sample, frozen and checked, in one Parquet file.

Whatever made it (MuJoCo, RTDE, CAN, an import), it has the same columns, SI units and sign
conventions; see ``docs/reference/nomenclature.md``.
"""

import warnings
from collections.abc import Collection, Container, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from itertools import chain
from pathlib import Path
from string import digits

import numpy as np
import pyarrow as pa

from wrenchbed.data import parquet
from wrenchbed.data.metadata import UNIT_LENGTH, Metadata, parse
from wrenchbed.errors import RecordingError, WrenchbedWarning, raise_shortage
from wrenchbed.files import set_aside
from wrenchbed.physics.rotations import matrix
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.registry import load, names

QUATERNION = ("qw", "qx", "qy", "qz")
"""Columns of the sensor's orientation in the base, for robots without a model."""
POINT = ("px", "py", "pz")
"""Columns of a known point in the world [m] that the tool's tip touched; such rows are touches."""
TOUCH_STD = 5e-5
"""Standard deviation of a touching tip's position per axis [m]: a ball in a socket, reached with
the repeatability of a good arm (UR5e's data sheet: 0.03 mm)."""
TARGET = ("mx", "my", "mz")
"""Columns of the position [m] of a target on the flange in a tracker's axes."""
ACCELERATION = ("ax", "ay", "az")
"""Columns of an accelerometer [m/s²] in sensor axes: at rest it reads minus gravity."""
EFFORT_UNITS = {"tau": "N·m", "i": "A"}
"""Column prefixes of joint torques and of motor currents, with their units."""
COMMAND = "q_target"
"""Column prefix of joint targets."""
_OF_PLANS = frozenset(("t", "segment", "dwell", "status", "temperature", *QUATERNION, *POINT))
"""Columns beside joint values that a file without readings may have."""
_BY_JOINT = frozenset(("q", "qd", COMMAND, *EFFORT_UNITS, "joint_temperature"))
"""Prefixes of columns that are numbered by joint."""
_LARGEST = 1e30
"""Largest value of a column in any unit: beyond nanoseconds since 1970; larger squares overflow."""

JOURNAL = ".journal"
"""Suffix of the journal beside a recording while it is written."""


@dataclass(frozen=True, eq=False)
class Recording:
    """A recording: columns (N,) by name, with checked metadata.

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
        for complaint in chain(_wrong_columns(frozen), _wrong_values(frozen)):
            raise RecordingError(f"{self.name}: {complaint}")

    def __len__(self) -> int:
        return len(self.columns["t"])

    @property
    def t(self) -> np.ndarray:
        """Time of each row since the start (N,) [s]."""
        return self.columns["t"]

    @property
    def wrench(self) -> np.ndarray:
        """Measured load on the sensor (N, 6) [N, N·m]; a `RecordingError` if there is none."""
        self.require_wrench()
        return np.stack([self.columns[c] for c in CHANNELS], axis=-1)

    @property
    def has_wrench(self) -> bool:
        """Whether the recording has a wrench, not only joint efforts or target positions."""
        return CHANNELS[0] in self.columns

    @property
    def only_commanded(self) -> bool:
        """Whether the recording holds joint targets and values, but no readings of a sensor."""
        other = self.has_wrench or self.effort is not None or holds_channel(self.columns)
        return not other and commanded(self.columns)

    def require_wrench(self) -> None:
        """Raise `RecordingError` if there is no wrench, only joint efforts or target positions."""
        if not self.has_wrench:
            held = "the places of a target" if TARGET[0] in self.columns else "other sensors"
            held = held if self.effort is None else "the effort of its joints"
            held = "what its joints were told" if self.only_commanded else held
            raise RecordingError(
                f"{self.name}: has no wrench fx … tz, only {held}: this needs a force/torque sensor"
            )

    def without_wrench(self) -> "Recording":
        """Return the recording without its wrench columns."""
        kept = {name: column for name, column in self.columns.items() if name not in CHANNELS}
        return replace(self, columns=kept)

    @property
    def effort(self) -> str | None:
        """Prefix of the joint effort columns, ``tau`` [N·m] before ``i`` [A]; None without any."""
        return effort_prefix(self.columns)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joint columns q1…qJ; empty for a recording with orientations."""
        return joint_columns(self.columns)

    @property
    def q(self) -> np.ndarray:
        """Joint values (N, J) [rad or m], or the sensor's orientation w, x, y, z (N, 4)."""
        names = self.joints or QUATERNION
        return np.stack([self.columns[c] for c in names], axis=-1)

    def parts_of_q(self) -> Iterator[np.ndarray]:
        """Yield `q` in parts (n, J) of some rows: all at once would be half a large recording."""
        columns = [self.columns[c] for c in self.joints or QUATERNION]
        for first in range(0, len(self), parquet.ROWS_AT_ONCE):
            yield np.stack([c[first : first + parquet.ROWS_AT_ONCE] for c in columns], axis=-1)

    @property
    def rotation(self) -> np.ndarray:
        """Sensor rotations R_base_sensor (N, 3, 3) of a recording with orientations."""
        return matrix(self.q)

    @classmethod
    def read(cls, path: str | Path) -> "Recording":
        """Read and check a recording from its file, with rows in the journal of a killed writer; a
        `RecordingError` names the file, the field or column, and the row."""
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
        """Write the recording to a file; a killed writer's journal there is renamed to ``…~``."""
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


def joint_columns(columns: Container[str]) -> tuple[str, ...]:
    """Names of the joint columns q1…qJ that are in ``columns``, up to the first gap in numbers."""
    names: list[str] = []
    while f"q{len(names) + 1}" in columns:
        names.append(f"q{len(names) + 1}")
    return tuple(names)


def effort_prefix(columns: Container[str]) -> str | None:
    """Prefix ``tau``, else ``i``, that columns have for every joint; None without either."""
    return next((prefix for prefix in EFFORT_UNITS if _of_joints(prefix, columns)), None)


def commanded(columns: Container[str]) -> bool:
    """Whether columns hold the target of every joint."""
    return _of_joints(COMMAND, columns)


def _of_joints(prefix: str, columns: Container[str]) -> bool:
    joints = joint_columns(columns)
    return bool(joints) and all(f"{prefix}{name[1:]}" in columns for name in joints)


def holds_readings(columns: Collection[str]) -> bool:
    """Whether columns hold readings of some sensor, which distinguishes a recording from a plan."""
    each = (CHANNELS[0], TARGET[0], ACCELERATION[0])
    read = any(column in columns for column in each) or commanded(columns)
    return read or effort_prefix(columns) is not None or holds_channel(columns)


def holds_channel(columns: Collection[str]) -> bool:
    """Whether columns hold all those of a channel, plug-ins included, that has none for joints."""
    others = {c for c in columns if c not in _OF_PLANS and c.rstrip(digits) not in _BY_JOINT}
    return bool(others) and any(
        others >= {*load("channels", name).columns} for name in names("channels")
    )


@cache
def channel_units() -> Mapping[str, str]:
    """Unit of each column of every channel, plug-ins included."""
    return {k: unit for n in names("channels") for k, unit in load("channels", n).columns.items()}


def _from_journal(path: Path, recording: Path) -> pa.Table:
    """Read a writer's journal, an Arrow stream that may lack its end, beside ``recording``."""
    batches: list[pa.RecordBatch] = []
    try:
        with pa.ipc.open_stream(path.read_bytes()) as reader:
            schema = reader.schema
            for batch in reader:
                batches.append(batch)
    except (pa.ArrowException, OSError) as cause:
        raise_shortage(cause, path)
        if not batches:
            beside = f"to read {recording} without it" if recording.exists() else "and record anew"
            raise RecordingError(
                f"{path}: the journal is damaged or holds no complete second: delete or rename "
                f"it {beside}"
            ) from cause
    return pa.Table.from_batches(batches, schema)


def _wrong_columns(columns: Mapping[str, np.ndarray]) -> Iterator[str]:
    """Yield a sentence for each problem of missing columns."""
    wrench = CHANNELS if {*CHANNELS} & set(columns) or not holds_readings(columns) else ()
    missing = [c for c in ("t", *wrench) if c not in columns]
    oriented, point = ([c for c in some if c in columns] for some in (QUATERNION, POINT))
    target = [c for c in TARGET if c in columns]
    if missing:
        bare = "q1" in columns and not {"t", "fx"} & set(columns)
        plan = "; this looks like a plan: record it first" if bare else ""
        yield f"column {missing[0]!r} is missing; found {', '.join(columns)}{plan}"
    if not joint_columns(columns) and len(oriented) != 4:
        yield "neither joint columns q1… nor the orientation qw qx qy qz"
    if len(columns["t"]) == 0:
        yield "the recording has 0 rows"
    if point and len(point) != 3:
        yield f"{', '.join(point)} without the rest of px py pz"
    if not wrench and len(target) not in (0, 3):
        yield f"{', '.join(target)} without the rest of mx my mz"


def _wrong_values(columns: Mapping[str, np.ndarray]) -> Iterator[str]:
    """Yield a sentence for each column of a wrong type or with a wrong value, naming the row."""
    rows, joints, prefix = len(columns["t"]), joint_columns(columns), effort_prefix(columns)
    efforts = [f"{prefix}{j + 1}" for j in range(len(joints))]
    targets = [f"{COMMAND}{j + 1}" for j in range(len(joints))]
    numeric = {"t", *CHANNELS, *efforts, *targets, *joints, *QUATERNION, *POINT}
    for column, array in columns.items():
        kind = array.dtype.kind
        if array.shape != (rows,):
            yield f"column {column!r} has shape {array.shape}, not ({rows},)"
        if kind not in "iu" and column in ("segment", "status"):
            yield f"column {column!r} must hold whole numbers"
        if kind == "f":
            yield from _bad_rows(column, ~np.isfinite(array), array, "is not a finite number")
            large = np.isfinite(array) & (np.abs(array, dtype=float) > _LARGEST)
            yield from _bad_rows(column, large, array, "is larger than any reading")
        elif kind not in "iu" and (column in numeric or column in channel_units()):
            yield f"column {column!r} holds {array.dtype}, not numbers"
    t = columns["t"].astype(float, copy=False)
    late = np.concatenate([[False], t[1:] <= t[:-1]])
    yield from _bad_rows("t", late, columns["t"], "does not come after the row before it")
    if not joints:
        norm = np.sqrt(sum(columns[c].astype(float) ** 2 for c in QUATERNION))
        why = "is not the length of a unit quaternion"
        yield from _bad_rows("qw qx qy qz", np.abs(norm - 1.0) > UNIT_LENGTH, norm, why)


def _bad_rows(column: str, bad: np.ndarray, values: np.ndarray, why: str) -> Iterator[str]:
    if bad.any():
        row, count = int(np.argmax(bad)), int(bad.sum())
        more = f" ({count} such rows)" if count > 1 else ""
        yield f"column {column!r}, row {row}: {values[row]} {why}{more}"
