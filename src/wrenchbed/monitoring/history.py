"""The history of a robot's checks: one Parquet file, one row a check, written as a whole.

A row holds what was measured (the mean of each hold), so that a later version can judge the
complete history again, and the numbers that were fitted to it. Each check's recording is kept
beside the file; the history can be made again from these.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from itertools import combinations_with_replacement
from pathlib import Path
from typing import Any

import numpy as np

from wrenchbed.data import parquet
from wrenchbed.data.metadata import carried_robot, stated_robot
from wrenchbed.errors import HistoryError
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.robots.base import Robot

FILE, RECORDINGS = "history.parquet", "recordings"
"""Names in the folder of a history."""
_KIND = "history of checks"
_TEXTS = ("time", "robot", "robot_digest", "sensor", "recording", "recording_digest", "baseline",
          "verdict")  # fmt: skip
_PAIRS = tuple(combinations_with_replacement(range(6), 2))
"""Entries of the upper triangle of a row's covariance."""
_REMEDY = (
    "give --rebuild: the history is made again from DIR/recordings, the old file is kept with ~"
)


@dataclass(frozen=True, eq=False)
class Check:
    """Check of a robot in a history.

    Attributes:
        time: when it was recorded.
        robot, sensor: registry names.
        robot_digest: see `digest`.
        recording, recording_digest: file in `RECORDINGS`, SHA-256 of what was measured.
        temperature: of the sensor, else of the room [°C]; NaN if not known.
        t: mean times of the holds (P,) [s].
        q: joint values of the holds (P, J) [rad or m].
        wrench: mean readings (P, 6) [N, N·m].
        count: rows of each hold (P,).
        covariance: of one row (6, 6).
        baseline: why history begins anew with this check; empty if it does not.
        verdict: what was answered.
        values: numbers fitted to it, with ``.std`` [SI]; ``misfit``.
    """

    time: datetime
    robot: str
    sensor: str
    robot_digest: str
    recording: str
    recording_digest: str
    temperature: float
    t: np.ndarray
    q: np.ndarray
    wrench: np.ndarray
    count: np.ndarray
    covariance: np.ndarray
    baseline: str = ""
    verdict: str = ""
    values: Mapping[str, float] = field(default_factory=dict)

    @property
    def day(self) -> str:
        """Date of the check for people."""
        return _day(self.time)


def digest(robot: Robot, sensor: str) -> str:
    """16 digits of the SHA-256 of what is known of a robot: name, description, numbers, sensor."""
    known = [
        robot.name, carried_robot(robot.name), robot.parameters.nominal.tolist(),
        list(robot.gravity), sensor,
    ]  # fmt: skip
    return hashlib.sha256(json.dumps(known).encode()).hexdigest()[:16]


def digest_of(*arrays: np.ndarray) -> str:
    """16 digits of the SHA-256 of measured numbers: a copy under another name has the same."""
    sha = hashlib.sha256()
    for array in arrays:
        sha.update(np.ascontiguousarray(array, dtype=float).tobytes())
    return sha.hexdigest()[:16]


def read(folder: Path) -> list[Check]:
    """All checks of a history, the oldest first; none if there is no file.

    Raises:
        HistoryError: the file is damaged, its rows are out of order, doubled or of several robots;
            names file, row and remedy.
    """
    path = folder / FILE
    if not path.exists():
        return []
    try:
        columns, raw = parquet.read(path, HistoryError)
    except HistoryError as error:
        raise HistoryError(f"{error}; {_REMEDY}") from error
    if raw.get("kind") != _KIND:
        raise HistoryError(f"{path}: is no history of checks; give another folder")
    stated_robot(raw, str(raw.get("robot")))
    checks = _checks(path, columns)
    for k, check in enumerate(checks):
        continues(path, checks[:k], check, f"row {k}")
    return checks


