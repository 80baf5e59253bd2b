"""The history of a robot's checks: one Parquet file, one row a check, written as a whole.

A row holds what was measured (the mean of each hold), so that a later version can judge the
complete history again, and the numbers that were identified from it. Each check's recording is kept
beside the file; the history can be made again from these.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
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
TEXTS = ("time", "robot", "robot_digest", "sensor", "recording", "recording_digest", "baseline",
         "verdict")  # fmt: skip
_UPPER = np.triu_indices(6)
_REMEDY = (
    "give --rebuild: the history is made again from DIR/recordings, the old file is kept with ~"
)


@dataclass(frozen=True, eq=False)
class Check:
    """One check.

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
        values: numbers identified from it, with ``.std`` [SI]; ``misfit``.
        correlated: covariance of the values (K, K), in the order of their names.
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
    correlated: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))

    @property
    def day(self) -> str:
        """The time for people."""
        return f"{self.time:%Y-%m-%d %H:%M:%S} UTC"


def digest(robot: Robot, sensor: str) -> str:
    """16 digits of the SHA-256 of what is known of a robot: name, description, numbers, sensor."""
    known = [
        robot.name, carried_robot(robot.name), robot.parameters.nominal.tolist(),
        list(robot.gravity), sensor,
    ]  # fmt: skip
    return hashlib.sha256(json.dumps(known).encode()).hexdigest()[:16]


def digest_of(*arrays: np.ndarray) -> str:
    """16 digits of the SHA-256 of measured numbers: a copy under another name has the same."""
    found = hashlib.sha256()
    for array in arrays:
        found.update(np.ascontiguousarray(array, dtype=float).tobytes())
    return found.hexdigest()[:16]


