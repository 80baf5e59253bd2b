"""Values that repeat: a channel's quantisation step, its limits, and rows that were sent again."""

from dataclasses import dataclass

import numpy as np

from wrenchbed.data.recording import Recording

ON = 0.1
"""Largest error, in steps, of a value that counts as a multiple of a quantisation step."""
ALL = 0.97
"""Least share of changes between rows that are multiples of a quantisation step."""
LEAST_STEPS = 20
"""Fewest changes between rows from which a quantisation step is estimated."""
EXACT = 1e-9
"""Difference over the channel's range below which two values are the same number."""
FAR, FAR_TO_NEAR = 11, 1.5
"""Distance [rows] at which only coarse quantisation repeats a row, and factor by which neighbours
may repeat more often."""
FEW = 0.015
"""Least share of repeats, beyond that of coarse quantisation, from which rows are stale."""
DEVICES = (0, 1, 2), (3, 4, 5)
"""Groups of channels that a device may deliver alone: a single clipped channel is not one."""
WINDOW = 64
"""Number of rows over which a channel's own share of repeats is averaged."""
_ROUNDS, _CERTAIN = 50, 1e-6
"""Rounds in which a share of chance repeats settles, and the least chance of none."""
LEAST_PILE, PILE = 3, 5.0
"""Fewest readings at exactly a channel's least or largest value for it to be a limit, and least
ratio of their number to that at any value between: coarse quantisation repeats all values."""


def at_limits(wrench: np.ndarray) -> np.ndarray:
    """Whether each reading (N, 6) is at a limit of its channel, at which many readings pile up."""
    result = np.zeros(wrench.shape, dtype=bool)
    for y, at in zip(wrench.T, result.T, strict=True):
        values, count = np.unique(y, return_counts=True)
        if len(values) < LEAST_PILE:
            continue
        least = max(LEAST_PILE, PILE * (count[1:-1].max() - 1))
        for end in (0, -1):
            if count[end] >= least:
                at |= y == values[end]
    return result


@dataclass(frozen=True)
class Step:
    """Quantisation step of a channel with its standard uncertainty [N or N·m]."""

    value: float
    std: float


def step(y: np.ndarray) -> Step | None:
    """Largest step of which all values of a channel (N,) are multiples; None if continuous."""
    reach = float(np.ptp(y))
    if reach <= 0.0:
        return None
    gaps = np.diff(np.unique(y))
    gaps = gaps[gaps > EXACT * reach]
    if len(gaps) < 3:
        return None
    d = np.abs(np.diff(y))
    d = d[d > EXACT * reach]
    if len(d) < LEAST_STEPS:
        return None
    d = np.concatenate([d, gaps])  # of one row a pose few changes are of a few steps
    for candidate in sorted(np.quantile(gaps, [0.0, 0.05, 0.25, 0.5]), reverse=True):
        refined = _refined(d, float(candidate))
        if refined is not None:
            return refined
    return None


def _refined(d: np.ndarray, size: float) -> Step | None:
    """Step about ``size`` fitted to differences d (n,) of values; None if they do not lie on it."""
    d = np.sort(d)
    reach = 4.0
    while True:
        near = d[d < (reach + 0.5) * size]
        k = np.round(near / size)
        if (k > 0).sum() < 3:
            return None
        size = float((near @ k) / (k @ k))
        if len(near) == len(d):
            break
        reach *= 2.0
    k = np.round(d / size)
    off = d - k * size
    if np.mean((np.abs(off) < ON * size) & (k > 0)) < ALL:
        return None
    return Step(size, float(np.sqrt((off @ off) / max(len(d) - 1, 1) / (k @ k))))


