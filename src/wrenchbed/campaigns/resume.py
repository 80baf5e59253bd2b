"""A stopped run: whether it may continue by itself, and which poses its recording holds."""

import json
import re
import time
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from enum import IntEnum
from pathlib import Path

import numpy as np

from wrenchbed.data.metadata import Metadata
from wrenchbed.data.plan import Plan
from wrenchbed.data.recording import Recording
from wrenchbed.errors import DriverError, LimitError, LinkError, PlanError, SafetyStopError
from wrenchbed.hardware.drivers.base import Driver
from wrenchbed.hardware.drivers.live_base import LiveDriver
from wrenchbed.physics.wrench import CHANNELS

POSE, STARTED = "pose", "started"
"""Column with the plan's row, and metadata with the time of t = 0; both are needed to resume."""
Hold = tuple[float, np.ndarray]
"""Recorded rest at a pose: time of its last row [s] and its readings (n, 6) [N, N·m]."""
_HARMLESS = ("normal", "reduced", "quick stop")
"""Safety states after which a robot may move again unseen; the driver itself sends a quick stop."""
_NEAR = 0.05
"""Farthest from its pose that a recorded row may be [rad or m]: more than any compliance or
tracking error, less than the distance of two poses of a plan."""
_SAME = {
    "rate_hz": "give --rate", "sensor": "give --sensor", "sensor_box": "set the box",
    "wrench": "set the payload and give --sensor",
}  # fmt: skip
"""Metadata field that must not change within a recording → what a user can do to keep it."""


class Retries(IntEnum):
    """Most repeated attempts in a row without a person, by the cause of a driver's failure."""

    NEVER = 0
    """The robot protects itself or people, is in fault or off, or the load was too large."""
    STOPPED = 2
    """The robot is in order: its program, its watchdog or a deadline ended the move."""
    LINK = 11
    """Failure of the link or the reading."""


def retries(driver: Driver, error: DriverError) -> Retries:
    """Number of repetitions allowed after a driver's error, by the robot's present state."""
    if not driver.live or isinstance(error, LimitError | SafetyStopError):
        return Retries.NEVER
    arm = driver._arm_health() if isinstance(driver, LiveDriver) else driver.health()
    try:
        sample = driver.read()
    except DriverError:
        sample = None  # no state has arrived yet
    if arm.state == "fault":
        return Retries.NEVER
    if sample is not None:
        if sample.safety not in _HARMLESS or sample.mode == "fault":
            return Retries.NEVER
        at_rest = sample.mode == "idle" and not sample.program  # drives idle when stopped
        if arm.state == "stopped" and sample.mode != "running" and not at_rest:
            return Retries.NEVER
    unread = arm.state != "stopped" and not driver.health().ok
    return Retries.LINK if unread or isinstance(error, LinkError) else Retries.STOPPED


def bare(error: DriverError) -> str:
    """Message of a driver's error without its advice to programs (``call recover()``)."""
    return re.sub(r"(,? then|[:;,]) call recover\((unlock=True)?\)( again)?$", "", str(error))


@dataclass(frozen=True, eq=False)
class Before:
    """Content of the recording of an interrupted run, which a resumed run continues.

    Attributes:
        columns: name → column (N,), rows of complete poses only; empty if there are none.
        poses: numbers of the plan's rows that are done.
        elapsed: time since t = 0 [s].
        metadata: metadata of the recording.
        revisited: whether the second visit of the first pose is complete.
    """

    columns: Mapping[str, np.ndarray]
    poses: frozenset[int]
    elapsed: float
    metadata: Metadata
    revisited: bool

    def first(self, segment: int) -> Hold | None:
        """`Hold` (time, readings) of a ``segment``'s rows at the plan's first pose; None if
        none."""
        if not self.columns:
            return None
        rows = np.flatnonzero((self.columns[POSE] == 0) & (self.columns["segment"] == segment))
        if not len(rows):
            return None
        wrench = np.stack([self.columns[c][rows] for c in CHANNELS], axis=-1)
        return float(self.columns["t"][rows[-1]]), wrench