def read(folder: Path) -> list[Check]:
    """All checks of a history, the oldest first; none where there is no file.

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
    checks = [_row(path, columns, k) for k in range(len(next(iter(columns.values()))))]
    for k, check in enumerate(checks):
        _agrees(path, checks[:k], check, f"row {k}")
    return checks


def agrees(folder: Path, checks: Sequence[Check], new: Check, now: datetime) -> None:
    """Refuse a check that does not continue a history.

    Raises:
        HistoryError: it is a copy of an old one, not later than the last one, or of another robot;
            or this machine's clock is behind.
    """
    for k, old in enumerate(checks):
        if new.recording_digest == old.recording_digest:
            raise HistoryError(
                f"{folder / FILE}: the new check holds the readings of row {k} ({old.day}): it was "
                "checked already. Record anew"
            )
    in_time(folder, checks, new.time, now)
    _agrees(folder / FILE, checks, new, "the new check")


def in_time(folder: Path, checks: Sequence[Check], time: datetime, now: datetime) -> None:
    """Refuse the time of a new check that this machine's clock contradicts.

    Raises:
        HistoryError: names the row and the remedy.
    """
    path, shown = folder / FILE, f"{now:%Y-%m-%d %H:%M:%S} UTC"
    if checks and checks[-1].time > now:
        raise HistoryError(
            f"{path}: row {len(checks) - 1} is of {checks[-1].day}, and this machine's clock shows "
            f"{shown}: it was set back. Set it right and check again"
        )
    if time > now:
        raise HistoryError(
            f"{path}: the new check is of {time:%Y-%m-%d %H:%M:%S} UTC, and this machine's clock "
            f"shows {shown}: set the clock, or state the true time with --time"
        )
    if checks and time <= checks[-1].time:
        raise HistoryError(
            f"{path}: the new check is of {time:%Y-%m-%d %H:%M:%S} UTC, not after row "
            f"{len(checks) - 1} ({checks[-1].day}): the clock was set back, or the recording is an "
            "old one. State the true time with --time, or check recordings in the order of time"
        )


def write(folder: Path, checks: Sequence[Check]) -> None:
    """Write all checks, atomically."""
    rows = [_columns(c) for c in checks]
    if any(list(r) != list(rows[0]) for r in rows):
        raise HistoryError(f"{folder / FILE}: its rows have other quantities: {_REMEDY}")
    data = {n: np.array([r[n] for r in rows]) for n in rows[0]}
    raw: dict[str, Any] = {"format": parquet.FORMAT, "kind": _KIND, "robot": checks[0].robot}
    parquet.write(folder / FILE, parquet.table_of(data, raw | carried_robot(checks[0].robot)))


_KIND = "history of checks"


def _agrees(path: Path, before: Sequence[Check], check: Check, where: str) -> None:
    """Refuse a check that does not continue those before it."""
    for k, old in enumerate(before):
        if check.recording_digest == old.recording_digest:
            raise HistoryError(
                f"{path}: {where} ({check.day}) holds the readings of row {k} ({old.day}): one "
                f"check is there twice; {_REMEDY}"
            )
    if before and check.robot_digest != before[0].robot_digest:
        raise HistoryError(
            f"{path}: {where} is of {check.robot} with {check.sensor} ({check.robot_digest}), row "
            f"0 of {before[0].robot} with {before[0].sensor} ({before[0].robot_digest}): give each "
            "robot a folder of its own"
        )
    if before and check.time <= before[-1].time:
        raise HistoryError(
            f"{path}: {where} is of {check.day}, not after row {len(before) - 1} "
            f"({before[-1].day}): the rows are out of order; {_REMEDY}"
        )
    if before and check.q.shape != before[0].q.shape:
        raise HistoryError(
            f"{path}: {where} has {len(check.q)} holds, row 0 {len(before[0].q)}: the plan was "
            "replaced; begin another folder"
        )


def _columns(check: Check) -> dict[str, Any]:
    """A check as one row of plain columns."""
    row: dict[str, Any] = {name: getattr(check, name) for name in TEXTS}
    row["time"] = check.time.isoformat(timespec="milliseconds")
    row["temperature"] = check.temperature
    row |= dict(check.values)
    row["covariance"] = json.dumps(check.correlated.tolist())
    spread = check.covariance[_UPPER]
    row |= {f"row.{CHANNELS[i]}.{CHANNELS[j]}": spread[k] for k, (i, j) in enumerate(_PAIRS)}
    for p in range(len(check.q)):
        at = f"hold{p:02d}."
        row |= {f"{at}t": check.t[p], f"{at}rows": int(check.count[p])}
        row |= {f"{at}q{j + 1}": v for j, v in enumerate(check.q[p])}
        row |= {at + c: v for c, v in zip(CHANNELS, check.wrench[p], strict=True)}
    return row


_PAIRS = list(zip(*(x.tolist() for x in _UPPER), strict=True))


def _row(path: Path, columns: Mapping[str, np.ndarray], k: int) -> Check:
    """One row as a check.

    Raises:
        HistoryError: a column is missing or a number is none; names column and row.
    """

    def number(name: str) -> float:
        value = _cell(path, columns, name, k)
        try:
            found = float(value)
        except (TypeError, ValueError):
            found = np.nan
        if not np.isfinite(found):
            raise HistoryError(f"{path}: column {name!r}, row {k}: {value!r} is no finite number")
        return found

    texts = {name: str(_cell(path, columns, name, k)) for name in TEXTS}
    try:
        time = datetime.fromisoformat(texts.pop("time"))
        if time.tzinfo is None:
            raise ValueError
        correlated = np.array(json.loads(str(_cell(path, columns, "covariance", k))), dtype=float)
    except ValueError as error:
        raise HistoryError(
            f"{path}: row {k}: time or covariance cannot be read: {_REMEDY}"
        ) from error
    holds = sum(n.endswith(".rows") for n in columns)
    joints = sum(n.startswith("hold00.q") for n in columns)
    spread = np.zeros((6, 6))
    for i, j in _PAIRS:
        spread[i, j] = spread[j, i] = number(f"row.{CHANNELS[i]}.{CHANNELS[j]}")
    at = [f"hold{p:02d}." for p in range(holds)]
    fixed = {*TEXTS, "temperature", "covariance"}
    named = [n for n in columns if n not in fixed and not n.startswith(("hold", "row."))]
    return Check(
        time=time.astimezone(UTC),
        temperature=float(_cell(path, columns, "temperature", k)),
        t=np.array([number(f"{a}t") for a in at]),
        q=np.array([[number(f"{a}q{j + 1}") for j in range(joints)] for a in at]),
        wrench=np.array([[number(a + c) for c in CHANNELS] for a in at]),
        count=np.array([number(f"{a}rows") for a in at]),
        covariance=spread,
        values={n: number(n) for n in named},
        correlated=correlated,
        **texts,
    )


def _cell(path: Path, columns: Mapping[str, np.ndarray], name: str, k: int) -> Any:
    if name not in columns:
        raise HistoryError(f"{path}: column {name!r} is missing: {_REMEDY}")
    return columns[name][k]
