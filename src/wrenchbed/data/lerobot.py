"""Data sets of LeRobot: joint values and commands by the names of their features.

A folder with ``meta/info.json`` and Parquet files under ``data/`` (format 3.0; 2.0 and 2.1 have the
same columns). Values are degrees or shares of a range, which no file says: the map's ``[lerobot]``
does. An episode becomes a segment.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from wrenchbed import registry
from wrenchbed.data.column_map import UNITS, stated_recording
from wrenchbed.data.holds import with_noise
from wrenchbed.data.import_files import Imported
from wrenchbed.data.recording import COMMAND, EFFORT_UNITS, Recording
from wrenchbed.errors import MapError
from wrenchbed.files import checked
from wrenchbed.physics.wrench import CHANNELS

INFO = Path("meta") / "info.json"
"""File whose presence marks a folder as a LeRobot data set."""
STATE, ACTION, EFFORT, WRENCH = (
    "observation.state", "action", "observation.effort", "observation.wrench"
)  # fmt: skip
NORMALISED = "normalised"
"""Unit of values between two ends of a range, which the map states."""
_ENDS = (-100.0, 100.0)
"""Values at the two ends of a joint's normalised range where the map states no others."""
_BETWEEN_S = 1.0
"""Time put between episodes [s]; how long it really was is not recorded."""
_KEYS = ("unit", "joints", "range", "ends", "sign", "zero", "effort", "wrench")
_OF_JOINTS = [u for u, (quantity, _) in UNITS.items() if quantity in ("angle", "length")]


def is_lerobot(path: Path) -> bool:
    """Whether a path is the folder of a LeRobot data set."""
    return (path / INFO).is_file()


def import_lerobot(folder: Path, map_file: Path) -> Imported:
    """Read a LeRobot data set, by a map with ``[recording]`` and ``[lerobot]``, as a recording.

    Raises:
        MapError: names the file, the entry and what it should say.
        RecordingError: the result is no valid recording.
    """
    raw = checked.Fields(checked.load(map_file, MapError, "TOML"), f"{map_file}: ", MapError)
    raw.only({"recording", "lerobot"}, "a map of a LeRobot data set")
    _, metadata = stated_recording(raw.part("recording"), str(map_file), map_file.parent)
    stated = raw.part("lerobot").only(_KEYS, "[lerobot]")
    features = _features(folder)
    if STATE not in features:
        raise MapError(f"{folder / INFO}: has no feature {STATE}; found {', '.join(features)}")
    joints = registry.load("robots", metadata.robot).joint_names
    wanted = _joints(stated, joints, features[STATE], str(folder / INFO))
    kinds = [k for k in (STATE, ACTION, EFFORT, WRENCH) if k in features]
    table = _table(folder, kinds)
    columns = _clock(table, str(folder))

    def of_joints(kind: str) -> np.ndarray:
        return _values(table, kind, folder)[:, _places(features[kind], wanted, kind, folder)]

    for kind, prefix in ((STATE, "q"), (ACTION, COMMAND)):
        if kind in features:
            values = _in_si(of_joints(kind), stated, len(wanted))
            columns |= {f"{prefix}{j + 1}": x for j, x in enumerate(values.T)}
    notes = [f"{len(np.unique(columns['segment']))} episodes as segments"]
    if unused := [n for n in features[STATE] if n not in wanted]:
        notes.append(f"joints that {metadata.robot} lacks: {', '.join(unused)}")
    for kind, key in ((EFFORT, "effort"), (WRENCH, "wrench")):
        if kind in features and key not in stated.raw:
            notes.append(f"{kind} is left out: [lerobot] {key} states no unit of it")
    if EFFORT in features and "effort" in stated.raw:
        units = [u for u, (quantity, _) in UNITS.items() if quantity in ("torque", "current")]
        unit = stated.choice("effort", units, f"must be one of {', '.join(units)}")
        prefix = next(p for p, si in EFFORT_UNITS.items() if UNITS[si][0] == UNITS[unit][0])
        values = UNITS[unit][1] * of_joints(EFFORT)
        columns |= {f"{prefix}{j + 1}": x for j, x in enumerate(values.T)}
    if WRENCH in features and "wrench" in stated.raw:
        stated.choice("wrench", ["N, N·m"], "must be 'N, N·m': in the sensor's axes")
        columns |= dict(zip(CHANNELS, _values(table, WRENCH, folder).T, strict=True))
    return Imported(with_noise(Recording(metadata, columns, str(folder))), 0, tuple(notes))


def _features(folder: Path) -> dict[str, list[str]]:
    """Feature (``observation.state``, ``action``) → names of the numbers in it, in their order."""
    fields = checked.Fields(checked.load(folder / INFO, MapError), f"{folder / INFO}: ", MapError)
    result: dict[str, list[str]] = {}
    for name, entry in fields.part("features").raw.items():
        names: Any = entry.get("names") if isinstance(entry, Mapping) else None
        if isinstance(names, Mapping):  # as {"motors": [...]} of format 2
            names = next(iter(names.values()), None)
        count = entry.get("shape", [0])[0] if isinstance(entry, Mapping) else 0
        if not isinstance(names, list) or len(names) != count:
            names = [str(k) for k in range(count if isinstance(count, int) else 0)]
        result[str(name)] = [str(n) for n in names]
    return result