def second_visit(plan: Plan) -> int:
    """Segment number of the second visit of a plan's first pose, at the end of a run."""
    return int(plan.segment.max()) + 1


def before(path: Path, plan: Plan, needed: np.ndarray, metadata: Metadata) -> Before:
    """Read the recording of a plan's stopped run; an incomplete visit of a pose is dropped.

    ``needed`` (P,) are the rows that each pose needs, ``metadata`` those of the run to come. A
    `PlanError` if it is not of this plan, was recorded otherwise, or cannot be resumed; a
    `RecordingError` if it cannot be read.
    """
    if not path.exists():
        raise PlanError(f"{path}: there is no such recording to go on with: leave --resume out")
    old = Recording.read(path)
    if old.metadata.source != metadata.source:
        raise PlanError(
            f"{path}: was recorded with source {old.metadata.source!r}, not {metadata.source!r}: "
            "give --driver as it was, or another OUT"
        )
    if plan.mode != "static" or old.metadata.mode != "static":
        raise PlanError(f"{path}: a motion cannot be resumed: record it again")
    started = old.metadata.extra.get(STARTED)
    if not {POSE, "segment"} <= old.columns.keys() or not isinstance(started, str):
        raise PlanError(f"{path}: does not state which poses it holds: record it again")
    pose = old.columns[POSE].astype(int)
    if old.metadata.robot != plan.robot or pose.min() < 0 or pose.max() >= len(plan):
        raise PlanError(f"{path}: is not of the plan {plan.name}: give the plan it was made with")
    off = np.abs(old.q - plan.q[pose]).max(axis=1)
    if off.max() > _NEAR:
        row = int(np.argmax(off))
        raise PlanError(
            f"{path}: row {row} is not at pose {pose[row]} of {plan.name}: "
            "give the plan it was made with"
        )
    check_same(path, old.metadata, metadata)
    segment = old.columns["segment"]
    regular, second = segment == plan.segment[pose], segment == second_visit(plan)
    _check_samples(path, plan, pose[regular], needed)
    complete = np.flatnonzero(np.bincount(pose[regular], minlength=len(plan)) == needed)
    revisited = bool(second.sum() == needed[0]) and len(complete) == len(plan)
    keep = (regular & np.isin(pose, complete)) | (second & revisited)
    columns = {name: array[keep] for name, array in old.columns.items()} if keep.any() else {}
    elapsed = time.time() - datetime.fromisoformat(started).timestamp()
    return Before(columns, frozenset(int(k) for k in complete), elapsed, old.metadata, revisited)


def check_same(path: Path, old: Metadata, new: Metadata, kept: bool = True) -> None:
    """Raise a `PlanError` that names ``path`` if metadata ``old`` of its recording and ``new`` of
    the run differ; sensor zeros may, as the run watches them. ``kept``: the recording has rows."""
    was, asked = (json.loads(json.dumps(m.to_json())) for m in (old, new))
    for field, remedy in _SAME.items():
        a, b = was.get(field), asked.get(field)
        if isinstance(a, dict) and isinstance(b, dict):
            part = next((k for k in a | b if k != "bias" and a.get(k) != b.get(k)), "")
            field, a, b = f"{field}.{part}", a.get(part), b.get(part)
        if a != b:
            raise PlanError(
                f"{path}: was recorded with {field} = {a!r}, not {b!r}: {remedy} as it was "
                f"and go on: `record …{' --resume' * kept}`, or record anew"
            )


def _check_samples(path: Path, plan: Plan, pose: np.ndarray, needed: np.ndarray) -> None:
    """Raise a `PlanError` unless each pose (``pose`` (N,): its number) has its ``needed`` (P,)
    rows; the last may have fewer."""
    count = np.bincount(pose, minlength=len(plan))
    bad = (count > 0) & (count != needed)
    if len(pose):
        bad[pose[-1]] = count[pose[-1]] > needed[pose[-1]]
    for k in np.flatnonzero(bad)[:1]:
        was = f"--samples {count[k]}" if plan.dwell[k] == 0 else "the plan it was made with"
        raise PlanError(
            f"{path}: was recorded with {count[k]} samples at pose {k}, not {needed[k]}: "
            f"give {was}, or record anew"
        )
