"""A column map: which columns of which files make a recording, in which units. TOML or JSON."""

from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

from wrenchbed.data.checked import Fields, load
from wrenchbed.data.metadata import Metadata, parse
from wrenchbed.errors import MapError, RecordingError
from wrenchbed.physics.wrench import CHANNELS

UNITS: dict[str, tuple[str, float]] = {
    "s": ("time", 1.0), "ms": ("time", 1e-3), "us": ("time", 1e-6), "µs": ("time", 1e-6),
    "ns": ("time", 1e-9),
    "rad": ("angle", 1.0), "deg": ("angle", 0.017453292519943295),
    "rad/s": ("angular velocity", 1.0), "deg/s": ("angular velocity", 0.017453292519943295),
    "m": ("length", 1.0), "mm": ("length", 1e-3),
    "N": ("force", 1.0), "kN": ("force", 1e3), "lbf": ("force", 4.4482216152605),
    "kgf": ("force", 9.80665),
    "N·m": ("torque", 1.0), "Nm": ("torque", 1.0), "N.m": ("torque", 1.0), "N*m": ("torque", 1.0),
    "Nmm": ("torque", 1e-3), "N·mm": ("torque", 1e-3), "lbf·in": ("torque", 0.1129848290276167),
    "lbf-in": ("torque", 0.1129848290276167),
    "m/s²": ("acceleration", 1.0), "m/s^2": ("acceleration", 1.0), "g": ("acceleration", 9.80665),
    "°C": ("temperature", 1.0), "degC": ("temperature", 1.0),
    "1": ("number", 1.0),
}  # fmt: skip
"""Unit → its quantity and its size in SI."""

ROTATION = tuple(f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3))
"""Elements of R_base_sensor in row order, for a map that gives a rotation matrix."""
_FIXED = {
    "t": "time", "temperature": "temperature", "ax": "acceleration", "ay": "acceleration",
    "az": "acceleration", **dict.fromkeys(CHANNELS[:3], "force"),
    **dict.fromkeys(CHANNELS[3:], "torque"), **dict.fromkeys(ROTATION, "number"),
    **dict.fromkeys(("qw", "qx", "qy", "qz", "segment", "status"), "number"),
}  # fmt: skip
_JOINT = {"q": ("angle", "length"), "qd": ("angular velocity",), "q_target": ("angle", "length"),
          "tau": ("torque",)}  # fmt: skip


@dataclass(frozen=True)
class Source:
    """Where one column of the recording comes from: (column − zero) of a file, scaled to SI."""

    target: str
    column: str
    unit: str
    sign: float
    zero: float = 0.0

    @property
    def factor(self) -> float:
        return UNITS[self.unit][1] * self.sign


@dataclass(frozen=True)
class FileMap:
    """Columns from the files whose name matches ``match``; ``clock`` is the one of time.

    Attributes:
        topic: of a log, whose messages' fields are its columns.
        delimiter: of a CSV file.
    """

    match: str
    columns: tuple[Source, ...]
    topic: str | None = None
    delimiter: str = ","

    @property
    def clock(self) -> Source | None:
        return next((c for c in self.columns if c.target == "t"), None)


@dataclass(frozen=True)
class ColumnMap:
    """A whole map: files in order, the first sets the rows; rate of rows without a clock."""

    files: tuple[FileMap, ...]
    metadata: Metadata
    rate_hz: float | None
    name: str


def ready() -> dict[str, Path]:
    """Maps that come with wrenchbed, by name."""
    folder = Path(str(files("wrenchbed.data"))) / "maps"
    return {p.stem: p for p in sorted(folder.glob("*.toml"))}


def read(path: str | Path) -> ColumnMap:
    """Read and check a map, a file or by the name of one of `ready`.

    Raises:
        MapError: names the file, the entry and what it should say.
    """
    path = ready().get(str(path), Path(path))
    raw = _load(path)
    try:
        stated = raw.part("recording").raw
        metadata = parse({"format": 1, "source": "import", **stated}, str(path))
    except RecordingError as error:
        raise MapError(str(error)) from error
    entries = raw.raw.get("file")
    if not isinstance(entries, list) or not entries:
        raise MapError(f'{path}: needs at least one [[file]] with match = "*.csv" and columns')
    files = tuple(_file(f"{path}: [[file]] {k}: ", x) for k, x in enumerate(entries, start=1))
    _consistent(path, files)
    return ColumnMap(files, metadata, metadata.rate_hz, str(path))


def _load(path: Path) -> Fields:
    try:
        raw = load(path, MapError, "TOML")
    except MapError as error:
        if path.exists():
            raise
        raise MapError(f"{error}; ready maps: {', '.join(ready())}") from error
    return Fields(raw, f"{path}: ", MapError).only({"recording", "file"}, "a map")


def _file(where: str, entry: Any) -> FileMap:
    fields = Fields(entry, where, MapError)
    columns = fields.part("columns")
    if not columns.raw:
        raise MapError(f'{where}needs columns = {{ fx = {{ column = "Fx", unit = "N" }}, … }}')
    delimiter = fields.text("delimiter", rule="must be one character") or ","
    if len(delimiter) != 1:
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
        known = "t, fx…tz, q1…, qw qx qy qz, r11…r33, ax ay az, temperature, segment, status"
        raise MapError(f"{where}{target!r} is no column of a recording; known: {known}")
    if not isinstance(entry, Mapping) or not isinstance(entry.get("column"), str):
        raise MapError(f'{where}{target} needs a table with column = "…" and unit = "…"')
    fields = Fields(entry, where, MapError, target)
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
    return Source(target, entry["column"], unit, float(sign), zero)


def _quantities(target: str) -> tuple[str, ...]:
    if target in _FIXED:
        return (_FIXED[target],)
    stem = target.rstrip("0123456789")
    return _JOINT.get(stem, ()) if stem != target else ()


def _consistent(path: Path, files: tuple[FileMap, ...]) -> None:
    seen: dict[str, Source] = {}
    for column in (c for f in files for c in f.columns):
        if column.target in seen and column.target != "t":
            raise MapError(f"{path}: {column.target} is mapped twice")
        seen[column.target] = column
    for group in (CHANNELS[:3], CHANNELS[3:], ("ax", "ay", "az")):
        units = {t: seen[t].unit for t in group if t in seen}
        if len(set(units.values())) > 1:
            stated = ", ".join(f"{t} in {u}" for t, u in units.items())
            raise MapError(f"{path}: mixed units: {stated}; one sensor reports in one unit")
    missing = [c for c in CHANNELS if c not in seen]
    if missing:
        raise MapError(f"{path}: no column is mapped to {', '.join(missing)}")
    rotation = [r for r in ROTATION if r in seen]
    if rotation and len(rotation) != 9:
        raise MapError(f"{path}: a rotation matrix needs all of r11…r33, found {len(rotation)}")
