"""Data sets of LeRobot, read and written: joint values and commands by the names of features.

A folder with ``meta/info.json`` and Parquet files under ``data/`` (format 3.0; 2.0 and 2.1 have the
same columns). Values are degrees or shares of a range, which no file says: the map's ``[lerobot]``
does. An episode becomes a segment. Written are SI units, in format 3.0 as
``lerobot/datasets/dataset_metadata.py`` of LeRobot 0.4 to 0.6 reads it.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from wrenchbed import registry
from wrenchbed.data import parquet
from wrenchbed.data.clock import at_times, pieces
from wrenchbed.data.column_map import UNITS, stated_recording
from wrenchbed.data.holds import with_noise
from wrenchbed.data.import_files import Imported
from wrenchbed.data.recording import COMMAND, EFFORT_UNITS, Recording
from wrenchbed.errors import MapError, ParameterError, RecordingError
from wrenchbed.files import atomic_folder, checked, write_json
from wrenchbed.physics.wrench import CHANNELS

INFO = Path("meta") / "info.json"
"""File whose presence marks a folder as a LeRobot data set."""
MAP = Path("meta") / "wrenchbed.json"
"""Map of a data set that wrenchbed wrote."""
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
_OFF, _SAME = 0.1, 1e-6
"""Largest time between a row and its frame, over the step between frames, and rounding of it."""
_FILE = "chunk-000/file-000.parquet"
_PARTS = ("data/chunk", "data/file", "meta/episodes/chunk", "meta/episodes/file")
_QUANTILES = (0.01, 0.1, 0.5, 0.9, 0.99)


def is_lerobot(path: Path) -> bool:
    """Whether a path is the folder of a LeRobot data set."""
    return (path / INFO).is_file()


def import_lerobot(folder: Path, map_file: Path) -> Imported:
    """Read a LeRobot data set, by a map with ``[recording]`` and ``[lerobot]``, as a recording. A
    `MapError` names the file, the entry and what it should say; a `RecordingError`: the result is
    none."""
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
    """Names of a feature's numbers that are the ``joints``: as stated, or by their ends."""
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
    order = [("episode_index", "ascending"), ("timestamp", "ascending")]
    return pa.concat_tables(parts).sort_by(order)


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
    column = table[kind].combine_chunks()
    column = column.flatten() if pa.types.is_nested(column.type) else column
    flat = column.to_numpy(zero_copy_only=False).astype(float)
    if len(flat) % len(table):
        raise MapError(f"{folder}: rows of {kind} have different lengths")
    return np.asarray(flat.reshape(len(table), -1))


def _in_si(values: np.ndarray, stated: checked.Fields, joints: int) -> np.ndarray:
    """Convert joint values (N, J) in the units that the map states to rad and m; ``joints``: J."""
    known = [u for u, (quantity, _) in UNITS.items() if quantity in ("angle", "length")]
    units = [*known, NORMALISED]
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
    """Pairs (J, 2) of different numbers, a joint each, under ``key``; ``what`` is for an error."""
    try:
        result = np.asarray(stated.raw.get(key), dtype=float)
    except (TypeError, ValueError):
        result = np.zeros(0)
    shaped = result.shape == (joints, 2) and np.isfinite(result).all()
    if not shaped or not np.ptp(result, axis=1).all():
        raise stated.error(key, f"must be {joints} pairs: {what}")
    return result


