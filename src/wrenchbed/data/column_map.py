"""A column map: which columns of which files make a recording, in which units. TOML or JSON."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from string import digits
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from wrenchbed.data.metadata import FIELDS, MODES, Metadata, SensorInfo, ToolInfo, parse
from wrenchbed.data.recording import (
    ACCELERATION,
    QUATERNION,
    TARGET,
    channel_units,
    commanded,
    effort_prefix,
    holds_channel,
)
from wrenchbed.errors import MapError, RecordingError, did_you_mean
from wrenchbed.files.checked import Fields, load
from wrenchbed.physics.wrench import CHANNELS

UNITS: dict[str, tuple[str, float]] = {
    "s": ("time", 1.0), "ms": ("time", 1e-3), "us": ("time", 1e-6), "µs": ("time", 1e-6),
    "ns": ("time", 1e-9),
    "rad": ("angle", 1.0), "deg": ("angle", 0.017453292519943295),
    "rad/s": ("angular velocity", 1.0), "deg/s": ("angular velocity", 0.017453292519943295),
    "m": ("length", 1.0), "mm": ("length", 1e-3),
    "N": ("force", 1.0), "kN": ("force", 1e3), "lbf": ("force", 4.4482216152605),
    "mN": ("force", 1e-3), "kgf": ("force", 9.80665), "gf": ("force", 9.80665e-3),
    "N·m": ("torque", 1.0), "Nm": ("torque", 1.0), "N.m": ("torque", 1.0), "N*m": ("torque", 1.0),
    "N·cm": ("torque", 1e-2), "Nmm": ("torque", 1e-3), "N·mm": ("torque", 1e-3),
    "mN·m": ("torque", 1e-3), "mNm": ("torque", 1e-3), "lbf·in": ("torque", 0.1129848290276167),
    "lbf-in": ("torque", 0.1129848290276167), "lbf·ft": ("torque", 1.3558179483314004),
    "kgf·m": ("torque", 9.80665), "kgf·cm": ("torque", 9.80665e-2),
    "kgf·mm": ("torque", 9.80665e-3), "gf·cm": ("torque", 9.80665e-5),
    "m/s²": ("acceleration", 1.0), "m/s^2": ("acceleration", 1.0), "g": ("acceleration", 9.80665),
    "°C": ("temperature", 1.0), "degC": ("temperature", 1.0),
    "A": ("current", 1.0), "mA": ("current", 1e-3),
    "1": ("number", 1.0),
}  # fmt: skip
"""Unit → the quantity that it measures, and its size in the SI unit."""

AUTO = "auto"
"""Mode of a log of holds (rests at a pose) and moves, whose rows are classified automatically."""
TOLERANCES = ("tool.mass", "tool.cog", "sensor.bias")
_FILE = ("match", "topic", "delimiter", "skip_incomplete", "columns")
_COLUMN = ("column", "unit", "sign", "zero", "per", "nanoseconds")
_UNIT_SQUARE = 2e-3
"""Largest error of a unit quaternion's square: four digits are enough."""
ORTHONORMAL = 1e-3
"""Largest |RᵀR − I| of a rotation matrix; printed with four digits it is about 1e-4."""
UNIT = 1e-2
"""Largest error of a quaternion's length: two digits are enough to see that it is one."""
ROTATION = tuple(f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3))
"""Elements of R_base_sensor in row order, for a map that gives a rotation matrix."""
ROTATION_VECTOR = ("rx", "ry", "rz")
"""Rotation vector of the sensor in the base, as a UR writes its tool's."""
ROLL_PITCH_YAW = ("roll", "pitch", "yaw")
"""R = Rz(yaw) Ry(pitch) Rx(roll): ROS's angles, and KUKA's C, B, A."""
ANGLES = (ROTATION_VECTOR, ROLL_PITCH_YAW)
_MOST_TURN = 4.0 * np.pi
"""Largest angle of an orientation [rad]: a rotation vector that turns on is hardly longer."""
_ORIENTATIONS = (QUATERNION, ROTATION, *ANGLES)
_FIXED = {
    "t": "time", "temperature": "temperature", "ax": "acceleration", "ay": "acceleration",
    "az": "acceleration", **dict.fromkeys(CHANNELS[:3], "force"),
    **dict.fromkeys(CHANNELS[3:], "torque"), **dict.fromkeys(ROTATION, "number"),
    **dict.fromkeys((*QUATERNION, "segment", "status"), "number"),
    **dict.fromkeys((name for three in ANGLES for name in three), "angle"),
    **dict.fromkeys(TARGET, "length"),
}  # fmt: skip
_JOINT = {"q": ("angle", "length"), "qd": ("angular velocity",), "q_target": ("angle", "length"),
          "tau": ("torque", "force"), "i": ("current",)}  # fmt: skip