class Repeats:
    """Rows that repeat the row before.

    Args:
        again: whether each row but the first repeats the one before (N − 1,), boolean.

    Attributes:
        stale: whether each row repeats the one before (N,), boolean.
        share: share of repeated rows.
        std: standard uncertainty of the share.
        expected: share to expect from coarse quantisation alone.
        length: mean length of a run of repeats [rows].
        channels: indices of the channels that repeat.
    """

    def __init__(self, again: np.ndarray, expected: float, channels: tuple[int, ...]) -> None:
        self.stale = np.concatenate([[False], again])
        self.share, self.expected, self.channels = float(self.stale.mean()), expected, channels
        runs = int(np.count_nonzero(np.diff(self.stale.astype(int)) == 1))
        self.length = float(self.stale.sum() / runs) if runs else 0.0
        spread = self.share * (1.0 - self.share) * max(1.0, 2.0 * self.length - 1.0)
        self.std = float(np.sqrt(spread / len(self.stale)))

    @property
    def some(self) -> bool:
        """Whether rows repeat more often than quantisation explains."""
        return bool(self.channels) and self.share >= self.expected + FEW


def repeats(recording: Recording) -> Repeats:
    """Find repeats of rows in all channels, else in continuous forces or torques alone."""
    wrench = recording.wrench
    same = wrench[1:] == wrench[:-1]
    all_same = same.all(axis=1)
    others = same[~all_same]
    if len(others) < 2 * WINDOW:
        return Repeats(all_same, 1.0, ())
    expected = max(_chance(others), FAR_TO_NEAR * _far(wrench, all_same), _in_any_order(recording))
    result = Repeats(all_same, expected, (0, 1, 2, 3, 4, 5))
    if result.share > result.expected + 0.01:
        return result
    for group in DEVICES:
        again = same[:, group[0]]
        together = all(np.array_equal(same[:, k], again) for k in group)
        if together and again.mean() > 0.02 and all(_continuous(wrench[:, k]) for k in group):
            return Repeats(again, 0.0, group)
    return result


def _chance(same: np.ndarray) -> float:
    """Share of repeats in all channels to expect from quantisation, for repeats by channel (M, 6)
    of the rows that do not repeat in all.

    Independent channels with shares s among those rows repeat together in a share P = Π (s + P (1 −
    s)) of all rows. Expected is its root, window by window: between that and what fully correlated
    channels make.
    """
    used = len(same) // WINDOW * WINDOW
    share = same[:used].reshape(-1, WINDOW, 6).mean(axis=1)
    alone = share.prod(axis=1)
    for _ in range(_ROUNDS):
        alone = (share + alone[:, None] * (1.0 - share)).prod(axis=1)
    together = np.sqrt(alone)
    odds = float((together / np.maximum(1.0 - together, _CERTAIN)).mean())
    return odds / (1.0 + odds)


def _far(wrench: np.ndarray, all_same: np.ndarray) -> float:
    """Share of rows equal to the one `FAR` rows before with others between, as only quantised rows
    are; ``all_same`` (N − 1,): mask of rows equal to the one before."""
    changes = np.concatenate([[0], np.cumsum(~all_same)])
    same = (wrench[FAR:] == wrench[:-FAR]).all(axis=1)
    return float(np.mean(same & (changes[FAR:] > changes[:-FAR])))


def _in_any_order(recording: Recording) -> float:
    """Share of repeats to expect if the rows of each pose came in random order, as by coarse
    quantisation; 0 where no value comes back, as if rows are sent again.

    Among n rows of a pose, c equal ones make (c − 1) c / n repeats on average.
    """
    pose = recording.columns.get("segment", np.zeros(len(recording)))
    rows = np.column_stack([pose, recording.wrench])
    _, value, count = np.unique(rows, axis=0, return_inverse=True, return_counts=True)
    value = value.ravel()
    if np.count_nonzero(np.diff(value)) + 1 == len(count):
        return 0.0
    _, of, in_pose = np.unique(pose, return_inverse=True, return_counts=True)
    return float(((count - 1)[value] / in_pose[of]).mean())


def _continuous(y: np.ndarray) -> bool:
    """Whether values of a channel (N,) hardly ever recur, apart from repeats of the row before."""
    fresh = y[np.concatenate([[True], y[1:] != y[:-1]])]
    if len(fresh) < WINDOW:
        return False
    _, count = np.unique(fresh, return_counts=True)
    return bool(count.max() <= 2 and len(count) > 0.98 * len(fresh))
