"""Holds: the rows of a recording at rest, averaged pose by pose, and the noise within them."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from wrenchbed.data.recording import QUATERNION, Recording, joint_columns
from wrenchbed.physics.wrench import CHANNELS

MOVING = 1e-4
MOVING_WITHIN_SEGMENT = 1e-3
"""Steps of joint values (or quaternion components) below these are one pose [rad or m]."""
NEAR_ROWS = 25
"""Rows before and behind a step of a segment whose means tell a move from noise; estimate."""
ROWS_AT_ONCE = 500_000
"""Rows processed together: this bounds the memory that a long recording needs."""


@dataclass(frozen=True, eq=False)
class Holds:
    """H poses at rest.

    Attributes:
        t: mean time (H,) [s].
        q: joint values (H, J) or orientations (H, 4).
        wrench: mean reading (H, 6) [N, N·m].
        count: rows in each hold (H,).
        row_covariance: of one row about its hold's mean (6, 6), None without repeats.
        dof: degrees of freedom behind it.
        rows: index of each hold's first row among those kept (H,).
    """

    t: np.ndarray
    q: np.ndarray
    wrench: np.ndarray
    count: np.ndarray
    row_covariance: np.ndarray | None
    dof: int
    rows: np.ndarray

    def __len__(self) -> int:
        return len(self.t)


def gather(recording: Recording, keep: np.ndarray) -> Holds:
    """Average consecutive rows of one segment with unmoving joints.

    Args:
        recording: at rest in each hold.
        keep: rows to use (N,), boolean.
    """
    names = recording.joints or QUATERNION
    columns = recording.columns
    if not keep.all():
        used = {"t", "segment", *names, *CHANNELS} & columns.keys()
        columns = {name: columns[name][keep] for name in used}
    starts = first_rows(columns)
    rows = len(columns["t"])
    count = np.diff(np.append(starts, rows))

    def mean(name: str) -> np.ndarray:
        return np.asarray(np.add.reduceat(columns[name], starts, dtype=float) / count)

    middle, wrench = (np.stack([mean(n) for n in some], axis=1) for some in (names, CHANNELS))
    dof = rows - len(starts)
    covariance = None
    if dof > 0:
        channels = [columns[c] for c in CHANNELS]
        covariance = sum(r.T @ r for _, r in about_means(channels, wrench, count)) / dof
    return Holds(mean("t"), middle, wrench, count, covariance, dof, starts)


def first_rows(columns: Mapping[str, np.ndarray]) -> np.ndarray:
    """Index of each hold's first row (H,): a segment begins, or the joints moved.

    Args:
        columns: of a recording (N,): joints or an orientation, perhaps ``segment``.
    """
    names = joint_columns(columns) or QUATERNION
    segment = columns.get("segment")
    limit = MOVING if segment is None else MOVING_WITHIN_SEGMENT
    rows = len(columns[names[0]])
    change = np.zeros(rows - 1, dtype=bool) if segment is None else np.diff(segment) != 0
    begin = np.concatenate([[0], np.flatnonzero(change) + 1, [rows]])
    for name in names:
        jumps = np.abs(np.diff(columns[name])) > limit
        if segment is not None and jumps.any():
            jumps[jumps] = _stays_away(columns[name], np.flatnonzero(jumps), limit, begin)
        change = change | jumps
    return np.concatenate([[0], np.flatnonzero(change) + 1])


def _stays_away(
    values: np.ndarray, jumps: np.ndarray, limit: float, begin: np.ndarray
) -> np.ndarray:
    """Whether values (N,) are elsewhere behind a jump than before it: noise comes back.

    Rows of the same segment are compared; ``begin`` (S + 1,) is where each begins, and N.
    """
    total = np.concatenate([[0.0], np.cumsum(values - values[0], dtype=float)])
    here = jumps + 1  # the first row behind the jump
    own = np.searchsorted(begin, jumps, side="right") - 1
    low = np.maximum(here - NEAR_ROWS, begin[own])
    high = np.minimum(here + NEAR_ROWS, np.maximum(begin[own + 1], here + 1))
    before = (total[here] - total[low]) / (here - low)
    behind = (total[high] - total[here]) / (high - here)
    return np.asarray(np.abs(behind - before) > limit)


def about_means(
    rows: Sequence[np.ndarray], mean: np.ndarray, count: np.ndarray
) -> Iterator[tuple[slice, np.ndarray]]:
    """Rows minus their hold's mean (n, 6) of some complete holds at a time: (holds, rows).

    Args:
        rows: six channels (N,) [N, N·m].
        mean: of each hold (H, 6).
        count: rows of each hold (H,).
    """
    for some, at in parts(count):
        residual = np.stack([y[at] for y in rows], axis=1, dtype=float)
        residual -= np.repeat(mean[some], count[some], axis=0)
        yield some, residual


def parts(count: np.ndarray) -> Iterator[tuple[slice, slice]]:
    """Some complete holds (H,) at a time, by the number of rows of each: (holds, rows)."""
    ends = np.cumsum(count)
    first = row = 0
    while first < len(count):
        last = max(first + 1, int(np.searchsorted(ends, row + ROWS_AT_ONCE, side="right")))
        yield slice(first, last), slice(row, int(ends[last - 1]))
        first, row = last, int(ends[last - 1])
