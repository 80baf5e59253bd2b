"""A campaign that was stopped: what its recording holds, and which poses are still to come."""

import time
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from wrenchbed.errors import PlanError
from wrenchbed.metadata import Metadata
from wrenchbed.plan import Plan
from wrenchbed.recording import Recording

POSE, STARTED = "pose", "started"
"""Column with the plan's row, and metadata with the time of t = 0, by which a campaign goes on."""


@dataclass(frozen=True, eq=False)
class Before:
    """What was recorded before.

    Attributes:
        columns: rows of whole poses (N,) by name; empty if there are none.
        poses: rows of the plan that are done.
        elapsed: time since t = 0 [s].
        metadata: of the recording.
    """

    columns: Mapping[str, np.ndarray]
    poses: frozenset[int]
    elapsed: float
    metadata: Metadata


def before(path: Path, plan: Plan, needed: np.ndarray) -> Before:
    """Read a stopped campaign's recording.

    Args:
        path: of the recording.
        plan: that it followed.
        needed: rows that each pose of the plan needs (P,).

    Raises:
        PlanError: it is not of this plan, or cannot be gone on with.
        RecordingError: it cannot be read.
    """
    old = Recording.read(path)
    if plan.mode != "static" or old.metadata.mode != "static":
        raise PlanError(f"{path}: a motion cannot be resumed: record it again")
    started = old.metadata.extra.get(STARTED)
    if POSE not in old.columns or not isinstance(started, str):
        raise PlanError(f"{path}: does not say which poses it holds: record it again")
    pose = old.columns[POSE].astype(int)
    if old.metadata.robot != plan.robot or pose.min() < 0 or pose.max() >= len(plan):
        raise PlanError(f"{path}: is not of the plan {plan.name}: give the plan it was made with")
    off = np.abs(old.q - plan.q[pose]).max(axis=1)
    if off.max() > 0.05:
        row = int(np.argmax(off))
        raise PlanError(
            f"{path}: row {row} is not at pose {pose[row]} of {plan.name}: "
            "give the plan it was made with"
        )
    count = np.bincount(pose, minlength=len(plan))
    whole = np.flatnonzero(count >= needed)
    keep = np.isin(pose, whole)
    columns = {name: array[keep] for name, array in old.columns.items()}
    elapsed = time.time() - datetime.fromisoformat(started).timestamp()
    return Before(columns, frozenset(int(k) for k in whole), elapsed, old.metadata)


def now() -> str:
    """The present in ISO 8601, UTC."""
    return datetime.now(UTC).isoformat(timespec="milliseconds")