@dataclass(frozen=True)
class Source:
    """Source of a recording's column ``target``: (file's ``column`` / ``per`` − ``zero``) ·
    ``sign`` in ``unit``, a word of `UNITS`, converted to SI. A clock of two columns has the
    fractions of its seconds in the column ``nanoseconds``."""

    target: str
    column: str
    unit: str
    sign: float
    zero: float = 0.0
    per: float = 1.0
    nanoseconds: str | None = None

    @property
    def factor(self) -> float:
        return UNITS[self.unit][1] * self.sign


@dataclass(frozen=True)
class FileMap:
    """Columns that are read from the file whose name matches the glob pattern ``match``.

    Attributes:
        topic: topic of a log, whose messages' fields are its columns.
        delimiter: separator of a text file; detected if None.
        skip_incomplete: whether rows that lack a value are left out; else they are refused.
    """

    match: str
    columns: tuple[Source, ...]
    topic: str | None = None
    delimiter: str | None = None
    skip_incomplete: bool = False


@dataclass(frozen=True)
class Conventions:
    """Axes in which a file states wrench and orientation.

    Attributes:
        wrench_axes: ``sensor``, ``flange`` (torque about the flange's origin) or ``base``.
        about: point that the torque is about, in sensor axes from the sensor's origin [m].
        of: whose orientation is given, ``sensor`` or ``flange``.
        inverse: whether the file has the base's orientation in the sensor or flange (a conjugate).
        constant: orientation w x y z of a sensor that is never turned.
    """

    wrench_axes: str = "sensor"
    about: tuple[float, ...] = (0.0, 0.0, 0.0)
    of: str = "sensor"
    inverse: bool = False
    constant: tuple[float, ...] | None = None


@dataclass(frozen=True)
class ColumnMap:
    """Column map of an import: its files, of which the first sets the rows.

    ``mode`` is ``static``, ``dynamic`` or ``auto``, which detects holds (rests) and moves;
    ``rate_hz`` is the rate of rows [Hz], needed by motions without a clock; ``name`` is for
    messages.
    """

    files: tuple[FileMap, ...]
    metadata: Metadata
    rate_hz: float | None
    name: str
    conventions: Conventions = field(default_factory=Conventions)
    mode: str = "static"

    @property
    def angles(self) -> set[str]:
        """Names of the joint columns whose values are angles."""
        every = (c for f in self.files for c in f.columns if UNITS[c.unit][0] == "angle")
        return {c.target for c in every if c.target[1:].isdecimal()}

    @property
    def by_accelerometer(self) -> bool:
        """Whether an accelerometer is the only source of the sensor's orientation."""
        targets = {c.target for f in self.files for c in f.columns}
        turns = {name for kind in _ORIENTATIONS for name in kind} | {"q1"}
        known = targets & turns or self.conventions.constant is not None
        return targets >= {*CHANNELS, *ACCELERATION} and not known


