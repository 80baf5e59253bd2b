"""The history of a robot's checks: the recordings in its folder, and a table of their results.

Checks are read from their recordings each time, so that a later version judges all of them alike;
without its recording a check is gone. The table is one Parquet file, written as a whole: one row a
check, with the mean of each hold and the numbers fitted to these.
"""

import hashlib
import json
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from itertools import combinations_with_replacement
from pathlib import Path
from typing import Any

import numpy as np

from wrenchbed.calibration.observations import observe
from wrenchbed.calibration.subtracted_payload import restored
from wrenchbed.data import parquet
from wrenchbed.data.metadata import model_field
from wrenchbed.data.plan import Plan
from wrenchbed.data.recording import Recording
from wrenchbed.errors import HistoryError, RecordingError, WrenchbedError, WrenchbedWarning
from wrenchbed.files import set_aside
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.robots.base import Robot

FILE, RECORDINGS = "history.parquet", "recordings"
"""Names of the table and of the folder of recordings in the folder of a history."""
_KIND, _DAY = "history of checks", "%Y-%m-%d %H:%M:%S UTC"
"""What the table's metadata state that it is, and the form of dates for people."""
_TEXTS = ("robot", "robot_digest", "sensor", "recording", "recording_digest", "baseline", "verdict")
_PAIRS = tuple(combinations_with_replacement(range(6), 2))
"""Indices (row, column) of the upper triangle of a row's covariance (6, 6), as stored."""
_STATED = "check"
"""Metadata field of a recording with a user's statements: time, temperature, baseline."""
_FAR = 0.02
"""Largest distance of a pose from the plan's [rad or m]: the effect of 0.02 rad on readings is
corrected with the joint values that were measured."""


@dataclass(frozen=True, eq=False)
class Check:
    """One check of a robot, as its history stores it.

    Attributes:
        time: when it was recorded.
        robot, sensor: registry names.
        robot_digest: 16 digits of the SHA-256 of what is known of robot and sensor.
        recording, recording_digest: file in `RECORDINGS`, SHA-256 of what was measured.
        temperature: temperature of the sensor, else of the room [°C]; NaN if not known.
        t: mean times of the P holds (rests at poses) (P,) [s].
        q: joint values of the holds (P, J) [rad or m].
        wrench: mean readings of the holds (P, 6) [N, N·m].
        count: rows of each hold (P,).
        covariance: covariance of one row (6, 6).
        baseline: why history begins anew with this check; empty if it does not.
        verdict: verdict that was given at the time.
        values: name → number fitted to the check, ``NAME.std`` → its std [SI]; ``misfit``.
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
        """Date and time of the check as text for people."""
        return f"{self.time:{_DAY}}"


def read(folder: Path, robot: Robot, plan: Plan) -> list[Check]:
    """Read the checks in a folder, oldest first; warn of recordings that do not follow ``plan``."""
    checks = list[Check]()
    for path in sorted((folder / RECORDINGS).glob("*.parquet")):  # whose names are their times
        try:
            recording = Recording.read(path)
            if _STATED in recording.metadata.extra:  # else its check was not finished
                check = taken(recording, robot, plan)
                continues(checks, check)
                checks.append(replace(check, recording=f"{RECORDINGS}/{path.name}"))
        except WrenchbedError as error:
            warnings.warn(f"{path}: left out: {error}", WrenchbedWarning, stacklevel=2)
    return sorted(checks, key=lambda c: c.time)


def stated(recording: Recording, given: Mapping[str, Any]) -> Recording:
    """Copy of a recording whose metadata hold what a user states of a check: ``given`` time,
    temperature, baseline."""
    extra = recording.metadata.extra
    extra = {**extra, _STATED: {**(extra.get(_STATED) or {}), **given}}
    return replace(recording, metadata=replace(recording.metadata, extra=extra))


def time_of(recording: Recording) -> datetime:
    """Time at which a recording was made by its metadata; a `HistoryError` if that is no ISO 8601
    time with a zone."""
    extra = recording.metadata.extra
    text = (extra.get(_STATED) or {}).get("time") or extra.get("started")
    if text is None:
        raise HistoryError(f"{recording.name}: states no time; give --time 2026-11-23T06:00:00Z")
    return parse_time(str(text), recording.name)


def parse_time(text: str, where: str) -> datetime:
    """Parse an ISO 8601 time and convert it to UTC; a `HistoryError`, which begins with ``where``,
    if it lacks a zone."""
    try:
        time = datetime.fromisoformat(text)
    except ValueError:
        time = datetime.min
    if time.tzinfo is None:
        raise HistoryError(
            f"{where}: {text!r} is no time with a zone: give it as 2026-11-23T06:00:00Z"
        )
    return time.astimezone(UTC)


def file_of(time: datetime) -> str:
    """Path of a check's recording in the history's folder, named after its time."""
    return f"{RECORDINGS}/{time:%Y%m%dT%H%M%SZ}.parquet"


def taken(recording: Recording, robot: Robot, plan: Plan) -> Check:
    """Make a check (mean reading at each rest, covariance of a row) from a recording with its time.
    A `HistoryError` if it states none; a `RecordingError` for another robot, a motion, or other
    poses than the plan's, the first of which it names."""
    time, metadata = time_of(recording), recording.metadata
    if metadata.robot != robot.name or metadata.mode != "static" or not recording.joints:
        raise RecordingError(
            f"{recording.name}: is of {metadata.robot} ({metadata.mode}); a check needs "
            f"{robot.name} at rest in the poses of {plan.name}"
        )
    data, poses = observe(restored(recording)), len(plan)
    q = np.asarray(data.q)
    known = min(len(q), poses)
    far = np.abs(q[:known] - plan.q[:known]).max(axis=1) > _FAR
    if known < poses or far.any():
        first = known if known < poses else int(np.argmax(far))
        raise RecordingError(
            f"{recording.name}: holds {len(q)} poses; pose {first} is not that of {plan.name}: "
            f"record that plan (wrenchbed record --robot {robot.name} --plan {plan.name} --out …)"
        )
    said = metadata.extra.get(_STATED) or {}
    warm = recording.columns.get("temperature")
    temperature = said.get("temperature", np.nan) if warm is None else np.mean(warm)
    sensor = metadata.sensor.model or robot.sensor
    nominal = robot.parameters.nominal.tolist()
    known_robot = [robot.name, model_field(robot.name), nominal, list(robot.gravity), sensor]
    return Check(
        time=time, robot=robot.name, sensor=sensor,
        robot_digest=_digest(json.dumps(known_robot).encode()), recording=file_of(time),
        recording_digest=_digest(recording.wrench.tobytes() + recording.t.tobytes()),
        temperature=float(temperature), t=data.t[:poses], q=q[:poses], wrench=data.wrench[:poses],
        count=data.count[:poses].astype(float), covariance=data.row_covariance,
        baseline=str(said.get("baseline", "")),
    )  # fmt: skip


