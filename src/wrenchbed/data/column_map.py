"""A column map: which columns of which files make a recording, in which units. TOML or JSON."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from wrenchbed.data.metadata import MODES, Metadata, SensorInfo, ToolInfo, parse
from wrenchbed.data.recording import QUATERNION, effort_prefix
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
    "kgf": ("force", 9.80665), "gf": ("force", 9.80665e-3),
    "N·m": ("torque", 1.0), "Nm": ("torque", 1.0), "N.m": ("torque", 1.0), "N*m": ("torque", 1.0),
    "Nmm": ("torque", 1e-3), "N·mm": ("torque", 1e-3), "lbf·in": ("torque", 0.1129848290276167),
    "lbf-in": ("torque", 0.1129848290276167), "lbf·ft": ("torque", 1.3558179483314004),
    "kgf·m": ("torque", 9.80665), "kgf·cm": ("torque", 9.80665e-2),
    "kgf·mm": ("torque", 9.80665e-3), "gf·cm": ("torque", 9.80665e-5),
    "m/s²": ("acceleration", 1.0), "m/s^2": ("acceleration", 1.0), "g": ("acceleration", 9.80665),
    "°C": ("temperature", 1.0), "degC": ("temperature", 1.0),
    "A": ("current", 1.0), "mA": ("current", 1e-3),
    "1": ("number", 1.0),
}  # fmt: skip
"""Quantity and size in SI of each unit."""

AUTO = "auto"
"""Mode of a log of holds and moves, whose rows are classified automatically."""
TOLERANCES = ("tool.mass", "tool.cog", "sensor.bias")
_FILE = ("match", "topic", "delimiter", "columns")
_COLUMN = ("column", "unit", "sign", "zero", "per")
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
_FIXED = {
    "t": "time", "temperature": "temperature", "ax": "acceleration", "ay": "acceleration",
    "az": "acceleration", **dict.fromkeys(CHANNELS[:3], "force"),
    **dict.fromkeys(CHANNELS[3:], "torque"), **dict.fromkeys(ROTATION, "number"),
    **dict.fromkeys((*QUATERNION, "segment", "status"), "number"),
    **dict.fromkeys((name for three in ANGLES for name in three), "angle"),
}  # fmt: skip
_JOINT = {"q": ("angle", "length"), "qd": ("angular velocity",), "q_target": ("angle", "length"),
          "tau": ("torque", "force"), "i": ("current",)}  # fmt: skip


@dataclass(frozen=True)
class Source:
    """Source of a column of the recording: (column / per − zero) of a file, in SI."""

    target: str
    column: str
    unit: str
    sign: float
    zero: float = 0.0
    per: float = 1.0

    @property
    def factor(self) -> float:
        return UNITS[self.unit][1] * self.sign


@dataclass(frozen=True)
class FileMap:
    """Columns from the files whose name matches ``match``; ``clock`` is the one of time.

    Attributes:
        topic: of a log, whose messages' fields are its columns.
        delimiter: of a text file; found out if none.
    """

    match: str
    columns: tuple[Source, ...]
    topic: str | None = None
    delimiter: str | None = None

    @property
    def clock(self) -> Source | None:
        return next((c for c in self.columns if c.target == "t"), None)


@dataclass(frozen=True)
class Conventions:
    """Axes in which a file gives wrench and orientation.

    Attributes:
        wrench_axes: ``sensor``, ``flange`` (torque about the flange's origin) or ``base``.
        of: whose orientation is given, ``sensor`` or ``flange``.
        inverse: whether it is that of the base in the sensor or flange (a conjugate).
        constant: orientation w x y z of a sensor that is never turned.
    """

    wrench_axes: str = "sensor"
    of: str = "sensor"
    inverse: bool = False
    constant: tuple[float, ...] | None = None


@dataclass(frozen=True)
class ColumnMap:
    """A whole map: files in order, the first sets the rows; rate of rows without a clock.

    ``mode`` is ``static``, ``dynamic`` or ``auto``: a log whose holds and moves are detected.
    """

    files: tuple[FileMap, ...]
    metadata: Metadata
    rate_hz: float | None
    name: str
    conventions: Conventions = field(default_factory=Conventions)
    mode: str = "static"


def ready() -> dict[str, Path]:
    """Paths of the maps that come with wrenchbed, by name."""
    folder = Path(str(files("wrenchbed.data"))) / "maps"
    return {p.stem: p for p in sorted(folder.glob("*.toml"))}


def read(path: str | Path) -> ColumnMap:
    """Read and check a map, a file or by the name of one of `ready`.

    Raises:
        MapError: names the file, the entry and what it should say.
    """
    path = ready().get(str(path), Path(path))
    return from_fields(_load(path), str(path), path.parent)


def from_fields(raw: Fields, name: str, folder: Path) -> ColumnMap:
    """A map from its fields, checked.

    Args:
        raw: as TOML or JSON holds them.
        name: of the map, for messages.
        folder: from which paths of a robot's or sensor's file are seen.

    Raises:
        MapError: names the entry and what it should say.
        NotFoundError, ParameterError: a robot's or sensor's file cannot be read.
    """
    mode, metadata = _recording(raw.part("recording"), name, folder)
    entries = raw.raw.get("file")
    if not isinstance(entries, list) or not entries:
        raise MapError(f'{name}: needs at least one [[file]] with match = "*.csv" and columns')
    files = tuple(_file(f"{name}: [[file]] {k}: ", x) for k, x in enumerate(entries, start=1))
    conventions = _conventions(raw, metadata)
    _consistent(name, files)
    _one_orientation(name, files, conventions)
    if conventions.wrench_axes != "sensor" and not any(
        c.target == CHANNELS[0] for f in files for c in f.columns
    ):
        raise MapError(f"{name}: [wrench] axes are stated and no column is mapped to fx … tz")
    return ColumnMap(files, metadata, metadata.rate_hz, name, conventions, mode)


def _recording(stated: Fields, name: str, folder: Path) -> tuple[str, Metadata]:
    """Mode and metadata; keys that do not exist are refused."""
    stated.only(set(Metadata.__dataclass_fields__) - {"extra"} | {"format"}, "[recording]")
    stated.part("tool").only(ToolInfo.__dataclass_fields__, "[recording.tool]")
    stated.part("sensor").only(SensorInfo.__dataclass_fields__, "[recording.sensor]")
    stated.part("tolerance").only(TOLERANCES, "[recording.tolerance]")
    mode = stated.choice(
        "mode", (*MODES, AUTO), "must be 'static', 'dynamic' or 'auto' (holds and moves)"
    )
    known = seen_from(stated.raw, lambda file: str(folder / file))
    known["mode"] = "dynamic" if mode == AUTO else mode
    try:
        return mode, parse({"format": 1, "source": "import", **known}, name)
    except RecordingError as error:
        raise MapError(str(error)) from error


def seen_from(recording: Mapping[str, Any], moved: Callable[[str], str]) -> dict[str, Any]:
    """``[recording]`` whose paths of a robot's and a sensor's file are changed by ``moved``."""

    def placed(part: Mapping[str, Any], key: str) -> dict[str, Any]:
        file = part.get(key)
        if isinstance(file, str) and file.lower().endswith(".toml"):
            return dict(part) | {key: moved(file)}
        return dict(part)

    changed, sensor = placed(recording, "robot"), recording.get("sensor")
    return changed | ({"sensor": placed(sensor, "model")} if isinstance(sensor, Mapping) else {})


def _conventions(raw: Fields, metadata: Metadata) -> Conventions:
    wrench, turn = raw.part("wrench"), raw.part("orientation")
    wrench.only({"axes"}, "[wrench]")
    turn.only({"of", "inverse", "constant"}, "[orientation]")
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
    if not mounted and (axes == "flange" or body == "flange"):
        asks = turn if body == "flange" else wrench
        raise asks.error(
            "of" if body == "flange" else "axes",
            "needs recording.sensor.pose_flange = [x, y, z, qw, qx, qy, qz]",
        )
    return Conventions(axes, body, inverse, constant)


def _one_orientation(name: str, files: tuple[FileMap, ...], conventions: Conventions) -> None:
    """Refuse an incomplete orientation, or two of them."""
    seen = {c.target for f in files for c in f.columns}
    kinds = (QUATERNION, ROTATION, *ANGLES)
    given = [kind for kind in kinds if seen & set(kind)]
    for kind in given:
        missing = [c for c in kind if c not in seen]
        if missing:
            what = "a rotation matrix" if kind == ROTATION else "an orientation"
            whole = f"{kind[0]}…{kind[-1]}" if kind == ROTATION else " ".join(kind)
            count = len(kind) - len(missing)
            raise MapError(f"{name}: {what} needs all of {whole}, found {count}")
    if len(given) + (conventions.constant is not None) > 1:
        raise MapError(
            f"{name}: one orientation is needed, found "
            + " and ".join([" ".join(k) for k in given] + ["orientation.constant"])
        )


def _load(path: Path) -> Fields:
    try:
        raw = load(path, MapError, "TOML")
    except MapError as error:
        if path.exists():
            raise
        raise MapError(f"{error}; ready maps: {', '.join(ready())}") from error
    return Fields(raw, f"{path}: ", MapError).only(
        {"recording", "file", "wrench", "orientation"}, "a map"
    )


def _file(where: str, entry: Any) -> FileMap:
    fields = Fields(entry, where, MapError).only(_FILE, "a [[file]]")
    columns = fields.part("columns")
    if not columns.raw:
        raise MapError(f'{where}needs columns = {{ fx = {{ column = "Fx", unit = "N" }}, … }}')
    delimiter = fields.text("delimiter", rule="must be one character")
    if delimiter is not None and len(delimiter) != 1:
        raise fields.error("delimiter", "must be one character")
    return FileMap(
        fields.text("match", rule="must be a file name or pattern") or "*",
        tuple(_source(where, target, entry) for target, entry in columns.raw.items()),
        fields.text("topic", rule="must be the name of one"),
        delimiter,
    )


def _source(where: str, target: str, entry: Any) -> Source:
    quantities = _quantities(target)
    if not quantities:
        known = (
            "t, fx…tz, q1…, tau1…, i1…, qd1…, q_target1…, qw qx qy qz, r11…r33, rx ry rz, "
            "roll pitch yaw, ax ay az, temperature, segment, status"
        )
        close = did_you_mean(target, _FIXED)
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
    units = ", ".join(u for u, (quantity, _) in UNITS.items() if quantity in quantities)
    if unit is None:
        raise MapError(f"{where}{target} states no unit; one of {units}")
    if not isinstance(unit, str) or unit not in UNITS or UNITS[unit][0] not in quantities:
        known = f"{' or '.join(quantities)}; one of {units}"
        raise MapError(f"{where}{target} in {unit!r} is no unit of {known}")
    sign = entry.get("sign", 1)
    if sign not in (1, -1):
        raise fields.error("sign", "must be 1 or -1")
    zero = fields.number("zero", unit) or 0.0
    per = fields.number("per", f"per {unit}", positive=True) or 1.0
    return Source(target, column, unit, float(sign), zero, per)


def _quantities(target: str) -> tuple[str, ...]:
    if target in _FIXED:
        return (_FIXED[target],)
    stem = target.rstrip("0123456789")
    return _JOINT.get(stem, ()) if stem != target else ()


def _consistent(name: str, files: tuple[FileMap, ...]) -> None:
    seen: dict[str, Source] = {}
    for column in (c for f in files for c in f.columns):
        if column.target in seen and column.target != "t":
            raise MapError(f"{name}: {column.target} is mapped twice")
        seen[column.target] = column
    for group in (CHANNELS[:3], CHANNELS[3:], ("ax", "ay", "az")):
        units = {t: seen[t].unit for t in group if t in seen}
        if len(set(units.values())) > 1:
            stated = ", ".join(f"{t} in {u}" for t, u in units.items())
            raise MapError(f"{name}: mixed units: {stated}; one sensor reports in one unit")
    missing = [c for c in CHANNELS if c not in seen]
    effort = len(missing) == len(CHANNELS) and effort_prefix(seen) is not None
    if missing and not effort:
        raise MapError(f"{name}: no column is mapped to {', '.join(missing)}")


# conventions applied: orientations become unit quaternions of the sensor in the base


def turned(data: Mapping[str, np.ndarray], where: str) -> Rotation | None:
    """The orientation (N,) that a file's columns give, as the file means it; None without one.

    Args:
        data: columns (N,), angles in rad.
        where: name of the file, for messages.

    Raises:
        MapError: a matrix or quaternion that is no rotation; names the row.
    """
    if QUATERNION[0] in data:
        q = np.stack([data[c] for c in QUATERNION], axis=-1)
        length = np.linalg.norm(q, axis=1)
        bad = np.flatnonzero(~(np.abs(length - 1.0) < UNIT))
        if len(bad):
            raise MapError(
                f"{where}: row {bad[0]}: qw qx qy qz has length {length[bad[0]]:.4g}, "
                "a unit quaternion has 1"
            )
        return Rotation.from_quat(q, scalar_first=True)
    if ROTATION[0] in data:
        return Rotation.from_matrix(_matrices(data, where))
    if ROTATION_VECTOR[0] in data:
        return Rotation.from_rotvec(np.stack([data[c] for c in ROTATION_VECTOR], axis=-1))
    if ROLL_PITCH_YAW[0] in data:
        return Rotation.from_euler("xyz", np.stack([data[c] for c in ROLL_PITCH_YAW], axis=-1))
    return None


def _matrices(data: Mapping[str, np.ndarray], where: str) -> np.ndarray:
    matrix = np.stack([data[r] for r in ROTATION], axis=-1).reshape(-1, 3, 3)
    error = np.abs(np.swapaxes(matrix, -1, -2) @ matrix - np.eye(3)).max(axis=(1, 2))
    left_handed = np.linalg.det(matrix) < 0
    bad = np.flatnonzero((error > ORTHONORMAL) | left_handed)
    if len(bad):
        row = bad[0]
        why = "it is left-handed" if error[row] <= ORTHONORMAL else f"RᵀR off by {error[row]:.2g}"
        raise MapError(f"{where}: row {row}: r11…r33 is not a rotation ({why})")
    return matrix


def of_sensor(
    given: Rotation, conventions: Conventions, pose_flange: tuple[float, ...] | None
) -> Rotation:
    """The sensor in the base, from the orientation (N,) as a file means it."""
    rotation = given.inv() if conventions.inverse else given
    if conventions.of == "flange" and pose_flange is not None:
        rotation = rotation * Rotation.from_quat(pose_flange[3:], scalar_first=True)
    return rotation


def columns_of(rotation: Rotation) -> dict[str, np.ndarray]:
    """Quaternion columns qw qx qy qz (N,), qw ≥ 0."""
    q = rotation.as_quat(canonical=True, scalar_first=True)
    return dict(zip(QUATERNION, q.T, strict=True))


def wrench_in_sensor(
    wrench: np.ndarray,
    conventions: Conventions,
    rotation: Rotation | None,
    pose_flange: tuple[float, ...] | None,
) -> np.ndarray:
    """A wrench (N, 6) [N, N·m] in the sensor's axes about its origin.

    Args:
        wrench: in the axes that the conventions name: of the base about the sensor's origin, of
            the flange about the flange's origin.
        conventions: of the file.
        rotation: sensor in base (N,), for a wrench in the base's axes.
        pose_flange: of the sensor, x y z qw qx qy qz, for a wrench in the flange's axes.
    """
    force, torque = wrench[:, :3], wrench[:, 3:]
    if conventions.wrench_axes == "base" and rotation is not None:
        back = rotation.inv()
        return np.concatenate([back.apply(force), back.apply(torque)], axis=1)
    if conventions.wrench_axes == "flange" and pose_flange is not None:
        back = Rotation.from_quat(pose_flange[3:], scalar_first=True).inv()
        about = torque - np.cross(np.asarray(pose_flange[:3]), force)
        return np.concatenate([back.apply(force), back.apply(about)], axis=1)
    return wrench