def _joints(
    stated: checked.Fields, joints: Sequence[str], names: Sequence[str], where: str
) -> list[str]:
    """Names of a feature's numbers that are the robot's ``joints``, in their order: those that the
    map ``stated`` lists under ``joints``, else those that end in the name of a joint."""
    given = stated.raw.get("joints")
    if given is not None:
        if not isinstance(given, list) or len(given) != len(joints) or set(given) - set(names):
            rule = f"must be {len(joints)} of {', '.join(names)}, in the order q1…"
            raise stated.error("joints", rule)
        return given
    # ``shoulder_pan.pos`` or ``main_shoulder_pan`` is of the joint shoulder_pan
    bases = {n: f".{n.removesuffix('.pos')}" for n in names}
    of_joints = [[n for n in names if bases[n].endswith(("_" + j, "." + j))] for j in joints]
    if all(len(n) == 1 for n in of_joints):
        return [n for (n,) in of_joints]
    lacking = joints[[len(n) == 1 for n in of_joints].index(False)]
    raise MapError(
        f"{where}: {STATE} names {', '.join(names)}: none, or several, is joint {lacking} of the "
        'robot; state [lerobot] joints = ["…"] in the order q1…'
    )


def _places(names: Sequence[str], wanted: Sequence[str], kind: str, folder: Path) -> list[int]:
    """Indices of wanted names in ``names`` of feature ``kind``, both without what follows a dot."""
    bases = [n.rpartition(".")[0] or n for n in names]
    ours = [n.rpartition(".")[0] or n for n in wanted]
    if missing := [n for n in ours if n not in bases]:
        raise MapError(f"{folder / INFO}: {kind} has no {missing[0]}; found {', '.join(names)}")
    return [bases.index(n) for n in ours]


def _table(folder: Path, kinds: Sequence[str]) -> pa.Table:
    """Read the features ``kinds`` and clock of a data set, rows in order of episodes and frames."""
    files = sorted((folder / "data").rglob("*.parquet"))
    if not files:
        raise MapError(f"{folder}: has no Parquet file under data/")
    parts, columns = list[pa.Table](), [*kinds, "timestamp", "episode_index"]
    for file in files:
        try:
            parts.append(pq.ParquetFile(file).read(columns=columns))
        except (pa.ArrowException, OSError) as error:
            raise MapError(f"{file}: cannot be read: {error}") from error
        if missing := [c for c in columns if c not in parts[-1].column_names]:
            raise MapError(f"{file}: has no column {missing[0]}")
    return pa.concat_tables(parts).sort_by(
        [("episode_index", "ascending"), ("timestamp", "ascending")]
    )


def _clock(table: pa.Table, where: str) -> dict[str, np.ndarray]:
    """Columns t [s] and segment (N,) of a data set: episodes are segments, with pauses between."""
    t = table["timestamp"].to_numpy().astype(float)
    episode = table["episode_index"].to_numpy().astype(np.int64)
    if not len(t):
        raise MapError(f"{where}: the data set has 0 rows")
    first = np.flatnonzero(np.diff(episode, prepend=episode[0] - 1))
    last = np.append(first[1:], len(t)) - 1
    begins = np.cumsum(np.append(0.0, (t[last] - t[first] + _BETWEEN_S)[:-1]))
    rows = np.diff(np.append(first, len(t)))
    return {"t": t + np.repeat(begins - t[first], rows), "segment": episode}


def _values(table: pa.Table, kind: str, folder: Path) -> np.ndarray:
    """Numbers (N, K) of the feature ``kind``, one row a frame."""
    flat = table[kind].combine_chunks().flatten().to_numpy(zero_copy_only=False).astype(float)
    if len(flat) % len(table):
        raise MapError(f"{folder}: rows of {kind} have different lengths")
    return np.asarray(flat.reshape(len(table), -1))


def _in_si(values: np.ndarray, stated: checked.Fields, joints: int) -> np.ndarray:
    """Convert joint values (N, J) in the units that the map states to rad and m; ``joints``: J."""
    units = [*_OF_JOINTS, NORMALISED]
    rule = (
        f"must say what the data set's values are, which it does not: {', '.join(units)}; LeRobot "
        "records deg, or normalised values of -100 … 100 between the ends of its calibration"
    )
    unit = stated.choice("unit", units, rule)
    if unit == NORMALISED:
        low, high = _pairs(stated, "range", joints, "[lowest, highest] in rad or m, one a joint").T
        begin, end = np.array([_ENDS] * joints).T
        if "ends" in stated.raw:
            begin, end = _pairs(stated, "ends", joints, "the values at range's ends").T
        return np.asarray(low + (values - begin) / (end - begin) * (high - low))
    sign = np.asarray(stated.numbers("sign", joints, rule=f"must be {joints} of 1 and -1") or 1.0)
    zero = np.asarray(stated.numbers("zero", joints, rule=f"must be {joints} numbers") or 0.0)
    return np.asarray((values - zero) * sign * UNITS[unit][1])


def _pairs(stated: checked.Fields, key: str, joints: int, what: str) -> np.ndarray:
    """Two different numbers for each of ``joints`` joints (J, 2), as the map states them under
    ``key``; ``what`` says in an error what they are."""
    try:
        result = np.asarray(stated.raw.get(key), dtype=float)
    except (TypeError, ValueError):
        result = np.zeros(0)
    if (
        result.shape != (joints, 2)
        or not np.isfinite(result).all()
        or not np.ptp(result, axis=1).all()
    ):
        raise stated.error(key, f"must be {joints} pairs: {what}")
    return result
