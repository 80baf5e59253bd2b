"""A continuous log of holds and moves, told apart by itself.

A row is at rest if the mean of the joint values (or of the orientation) over a short window before
it and that over one behind it agree within their noise. The noise of the encoders is read off the
second differences, which a smooth move hardly changes.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from wrenchbed.data.holds import first_rows
from wrenchbed.data.metadata import Metadata
from wrenchbed.data.recording import QUATERNION, Recording
from wrenchbed.errors import RecordingError
from wrenchbed.physics.wrench import CHANNELS

_WINDOW_S = 0.12
"""Length of each of the two windows [s]; the tails of a move within it are cut off; estimate."""
_LEAST_WINDOW = 3
_EDGE_S, _EDGE_SHARE = 0.3, 0.15
"""So much of each end of a rest is left out [s], a share of short ones; estimates."""
_SLOWEST = 3e-3
"""Joints that move slower than this are at rest for all that gravity shows [rad/s or m/s]: 0.4 mrad
in a window; estimate."""
_SIGMAS = 6.0
_NORMAL = 0.6745
"""Median of |x| of a normal distribution with standard deviation 1."""
LEAST_HOLD_S = 0.4
"""A shorter rest is a part of a move; estimate."""
_DRIFT = 2e-3
"""Joints that go further than this within a rest creep: that is a move [rad or m]; estimate."""
_LONGER, _CREEP = 8, 4e-4
"""A rest that creeps is judged over windows so much longer, whose means may differ by this [rad or
m]; estimates."""
_SAME = 1e-3
"""Two rests that differ by less, with hardly a pause between, are one [rad or m]; estimate."""
_BLOCK_S = 0.1
"""The tool's vibration after a move is judged over means of this length [s]; estimate."""
_ENOUGH_TO_MOVE, _MOST_SINGLE, _NEXT = 200, 0.3, 0.01
"""A log of at least so many rows is in motion if more than this share of them are poses of their
own and a usual step is less than this share of the whole way; estimates."""
_ENOUGH_ROWS = 50
"""Rows at rest that show the noise of one row."""


@dataclass(frozen=True, eq=False)
class Split:
    """The holds of a log.

    Attributes:
        hold: of each row its hold's number from 0, −1 in a move (N,).
        seconds: length of each hold (H,) [s].
        moves: how many moves there are.
    """

    hold: np.ndarray
    seconds: np.ndarray
    moves: int

    @property
    def sentence(self) -> str:
        """Holds and moves, for people."""
        n, s = len(self.seconds), self.seconds
        low, middle, high = float(s.min()), float(np.median(s)), float(s.max())
        length = f"{middle:.2g} s"
        if high - low > 0.2 * middle:
            length = f"{low:.2g} … {high:.2g} s"
        holds, moves = "hold" if n == 1 else "holds", "move" if self.moves == 1 else "moves"
        return f"{n} {holds} of {length}; {self.moves} {moves}"

    def at_rest(self, recording: Recording, metadata: Metadata) -> Recording:
        """The rows of the holds; ``segment`` numbers them."""
        keep = self.hold >= 0
        columns = {k: v[keep] for k, v in recording.columns.items()} | {"segment": self.hold[keep]}
        if not recording.joints:
            q = _continuous(recording.q[keep])
            columns |= dict(zip(QUATERNION, q.T, strict=True))
        columns["t"] = columns["t"] - columns["t"][0]
        return Recording(metadata, columns, recording.name)


def split(recording: Recording) -> Split:
    """Tell holds and moves of a log apart.

    Raises:
        RecordingError: there is no hold.
    """
    found = _split(recording)
    if found is None:
        raise RecordingError(
            f"{recording.name}: nothing rests for {LEAST_HOLD_S} s; import it with mode = 'dynamic'"
        )
    return found