def write_lerobot(
    recording: Recording, folder: Path, fps: int | None = None, task: str = "move"
) -> tuple[str, ...]:
    """Write a motion of joints as a LeRobot data set to a new folder; return sentences on it.

    Segments, and two rows or more between gaps of the clock, become episodes. Values are in SI
    units; ``meta/wrenchbed.json`` is the map by which `import_lerobot` reads them again.

    Args:
        fps: frames a second to which columns are interpolated; None: the recording's own.
        task: what the robot does, in words, which some policies take as their instruction.

    Raises:
        RecordingError: poses at rest, no joints, or an uneven clock without ``fps``.
        ParameterError: the folder holds files.
    """
    if folder.is_dir() and any(folder.iterdir()):
        raise ParameterError(f"{folder}: holds files already; give another name")
    episodes, rate = _episodes(recording, fps)
    sources, counts = _sources(recording), [len(columns["t"]) for columns in episodes]
    columns = {k: np.concatenate([each[k] for each in episodes]) for k in episodes[0]}
    frame = np.concatenate([np.arange(count) for count in counts])
    values = {k: np.stack([columns[c] for c in cs], axis=1) for k, (_, cs) in sources.items()}
    values |= {"timestamp": frame / rate}
    whole = {k: x.astype(np.float32) for k, x in values.items()} | {
        "frame_index": frame, "episode_index": np.repeat(np.arange(len(counts)), counts),
        "index": np.arange(len(frame)), "task_index": 0 * frame,
    }  # fmt: skip
    arrays = {k: pa.array(x.ravel()) for k, x in whole.items()}
    arrays |= {  # of one number a row LeRobot wants no lists
        k: pa.FixedSizeListArray.from_arrays(arrays[k], x.shape[1])
        for k, x in whole.items() if x.size > len(x)
    }  # fmt: skip
    rows = [
        {"episode_index": number, "tasks": [task], "length": end - begin,
         "dataset_from_index": begin, "dataset_to_index": end}
        | dict.fromkeys((f"{x}_index" for x in _PARTS), 0)
        | {f"stats/{k}/{s}": v for k, x in whole.items() for s, v in _stats(x[begin:end]).items()}
        for number, (begin, end) in enumerate(pairwise([0, *np.cumsum(counts).tolist()]))
    ]  # fmt: skip
    info = {
        "codebase_version": "v3.0", "robot_type": recording.metadata.robot.partition("@")[0],
        "total_episodes": len(counts), "total_frames": len(frame), "total_tasks": 1, "fps": rate,
        "chunks_size": 1000, "data_files_size_in_mb": 100, "video_files_size_in_mb": 200,
        "splits": {"train": f"0:{len(counts)}"}, "video_path": None,
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "features": {k: {"dtype": str(x.dtype), "shape": list(x.shape[1:]) or [1],
                         "names": sources[k][0] if k in sources else None}
                     for k, x in whole.items()},
    }  # fmt: skip
    stated = replace(recording.metadata, rate_hz=float(rate), extra={}).to_json()
    units = {"unit": "rad", "wrench": "N, N·m"}
    units |= {"effort": EFFORT_UNITS[recording.effort]} if recording.effort else {}
    text = {"name": "task", "field_name": "task", "pandas_type": "unicode", "numpy_type": "object"}
    labels = {"index_columns": ["task"], "columns": [text], "column_indexes": []}
    tasks = pa.table({"task_index": [0], "task": [task]})  # pandas, which LeRobot asks, labels rows
    tasks = tasks.replace_schema_metadata({"pandas": json.dumps(labels)})
    with atomic_folder(folder) as new:
        parquet.write(new / "data" / _FILE, pa.table(arrays))
        parquet.write(new / "meta/episodes" / _FILE, pa.Table.from_pylist(rows))
        parquet.write(new / "meta/tasks.parquet", tasks)
        write_json(new / "meta/stats.json", {k: _stats(x) for k, x in whole.items()})
        write_json(new / MAP, {"recording": stated, "lerobot": units})
        write_json(new / INFO, info)
    notes = [f"{len(counts)} episodes at {rate} frames a second: {', '.join(sources)}"]
    used = {"t", "segment", *(c for _, columns in sources.values() for c in columns)}
    if left := dict.fromkeys(c.rstrip("0123456789") for c in recording.columns if c not in used):
        notes.append(f"left out: {', '.join(left)}")
    if ACTION not in sources:
        notes.append("no action, which policies learn: the recording has no q_target1 …")
    return tuple(notes)


def _episodes(recording: Recording, fps: int | None) -> tuple[list[dict[str, np.ndarray]], int]:
    """Columns (n,) of each episode, and its frames a second: ``fps``, else those of the clock."""
    every = dict(recording.columns)
    slices = [rows for rows in pieces(every, fps is not None) if rows.stop > rows.start + 1]
    parts = [{k: v[rows] for k, v in every.items()} for rows in slices]
    if recording.metadata.mode != "dynamic" or not recording.joints or not parts:
        raise RecordingError(f"{recording.name}: a LeRobot data set needs a motion of joints")
    if fps is not None:
        result = list[dict[str, np.ndarray]]()
        for part in parts:
            t = part["t"]
            frames = np.arange(1 + int((t[-1] - t[0]) * fps + _SAME))
            result.append(at_times(part, t[0] + frames / fps) | {"t": frames / fps})
        return result, fps
    steps = np.concatenate([np.diff(part["t"]) for part in parts])
    rate = max(1, round(1.0 / float(steps.mean())))
    off = max(np.abs((p["t"] - p["t"][0]) * rate - np.arange(len(p["t"]))).max() for p in parts)
    if off > _OFF:
        raise RecordingError(
            f"{recording.name}: its clock is up to {off:.2g} of a step off {rate} frames a second "
            f"(at most {_OFF:g}): state to how many to interpolate it, --fps {rate}"
        )
    return parts, rate


def _sources(recording: Recording) -> dict[str, tuple[list[str], list[str]]]:
    """Feature → names of its numbers, and the columns of a recording that it holds."""
    joints = registry.load("robots", recording.metadata.robot).joint_names
    result = {WRENCH: (list(CHANNELS), list(CHANNELS))}
    of_joints = {STATE: ("pos", "q"), ACTION: ("pos", COMMAND)}
    for kind, (what, prefix) in (of_joints | {EFFORT: ("effort", recording.effort)}).items():
        columns = [f"{prefix}{k + 1}" for k in range(len(joints))]
        result[kind] = ([f"{joint}.{what}" for joint in joints], columns)
    return {k: v for k, v in result.items() if set(v[1]) <= set(recording.columns)}


def _stats(values: np.ndarray) -> dict[str, list[float]]:
    """Statistics of a feature's values (N,) or (N, K) by which LeRobot normalises them."""
    x = values.reshape(len(values), -1).astype(float)
    each = {"min": x.min(axis=0), "max": x.max(axis=0), "mean": x.mean(axis=0)}
    each |= {"std": x.std(axis=0), "count": np.array([len(x)])}
    each |= {f"q{round(100 * q):02d}": np.quantile(x, q, axis=0) for q in _QUANTILES}
    return {k: v.tolist() for k, v in each.items()}