def _digest(content: bytes) -> str:
    """First 16 hexadecimal digits of the SHA-256."""
    return hashlib.sha256(content).hexdigest()[:16]


def in_time(checks: Sequence[Check], time: datetime, now: datetime) -> None:
    """Raise a `HistoryError` if a new check at ``time`` is not later than the last one, or one of
    both is after ``now``; it names both, and the remedy."""
    last = checks[-1] if checks else None
    if time > now or (last is not None and not last.time < time):
        before = "" if last is None else f"{last.recording} of {last.day}, and "
        raise HistoryError(
            f"the new check is of {time:{_DAY}}, {before}this machine's clock shows {now:{_DAY}}: "
            "set the clock right, or state the true time with --time"
        )


def continues(before: Sequence[Check], check: Check, where: str = "") -> None:
    """Raise `HistoryError`, which begins with ``where``, if ``check`` has the readings of one
    ``before`` or is of another sensor."""
    for old in before:
        if old.recording_digest == check.recording_digest:
            text = f"holds the readings of {old.recording}: it was checked already"
            raise HistoryError(where + text)
        if old.sensor != check.sensor:
            raise HistoryError(
                f"{where}is of {check.sensor}, {old.recording} of {old.sensor}: give each sensor a "
                "folder of its own"
            )


def write(folder: Path, checks: Sequence[Check]) -> None:
    """Write the table of all checks; an existing one of other recordings is kept as NAME~."""
    rows, path = [_columns(c) for c in checks], folder / FILE
    try:
        old: Any = parquet.read(path, HistoryError)[0] if path.exists() else {"recording": ()}
    except HistoryError:
        old = {}
    if not {*map(str, old.get("recording", [path]))} <= {c.recording for c in checks}:
        kept = set_aside(path)
        text = f"{path}: holds what {RECORDINGS} does not: it is kept as {kept}"
        warnings.warn(text, WrenchbedWarning, stacklevel=2)
    data = {n: np.array([r[n] for r in rows]) for n in rows[0]}
    raw: dict[str, Any] = {"format": parquet.FORMAT, "kind": _KIND, "robot": checks[0].robot}
    parquet.write(path, parquet.table_of(data, raw | model_field(checks[0].robot)))


def _columns(check: Check) -> dict[str, Any]:
    """Column → value of a check's row in the table."""
    row: dict[str, Any] = {"time": check.time.isoformat(timespec="milliseconds")}
    row |= {name: getattr(check, name) for name in (*_TEXTS, "temperature")} | dict(check.values)
    row |= {f"row.{CHANNELS[i]}.{CHANNELS[j]}": check.covariance[i, j] for i, j in _PAIRS}
    for p in range(len(check.q)):
        at = f"hold{p:02d}."
        row |= {f"{at}t": check.t[p], f"{at}rows": int(check.count[p])}
        row |= {f"{at}q{j + 1}": v for j, v in enumerate(check.q[p])}
        row |= {at + c: v for c, v in zip(CHANNELS, check.wrench[p], strict=True)}
    return row
