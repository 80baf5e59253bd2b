"""Which rows of unknown columns are one pose: groups of rows to fit to, and the mode they mean."""

from dataclasses import dataclass

import numpy as np

from wrenchbed.data.column_map import AUTO
from wrenchbed.data.holds import split
from wrenchbed.data.metadata import Metadata
from wrenchbed.data.recording import Recording
from wrenchbed.errors import RecordingError
from wrenchbed.physics.wrench import CHANNELS

_LEAST_HOLDS = 4
_BINS = 300
"""Parts into which a motion is cut."""
_MOST_POSES = 5000
"""Rows that may all be poses of their own; of more, some are chosen."""
_STILL = 1e-3
"""Share of a column's range below which it did not change."""
_JUMP = 0.01
"""Share of a column's range by which neighbouring poses differ; estimates."""


@dataclass(frozen=True, eq=False)
class Poses:
    """Rows gathered.

    Attributes:
        mode: of the recording that they mean.
        groups: begin and end of the rows of each pose (G, 2).
    """

    mode: str
    groups: np.ndarray

    @property
    def middle(self) -> np.ndarray:
        """A row in the middle of each pose (G,)."""
        return np.asarray(self.groups.sum(axis=1) // 2)

    def mean(self, values: np.ndarray) -> np.ndarray:
        """Means (G, K) of columns (N, K)."""
        total = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
        low, high = self.groups.T
        return np.asarray((total[high] - total[low]) / (high - low)[:, None])


def gather(t: np.ndarray | None, turn: np.ndarray, wrench: np.ndarray) -> Poses:
    """Find the poses.

    Args:
        t: clock (N,) [s], if there is one.
        turn: columns of an orientation or of joints, in any convention (N, K).
        wrench: (N, 6) in any unit.
    """
    n = len(turn)
    reach = np.maximum(np.ptp(turn, axis=0), 1e-9)
    change = (np.abs(np.diff(turn, axis=0)) / reach).max(axis=1) if n > 1 else np.zeros(0)
    moved = change > _STILL
    edges = np.concatenate([[0], np.flatnonzero(moved) + 1, [n]])
    groups = np.stack([edges[:-1], edges[1:]], axis=1)
    if t is None or (n <= _MOST_POSES and len(change) and np.median(change) > _JUMP):
        return Poses("static", groups[:: 1 + len(groups) // _MOST_POSES])
    long = groups[:, 1] - groups[:, 0] > 1
    if long.all() and len(groups) >= _LEAST_HOLDS:
        highest, lowest = (f.reduceat(turn, edges[:-1]) for f in (np.maximum, np.minimum))
        if ((highest - lowest) / reach).max() < _JUMP:  # else they creep on from row to row
            return Poses("static", groups)
    columns = {"t": t - t[0]} | {f"q{k + 1}": turn[:, k] for k in range(turn.shape[1])}
    columns |= dict(zip(CHANNELS, wrench.T, strict=True))
    try:
        hold = split(Recording(Metadata("unknown", "dynamic"), columns)).hold
    except RecordingError:
        hold = np.full(n, -1)
    if hold.max() + 1 >= _LEAST_HOLDS:
        numbers, first, length = np.unique(hold, return_index=True, return_counts=True)
        rest = numbers >= 0
        return Poses(AUTO, np.stack([first[rest], (first + length)[rest]], axis=1))
    ends = np.unique(np.linspace(0, n, min(n, _BINS) + 1).astype(int))
    return Poses("dynamic", np.stack([ends[:-1], ends[1:]], axis=1))