def ready() -> dict[str, Path]:
    """Name → path of the column maps that ship with wrenchbed."""
    folder = Path(str(files("wrenchbed.data"))) / "maps"
    return {p.stem: p for p in sorted(folder.glob("*.toml"))}


def read(path: str | Path) -> ColumnMap:
    """Read and check a column map, from a file or by the name of one of `ready`. A `MapError` names
    the file, the entry and what it should say."""
    path = ready().get(str(path), Path(path))
    try:
        raw = load(path, MapError, "TOML")
    except MapError as error:
        if path.exists():
            raise
        raise MapError(f"{error}; ready maps: {', '.join(ready())}") from error
    return from_fields(Fields(raw, f"{path}: ", MapError), str(path), path.parent)


def from_fields(raw: Fields, name: str, folder: Path) -> ColumnMap:
    """Make a checked column map from the fields of its file; ``name`` begins errors, and robot and
    sensor files are relative to ``folder``.

    Raises:
        MapError: names the entry and what it should say.
        NotFoundError, ParameterError: a robot's or sensor's file cannot be read.
    """
    raw.only({"recording", "file", "wrench", "orientation"}, "a map")
    mode, metadata = stated_recording(raw.part("recording"), name, folder)
    entries = raw.raw.get("file")
    if not isinstance(entries, list) or not entries:
        raise MapError(f'{name}: needs at least one [[file]] with match = "*.csv" and columns')
    files = tuple(_file(f"{name}: [[file]] {k}: ", x) for k, x in enumerate(entries, start=1))
    conventions = _conventions(raw, metadata)
    try:
        _check_targets([c for f in files for c in f.columns], conventions)
    except MapError as error:
        raise MapError(f"{name}: {error}") from None
    return ColumnMap(files, metadata, metadata.rate_hz, name, conventions, mode)


def stated_recording(stated: Fields, name: str, folder: Path) -> tuple[str, Metadata]:
    """Read mode and metadata from ``stated``, a map's table ``[recording]``; errors begin with
    ``name``, and robot and sensor files are relative to ``folder``."""
    stated.only(FIELDS | {"configured"}, "[recording]")
    parts = {"tool": ToolInfo.__dataclass_fields__, "sensor": SensorInfo.__dataclass_fields__}
    for part, known in {**parts, "tolerance": TOLERANCES}.items():
        stated.part(part).only(known, f"[recording.{part}]")
    mode = stated.choice(
        "mode", (*MODES, AUTO), "must be 'static', 'dynamic' or 'auto' (holds and moves)"
    )
    raw = seen_from(stated.raw, lambda file: str(folder / file))
    raw["mode"] = "dynamic" if mode == AUTO else mode
    try:
        return mode, parse({"format": 1, "source": "import", **raw}, name)
    except RecordingError as error:
        raise MapError(str(error)) from error


def seen_from(recording: Mapping[str, Any], moved: Callable[[str], str]) -> dict[str, Any]:
    """Return a map's ``[recording]`` with paths of robot and sensor files changed by ``moved``."""

    def placed(part: Mapping[str, Any], key: str) -> dict[str, Any]:
        file = part.get(key)
        is_file = isinstance(file, str) and file.lower().endswith(".toml")
        return dict(part) | ({key: moved(str(file))} if is_file else {})

    changed, sensor = placed(recording, "robot"), recording.get("sensor")
    return changed | ({"sensor": placed(sensor, "model")} if isinstance(sensor, Mapping) else {})