def check_at_rest(recording: Recording) -> None:
    """Refuse a log of moves as poses at rest: a pose of every row, each close to the one before.

    Raises:
        RecordingError: most rows are in motion.
    """
    q = recording.q.astype(float)
    if len(q) < _ENOUGH_TO_MOVE:
        return
    poses = len(first_rows(recording.columns))
    way = np.abs(np.diff(q if recording.joints else _continuous(q), axis=0))
    close = np.median(way.max(axis=1)) < _NEXT * max(float(np.ptp(q, axis=0).max()), 1e-9)
    if poses > _MOST_SINGLE * len(q) and close:
        raise RecordingError(
            f"{recording.name}: {poses:,} poses in {len(q):,} rows: this is a log in motion, not "
            "poses at rest (mode static); --mode auto splits it into holds and moves"
        )


def noise_at_rest(recording: Recording) -> tuple[float, ...] | None:
    """Standard deviation of one row at rest (6,) [N, N·m]; None where too little is at rest."""
    found = _split(recording)
    if found is None:
        return None
    rest = found.hold >= 0
    hold, y = found.hold[rest], recording.wrench[rest]
    count = np.bincount(hold)
    dof = len(hold) - len(count)
    if dof < _ENOUGH_ROWS:
        return None
    std = []
    for channel in y.T:
        mean = np.bincount(hold, channel) / count
        std.append(float(np.sqrt(((channel - mean[hold]) ** 2).sum() / dof)))
    return tuple(std) if min(std) > 0 else None


def with_noise(recording: Recording) -> Recording:
    """The recording of a motion with ``noise_std`` from its own rests, where none is stated."""
    stated = recording.metadata
    known = stated.sensor.noise_std is not None or not recording.has_wrench
    if stated.mode != "dynamic" or known:
        return recording
    std = noise_at_rest(recording)
    if std is None:
        return recording
    metadata = replace(stated, sensor=replace(stated.sensor, noise_std=std))
    return Recording(metadata, recording.columns, recording.name)


def _split(recording: Recording) -> Split | None:
    q = recording.q.astype(float)
    if not recording.joints:
        q = _continuous(q)
    t, n = recording.t, len(recording)
    step = float(np.median(np.diff(t))) if n > 1 else 0.0
    window = max(_LEAST_WINDOW, round(_WINDOW_S / step)) if step > 0 else _LEAST_WINDOW
    if n < 2 * window:
        return None
    noise = _noise(q)
    runs = _joined(_still(q, t, noise, window, _SLOWEST * window * step), q, noise, 4 * window)
    runs = [r for run in runs for r in _without_creep(q, t, noise, run, window)]
    block = max(1, round(_BLOCK_S / step)) if step > 0 else 1
    runs = [(a, b) for a, b in runs if b - a >= _LEAST_WINDOW]
    if not runs:
        return None
    hold = np.full(n, -1)
    for k, run in enumerate(runs):
        a, b = _within(run, t)
        if recording.has_wrench:
            a, b = _settled(recording.wrench, (a, b), block)
        hold[a:b] = k
    between = sum(before[1] < after[0] for before, after in pairwise(runs))
    edge = 2 * window + block
    moves = between + (runs[0][0] > edge) + (runs[-1][1] < n - edge)
    seconds = np.array([t[b - 1] - t[a] for a, b in runs])
    return Split(hold, seconds, int(moves))


def _still(
    q: np.ndarray, t: np.ndarray, noise: np.ndarray, window: int, least: float
) -> list[tuple[int, int]]:
    """Runs in which the means of neighbouring windows agree within their noise or ``least``."""
    allowed = np.maximum(_SIGMAS * noise * np.sqrt(2.0 / window), least)
    still = (np.abs(_change(q, window)) <= allowed).all(axis=1)
    shortest = max(LEAST_HOLD_S - 2.0 * _WINDOW_S, 0.0)
    return [(a, b) for a, b in _runs(still) if t[b - 1] - t[a] >= shortest]


def _without_creep(
    q: np.ndarray, t: np.ndarray, noise: np.ndarray, run: tuple[int, int], window: int
) -> list[tuple[int, int]]:
    """A run, or, where it creeps, those of its parts that rest for longer windows too."""
    a, b = run
    if not _creeps(q[a:b], noise):
        return [run]
    window *= _LONGER
    if b - a < 2 * window:
        return []
    parts = _still(q[a:b], t[a:b], noise, window, _CREEP)
    return [(a + c, a + d) for c, d in parts if not _creeps(q[a + c : a + d], noise)]


