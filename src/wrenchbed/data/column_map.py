"""A column map: which columns of which files make a recording, in which units. TOML or JSON."""

import json
import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

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
    if not isinstance(raw.get("recording", {}), Mapping):
        raise MapError(f"{path}: [recording] must be a table")
    try:
        metadata = parse({"format": 1, "source": "import", **raw.get("recording", {})}, str(path))
    except RecordingError as error:
        raise MapError(str(error)) from error
    entries = raw.get("file")
    if not isinstance(entries, list) or not entries:
        raise MapError(f'{path}: needs at least one [[file]] with match = "*.csv" and columns')
    files = tuple(_file(path, i, entry) for i, entry in enumerate(entries, start=1))
    _consistent(path, files)
    return ColumnMap(files, metadata, metadata.rate_hz, str(path))


def _load(path: Path) -> dict[str, Any]:
    try:
        text = path.read_text(encoding="utf-8")
        raw = json.loads(text) if path.suffix == ".json" else tomllib.loads(text)
    except FileNotFoundError as error:
        known = ", ".join(ready())
        raise MapError(f"{path}: there is no such file; ready maps: {known}") from error
    except (ValueError, UnicodeDecodeError) as error:
        kind = "JSON" if path.suffix == ".json" else "TOML"
        raise MapError(f"{path}: not valid {kind}: {str(error).splitlines()[0]}") from error
    if not isinstance(raw, dict):
        raise MapError(f"{path}: must be an object with 'recording' and 'file'")
    unknown = set(raw) - {"recording", "file"}
    if unknown:
        raise MapError(f"{path}: unknown entry {sorted(unknown)[0]!r}; known: recording, file")
    return raw


def _file(path: Path, i: int, entry: Mapping[str, Any]) -> FileMap:
    where = f"{path}: [[file]] {i}"
    columns = entry.get("columns") if isinstance(entry, Mapping) else None
    if not isinstance(columns, Mapping) or not columns:
        raise MapError(f'{where}: needs columns = {{ fx = {{ column = "Fx", unit = "N" }}, … }}')
    match = entry.get("match", "*")
    if not isinstance(match, str):
        raise MapError(f"{where}: match = {match!r} must be a file name or pattern")
    topic, delimiter = entry.get("topic"), entry.get("delimiter", ",")
    if topic is not None and not isinstance(topic, str):
        raise MapError(f"{where}: topic = {topic!r} must be the name of one")
    if not isinstance(delimiter, str) or len(delimiter) != 1:
        raise MapError(f"{where}: delimiter = {delimiter!r} must be one character")
    sources = tuple(_source(where, k, v) for k, v in columns.items())
    return FileMap(match, sources, topic, delimiter)


def _source(where: str, target: str, entry: Any) -> Source:
    quantities = _quantities(target)
    if not quantities:
        known = "t, fx…tz, q1…, qw qx qy qz, r11…r33, ax ay az, temperature, segment, status"
        raise MapError(f"{where}: {target!r} is no column of a recording; known: {known}")
    if not isinstance(entry, Mapping) or not isinstance(entry.get("column"), str):
        raise MapError(f'{where}: {target} needs a table with column = "…" and unit = "…"')
    unit = entry.get("unit", "1" if quantities == ("number",) else None)
    if unit is None:
        raise MapError(f"{where}: {target} states no unit; one of {_units_of(quantities)}")
    if not isinstance(unit, str) or unit not in UNITS or UNITS[unit][0] not in quantities:
        raise MapError(f"{where}: {target} in {unit!r} is no unit of {' or '.join(quantities)}; "
                       f"one of {_units_of(quantities)}")  # fmt: skip
    sign = entry.get("sign", 1)
    if sign not in (1, -1):
        raise MapError(f"{where}: {target} sign = {sign!r} must be 1 or -1")
    zero = entry.get("zero", 0.0)
    if isinstance(zero, bool) or not isinstance(zero, int | float) or not math.isfinite(zero):
        raise MapError(f"{where}: {target} zero = {zero!r} must be a number [{unit}]")
    return Source(target, entry["column"], unit, float(sign), float(zero))


def _quantities(target: str) -> tuple[str, ...]:
    if target in _FIXED:
        return (_FIXED[target],)
    stem = target.rstrip("0123456789")
    return _JOINT.get(stem, ()) if stem != target else ()


def _units_of(quantities: tuple[str, ...]) -> str:
    return ", ".join(u for u, (quantity, _) in UNITS.items() if quantity in quantities)


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