def _conventions(raw: Fields, metadata: Metadata) -> Conventions:
    wrench = raw.part("wrench").only({"axes", "about"}, "[wrench]")
    turn = raw.part("orientation").only({"of", "inverse", "constant"}, "[orientation]")
    mounted = metadata.sensor.pose_flange is not None
    bodies = ("sensor", "flange")
    inverse = turn.raw.get("inverse", False)
    if not isinstance(inverse, bool):
        raise turn.error("inverse", "must be true or false")
    constant = turn.numbers("constant", 4, rule="must be a unit quaternion w, x, y, z")
    if constant is not None and abs(sum(x * x for x in constant) - 1.0) > _UNIT_SQUARE:
        raise turn.error("constant", "must be a unit quaternion w, x, y, z")
    axes = wrench.choice(
        "axes", (*bodies, "base"), "must be 'sensor', 'flange' or 'base'", default="sensor"
    )
    body = turn.choice(
        "of", bodies, "must be 'sensor' or 'flange'", default="flange" if mounted else "sensor"
    )
    for asks, key, of in ((turn, "of", body), (wrench, "axes", axes)):
        if of == "flange" and not mounted:
            raise asks.error(key, "needs recording.sensor.pose_flange = [x, y, z, qw, qx, qy, qz]")
    about = wrench.numbers("about", 3, rule="must be a point x, y, z [m] in sensor axes")
    return Conventions(axes, tuple(about or (0.0, 0.0, 0.0)), body, inverse, constant)


def _file(where: str, entry: Any) -> FileMap:
    fields = Fields(entry, where, MapError).only(_FILE, "a [[file]]")
    columns = fields.part("columns")
    if not columns.raw:
        raise MapError(f'{where}needs columns = {{ fx = {{ column = "Fx", unit = "N" }}, … }}')
    delimiter = fields.text("delimiter", "must be one character")
    if delimiter is not None and len(delimiter) != 1:
        raise fields.error("delimiter", "must be one character")
    skip = fields.raw.get("skip_incomplete", False)
    if not isinstance(skip, bool):
        raise fields.error("skip_incomplete", "must be true or false")
    return FileMap(
        fields.text("match", "must be a file name or pattern") or "*",
        tuple(_source(where, target, entry) for target, entry in columns.raw.items()),
        fields.text("topic", "must be the name of one"),
        delimiter,
        skip,
    )


def _source(where: str, target: str, entry: Any) -> Source:
    stem = target.rstrip(digits)
    quantities = _JOINT.get(stem, ()) if stem != target else ()
    if target in _FIXED:
        quantities = (_FIXED[target],)
    elif not quantities and target in channel_units():
        quantities = (UNITS[channel_units()[target]][0],)
    if not quantities:
        more = (c for c in channel_units() if c not in _FIXED and c.rstrip(digits) not in _JOINT)
        known = ", ".join((
            "t, fx…tz, q1…, tau1…, i1…, qd1…, q_target1…, qw qx qy qz, r11…r33, rx ry rz, "
            "roll pitch yaw, ax ay az, mx my mz, temperature, segment, status", *more,
        ))  # fmt: skip
        close = did_you_mean(target, [*_FIXED, *channel_units()])
        raise MapError(
            f"{where}{target!r} is no column of a recording{close or ';'} known: {known}"
        )
    column = entry.get("column") if isinstance(entry, Mapping) else None
    if isinstance(column, int) and not isinstance(column, bool):
        column = str(column)
    if not isinstance(column, str):
        raise MapError(f'{where}{target} needs a table with column = "…" and unit = "…"')
    fields = Fields(entry, where, MapError, target).only(_COLUMN, "a column")
    unit = entry.get("unit", "1" if quantities == ("number",) else None)
    units = [u for u, (quantity, _) in UNITS.items() if quantity in quantities]
    if unit is None:
        raise MapError(f"{where}{target} states no unit; one of {', '.join(units)}")
    if unit not in units:
        known = f"{' or '.join(quantities)}; one of {', '.join(units)}"
        raise MapError(f"{where}{target} in {unit!r} is no unit of {known}")
    sign = entry.get("sign", 1)
    if sign not in (1, -1):
        raise fields.error("sign", "must be 1 or -1")
    zero = fields.number("zero", unit) or 0.0
    per = fields.number("per", f"per {unit}", positive=True) or 1.0
    parts = fields.text("nanoseconds", "must be the name of a column")
    if parts is not None and target != "t":
        raise fields.error("nanoseconds", "belongs to t")
    return Source(target, column, unit, float(sign), zero, per, parts)