def _checks(path: Path, columns: Mapping[str, np.ndarray]) -> list[Check]:
    """Rows of the file as checks, not yet compared with each other."""

    def column(name: str) -> np.ndarray:
        if name not in columns:
            raise HistoryError(f"{path}: column {name!r} is missing: {_REMEDY}")
        return columns[name]

    def numbers(name: str) -> np.ndarray:
        values = column(name)
        finite = np.array([isinstance(v, float | int) and np.isfinite(v) for v in values.tolist()])
        if not finite.all():
            row = int(np.argmin(finite))
            raise HistoryError(
                f"{path}: column {name!r}, row {row}: {values[row]!r} is no finite number"
            )
        return values.astype(float)

    def holds_of(*names: str) -> np.ndarray:
        """Columns of all holds (n, P, len(names))."""
        return np.stack([np.stack([numbers(h + c) for c in names], axis=1) for h in holds], axis=1)

    holds = [n.removesuffix("rows") for n in columns if n.startswith("hold") and n.endswith("rows")]
    joints = [n.removeprefix("hold00.") for n in columns if n.startswith("hold00.q")]
    texts = {name: [str(x) for x in column(name)] for name in _TEXTS}
    temperature = column("temperature").astype(float)
    q, wrench, timing = holds_of(*joints), holds_of(*CHANNELS), holds_of("t", "rows")
    spread = np.empty((len(q), 6, 6))
    for i, j in _PAIRS:
        spread[:, i, j] = spread[:, j, i] = numbers(f"row.{CHANNELS[i]}.{CHANNELS[j]}")
    other = {*_TEXTS, "temperature", "covariance"}  # once there was a covariance, as JSON
    fitted = {n: numbers(n) for n in columns if n not in other
              and not n.startswith(("hold", "row."))}  # fmt: skip
    times = []
    for k, text in enumerate(texts.pop("time")):
        try:
            times.append(datetime.fromisoformat(text).astimezone(UTC))
        except ValueError as error:
            raise HistoryError(f"{path}: row {k}: time cannot be read: {_REMEDY}") from error
    return [
        Check(
            time=time, temperature=float(temperature[k]), t=timing[k, :, 0], q=q[k],
            wrench=wrench[k], count=timing[k, :, 1], covariance=spread[k],
            values={n: float(v[k]) for n, v in fitted.items()},
            **{n: v[k] for n, v in texts.items()},
        )
        for k, time in enumerate(times)
    ]  # fmt: skip


def in_time(folder: Path, checks: Sequence[Check], time: datetime, now: datetime) -> None:
    """Refuse the time of a new check that this machine's clock or the last check contradicts.

    Raises:
        HistoryError: names the row and the remedy.
    """
    path, clock = folder / FILE, f"this machine's clock shows {_day(now)}"
    if checks and checks[-1].time > now:
        row = f"row {len(checks) - 1} is of {checks[-1].day}"
        remedy = "it was set back. Set it right and check again"
        raise HistoryError(f"{path}: {row}, and {clock}: {remedy}")
    if time > now or (checks and time <= checks[-1].time):
        why = clock if time > now else f"the last one of {checks[-1].day}"
        remedy = "set the clock, or state the true time with --time"
        raise HistoryError(f"{path}: the new check is of {_day(time)}, and {why}: {remedy}")


def continues(path: Path, before: Sequence[Check], check: Check, where: str) -> None:
    """Refuse a check that does not continue those before it; a remedy depends on where it is."""
    if not before:
        return
    in_file, first, why = where.startswith("row"), before[0], ""
    digests = [old.recording_digest for old in before]
    if check.recording_digest in digests:
        k = digests.index(check.recording_digest)
        why = f"({check.day}) holds the readings of row {k} ({before[k].day}): "
        why += f"one check is there twice; {_REMEDY}" if in_file else "it was checked already"
    elif check.robot_digest != first.robot_digest:
        both = (f"{c.robot} with {c.sensor} ({c.robot_digest})" for c in (check, first))
        why = f"is of {', row 0 of '.join(both)}: give each robot a folder of its own"
    elif check.time <= before[-1].time:
        why = f"is of {check.day}, not after row {len(before) - 1} ({before[-1].day}): "
        why += f"the rows are out of order; {_REMEDY}" if in_file else "give its true --time"
    elif check.q.shape != first.q.shape:
        why = f"has {len(check.q)} holds, row 0 {len(first.q)}: the plan was replaced; begin "
        why += "another folder"
    if why:
        raise HistoryError(f"{path}: {where} {why}")


def _day(time: datetime) -> str:
    """Date and time for people."""
    return f"{time:%Y-%m-%d %H:%M:%S} UTC"


def write(folder: Path, checks: Sequence[Check]) -> None:
    """Write all checks, atomically."""
    rows = [_columns(c) for c in checks]
    if any(list(r) != list(rows[0]) for r in rows):
        raise HistoryError(f"{folder / FILE}: its rows have other quantities: {_REMEDY}")
    data = {n: np.array([r[n] for r in rows]) for n in rows[0]}
    raw: dict[str, Any] = {"format": parquet.FORMAT, "kind": _KIND, "robot": checks[0].robot}
    parquet.write(folder / FILE, parquet.table_of(data, raw | carried_robot(checks[0].robot)))


def _columns(check: Check) -> dict[str, Any]:
    """Plain columns of a check as one row."""
    row: dict[str, Any] = {name: getattr(check, name) for name in _TEXTS}
    row["time"] = check.time.isoformat(timespec="milliseconds")
    row["temperature"] = check.temperature
    row |= dict(check.values)
    row |= {f"row.{CHANNELS[i]}.{CHANNELS[j]}": check.covariance[i, j] for i, j in _PAIRS}
    for p in range(len(check.q)):
        at = f"hold{p:02d}."
        row |= {f"{at}t": check.t[p], f"{at}rows": int(check.count[p])}
        row |= {f"{at}q{j + 1}": v for j, v in enumerate(check.q[p])}
        row |= {at + c: v for c, v in zip(CHANNELS, check.wrench[p], strict=True)}
    return row
