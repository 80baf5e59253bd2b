"""Holds: the rows of a recording at rest, gathered pose by pose, with the noise they show."""

from dataclasses import dataclass

import numpy as np

from wrenchbed.recording import Recording

MOVING = 1e-4
MOVING_WITHIN_SEGMENT = 1e-3
"""Steps of joint values (or quaternion components) below these are one pose [rad or m]."""


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
    q, y, t = recording.q[keep], recording.wrench[keep], recording.t[keep]
    segment = recording.columns.get("segment")
    step = np.abs(np.diff(q, axis=0)).max(axis=1)
    change = step > (MOVING if segment is None else MOVING_WITHIN_SEGMENT)
    if segment is not None:
        change |= np.diff(segment[keep]) != 0
    starts = np.concatenate([[0], np.flatnonzero(change) + 1])
    count = np.diff(np.append(starts, len(t)))
    mean = np.add.reduceat(y, starts) / count[:, None]
    dof = len(t) - len(starts)
    covariance = None
    if dof > 0:
        scatter = y - np.repeat(mean, count, axis=0)
        covariance = scatter.T @ scatter / dof
    middle = np.add.reduceat(q, starts) / count[:, None]
    return Holds(np.add.reduceat(t, starts) / count, middle, mean, count, covariance, dof, starts)