def _check_targets(sources: Sequence[Source], conventions: Conventions) -> None:
    """Raise `MapError` for columns that contradict each other, or do not make a recording."""
    units: dict[str, str] = {}
    for source in sources:
        if source.target in units and source.target != "t":
            raise MapError(f"{source.target} is mapped twice")
        units[source.target] = source.unit
    for group in (CHANNELS[:3], CHANNELS[3:], ACCELERATION, TARGET):
        if len({units[t] for t in group if t in units}) > 1:
            stated = ", ".join(f"{t} in {units[t]}" for t in group if t in units)
            raise MapError(f"mixed units: {stated}; one sensor reports in one unit")
    missing = [c for c in CHANNELS if c not in units]
    other = effort_prefix(units) is not None or commanded(units)
    other |= "q1" in units and holds_channel(units)
    without = len(missing) == len(CHANNELS) and other
    if missing and not without:
        raise MapError(f"no column is mapped to {', '.join(missing)}")
    if without and conventions.wrench_axes != "sensor":
        raise MapError("[wrench] axes are stated and no column is mapped to fx … tz")
    given = [kind for kind in _ORIENTATIONS if not units.keys().isdisjoint(kind)]
    for kind in given:
        count = len(units.keys() & set(kind))
        if count < len(kind):
            what = "a rotation matrix" if kind == ROTATION else "an orientation"
            whole = f"{kind[0]}…{kind[-1]}" if kind == ROTATION else " ".join(kind)
            raise MapError(f"{what} needs all of {whole}, found {count}")
    constant = [] if conventions.constant is None else ["orientation.constant"]
    if len(given) + len(constant) > 1:
        kinds = " and ".join([*map(" ".join, given), *constant])
        raise MapError(f"one orientation is needed, found {kinds}")


def turned(data: Mapping[str, np.ndarray], where: str) -> Rotation | None:
    """Orientations (N,) from a file's orientation columns, angles in rad; None if it has none. A
    `MapError` that names ``where`` and the row of a matrix or quaternion that is no rotation."""
    kind = next((kind for kind in _ORIENTATIONS if kind[0] in data), None)
    if kind is None:
        return None
    values = np.stack([data[c] for c in kind], axis=-1)
    if kind in ANGLES and (largest := float(np.abs(values).max(initial=0.0))) > _MOST_TURN:
        raise MapError(
            f"{where}: {' '.join(kind)} reach {largest:.4g} rad: are they in degrees? State their "
            'unit as "deg"'
        )
    if kind == ROTATION_VECTOR:
        return Rotation.from_rotvec(values)
    if kind == ROLL_PITCH_YAW:
        return Rotation.from_euler("xyz", values)
    if kind == QUATERNION:
        length = np.linalg.norm(values, axis=1)
        bad = np.flatnonzero(~(np.abs(length - 1.0) < UNIT))
        if len(bad):
            raise MapError(
                f"{where}: row {bad[0]}: qw qx qy qz has length {length[bad[0]]:.4g}, "
                "a unit quaternion has 1"
            )
        return Rotation.from_quat(values, scalar_first=True)
    matrix = values.reshape(-1, 3, 3)
    error = np.abs(np.swapaxes(matrix, -1, -2) @ matrix - np.eye(3)).max(axis=(1, 2))
    bad = np.flatnonzero((error > ORTHONORMAL) | (np.linalg.det(matrix) < 0))
    if len(bad):
        row = bad[0]
        why = "it is left-handed" if error[row] <= ORTHONORMAL else f"RᵀR off by {error[row]:.2g}"
        raise MapError(f"{where}: row {row}: r11…r33 is not a rotation ({why})")
    return Rotation.from_matrix(matrix)