def _within(run: tuple[int, int], t: np.ndarray) -> tuple[int, int]:
    """A run without its ends, in which a move begins or ends with little way but full force."""
    a, b = run
    edge = min(_EDGE_S, _EDGE_SHARE * (t[b - 1] - t[a]))
    first = int(np.searchsorted(t, t[a] + edge))
    last = int(np.searchsorted(t, t[b - 1] - edge, side="right"))
    return (first, last) if last - first >= _LEAST_WINDOW else run


def _continuous(q: np.ndarray) -> np.ndarray:
    """Quaternions (N, 4) without changes of sign from row to row."""
    flips = np.cumprod(np.where((q[1:] * q[:-1]).sum(axis=1) < 0.0, -1.0, 1.0))
    return np.concatenate([q[:1], q[1:] * flips[:, None]])


def _noise(q: np.ndarray) -> np.ndarray:
    """Standard deviation (J,) of one reading of each joint."""
    second = np.abs(q[2:] - 2.0 * q[1:-1] + q[:-2])
    return np.asarray(np.median(second, axis=0) / (_NORMAL * np.sqrt(6.0)))


def _change(q: np.ndarray, window: int) -> np.ndarray:
    """Mean of the window behind each row less that of the window before it (N, J)."""
    n = len(q)
    total = np.concatenate([np.zeros((1, q.shape[1])), np.cumsum(q - q[0], axis=0)])
    row = np.arange(n)
    low, high = np.maximum(row - window, 0), np.minimum(row + window, n - 1)
    row = np.clip(row, 1, n - 2)
    before = (total[row] - total[np.minimum(low, row - 1)]) / np.maximum(row - low, 1)[:, None]
    behind = (total[high + 1] - total[row + 1]) / np.maximum(high - row, 1)[:, None]
    return np.asarray(behind - before)


def _runs(flags: np.ndarray) -> list[tuple[int, int]]:
    """(first, behind the last) of each run of true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _joined(
    runs: Sequence[tuple[int, int]], q: np.ndarray, noise: np.ndarray, pause: int
) -> list[tuple[int, int]]:
    """Runs with the same pose and hardly a pause between are one."""
    done: list[tuple[int, int]] = []
    for a, b in runs:
        if done and a - done[-1][1] <= pause:
            last = slice(*done[-1])
            far = np.abs(np.median(q[a:b], axis=0) - np.median(q[last], axis=0))
            between = np.abs(q[done[-1][1] : a] - np.median(q[last], axis=0))
            if (far < _SAME + noise).all() and (between < 2.0 * _SAME + 6.0 * noise).all():
                done[-1] = (done[-1][0], b)
                continue
        done.append((a, b))
    return done


def _creeps(q: np.ndarray, noise: np.ndarray) -> bool:
    third = max(1, len(q) // 3)
    way = np.abs(q[-third:].mean(axis=0) - q[:third].mean(axis=0))
    return bool((way > _DRIFT + _SIGMAS * noise * np.sqrt(2.0 / third)).any())


def _settled(y: np.ndarray, run: tuple[int, int], block: int) -> tuple[int, int]:
    """A run without the begin and end at which the wrench (N, 6) has not yet come to rest."""
    a, b = run
    count = (b - a) // block
    if count < 4:
        return run
    means = y[a : a + count * block].reshape(count, block, len(CHANNELS)).mean(axis=1)
    middle = np.median(means[count // 4 : count - count // 8], axis=0)
    away = np.abs(means - middle)
    usual = np.median(away[count // 4 :], axis=0) / _NORMAL
    calm = (away <= _SIGMAS * usual + 1e-9).all(axis=1)
    first, last = 0, count
    while first < count // 3 and not calm[first]:
        first += 1
    while last > count - count // 3 and not calm[last - 1]:
        last -= 1
    return a + first * block, (b if last == count else a + last * block)
