"""Holds, which are rests at one pose: their rows averaged, and logs split into holds and moves.

In a log without segments a row is at rest if the mean of the joint values (or of the orientation)
over a short window before it and that over one behind it agree within their noise. The noise of the
encoders is read off the second differences, which a smooth move hardly changes. All fits at rest
take holds; tests/data/test_rests.py judges its constants.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from wrenchbed.data.metadata import Metadata
from wrenchbed.data.recording import QUATERNION, Recording, joint_columns
from wrenchbed.errors import RecordingError
from wrenchbed.physics.wrench import CHANNELS

MOVING = 1e-4
MOVING_WITHIN_SEGMENT = 1e-3
"""Largest steps of joints [rad, m] or quaternions in one pose, without and with segments."""
NEAR_ROWS = 25
"""Rows before and behind a step in a segment, whose means, noise over five, tell a move from
noise."""
ROWS_AT_ONCE = 500_000
"""Rows processed together: this bounds the memory that a long recording needs."""
_WINDOW_S = 0.12
"""Length of each of the two windows [s]: shorter ones average too little of the encoders' noise,
longer ones miss short holds and cut off more of a hold beside a move."""
_LEAST_WINDOW = 3
_EDGE_S, _EDGE_SHARE = 0.3, 0.15
"""Time left out at each end of a rest [s] and its largest fraction of a short rest: there a move
begins or ends with full force."""
_SLOWEST = 3e-3
"""Joints that move slower than this are at rest for all that gravity shows [rad/s or m/s]: 0.4 mrad
in a window, which turns 20 N by 8 mN."""
_SIGMAS = 6.0
"""Standard deviations beyond which a difference of means is a move, not noise: at 3 a long
recording shows moves by chance."""
_SURELY, _NOISIEST = 10.0, 1e-3
"""Least step, in standard deviations of a reading, that is a move at once, between poses without
numbers; and encoder noise [rad or m] beyond which every row is a pose."""
_NORMAL = 0.6745
"""Median of |x| of a normal distribution with standard deviation 1."""
LEAST_HOLD_S = 0.4
"""Shortest hold [s]: of a shorter rest hardly a row would be left without its ends."""
_DRIFT = 2e-3
"""Largest way of a joint within a rest [rad or m]: a longer one is a slow move; this one turns 20 N
by 40 mN, as much as the noise of a usual sensor's row."""
_LONGER, _CREEP = 8, 4e-4
"""Factor on the windows by which a creeping rest is judged, and largest difference of their means
[rad or m], which is what `_SLOWEST` allows in a short window."""
_SAME = 1e-3
"""Difference [rad or m] below which two adjacent rests are one: an encoder's flicker; what gravity
shows of it is below any noise."""
_SLOW, _SLOWLY, _SLOW_S = 0.1, 0.03, 0.5
"""Where hardly anything rests, rows slower than this [rad/s or m/s] whose speed changes by less
than this [rad/s² or m/s²] over windows of this length [s] show gravity alone: 1.3 kg at 0.5 m from
the axis pull with 7 mN by the first and 20 mN by the second, less than a usual row's noise."""
_BLOCK_S = 0.1
"""The tool's vibration after a move is judged over means of this length [s]: a few periods."""
_ENOUGH_TO_MOVE, _MOST_SINGLE, _NEXT = 200, 0.3, 0.01
"""A log of at least this many rows is in motion if more than this fraction of them are poses of
their own and the median step is less than this fraction of the whole way."""
_STRAIGHT = 0.5
"""Bend of a path over its steps, as medians, below which rows without a clock are a motion: poses
that were drawn at random bend by 1.7 steps."""
_ENOUGH_ROWS = 50
"""Least degrees of freedom of rows at rest that show the noise of one row, to 10 %."""


def runs(marked: np.ndarray) -> list[tuple[int, int]]:
    """First row and end (exclusive) of each run of consecutive True values in marked (N,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], marked, [False]]).astype(int)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


@dataclass(frozen=True, eq=False)
class Holds:
    """Mean values of a static recording over each of its H holds (rests at a pose).

    Attributes:
        t: mean time (H,) [s].
        q: joint values (H, J) or orientations (H, 4).
        wrench: mean reading (H, 6) [N, N·m]; (H, 0) without a wrench.
        count: rows in each hold (H,).
        row_covariance: of one row about its hold's mean (6, 6), None without repeats or wrench.
        dof: degrees of freedom of ``row_covariance``.
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
    """Average a recording's rows hold by hold, using only the rows in the boolean ``keep`` (N,)."""
    names = recording.joints or QUATERNION
    sensed = CHANNELS if recording.has_wrench else ()
    columns = recording.columns
    if not keep.all():
        used = {"t", "segment", *names, *sensed} & columns.keys()
        columns = {name: columns[name][keep] for name in used}
    starts = first_rows(columns)
    rows = len(columns["t"])
    count = np.diff(np.append(starts, rows))

    def means(some: Sequence[str]) -> np.ndarray:
        result = np.empty((len(starts), len(some)))
        for k, name in enumerate(some):
            result[:, k] = np.add.reduceat(columns[name], starts, dtype=float) / count
        return result

    wrench = means(sensed)
    dof = rows - len(starts)
    covariance = None
    if dof > 0 and sensed:
        channels = [columns[c] for c in sensed]
        covariance = sum(r.T @ r for _, r in about_means(channels, wrench, count)) / dof
    return Holds(means(["t"])[:, 0], means(names), wrench, count, covariance, dof, starts)


def first_rows(columns: Mapping[str, np.ndarray]) -> np.ndarray:
    """Index (H,) of each hold's first row, where a segment begins or the joints have moved."""
    names = joint_columns(columns) or QUATERNION
    segment = columns.get("segment")
    limit = MOVING if segment is None else MOVING_WITHIN_SEGMENT
    rows = len(columns[names[0]])
    noise = dict.fromkeys(names, 0.0)
    for name in names if rows > 2 else ():
        if (np.abs(np.diff(columns[name])) > limit).any():
            std = float(_noise_of(columns[name]))
            noise[name] = std if std < _NOISIEST else 0.0
    if segment is not None:
        change = np.diff(segment) != 0
    else:
        change = np.zeros(rows - 1, dtype=bool)
        for name in names:
            change |= np.abs(np.diff(columns[name])) > max(limit, _SURELY * noise[name])
    begin = np.concatenate([[0], np.flatnonzero(change) + 1, [rows]])
    for name in names:
        jumps = (np.abs(np.diff(columns[name])) > limit) & ~change
        if jumps.any():
            at = np.flatnonzero(jumps)
            jumps[at] = _stays_away(columns[name], at, limit, noise[name], begin)
        change = change | jumps
    return np.concatenate([[0], np.flatnonzero(change) + 1])


def _noise_of(values: np.ndarray) -> np.ndarray:
    """Standard deviation (J,) of encoder noise, from values (N, J) of which most are at rest."""
    second = np.abs(values[2:] - 2.0 * values[1:-1] + values[:-2])
    return np.asarray(np.median(second, axis=0) / (_NORMAL * np.sqrt(6.0)))


def _stays_away(
    values: np.ndarray, jumps: np.ndarray, limit: float, noise: float, begin: np.ndarray
) -> np.ndarray:
    """Whether values (N,) stay changed by ``limit`` after the rows ``jumps`` (K,), and are no
    outliers of ``noise``: (K,). ``begin`` (S + 1,): first row of each segment, and N."""
    here = jumps + 1  # the first row behind the jump
    segment = np.searchsorted(begin, jumps, side="right") - 1
    low = np.maximum(here - NEAR_ROWS, begin[segment])
    high = np.minimum(here + NEAR_ROWS, np.maximum(begin[segment + 1], here + 1))
    behind, before = means_of(values, here, high), means_of(values, low, here)
    by_chance = _SIGMAS * noise * np.sqrt(1.0 / (high - here) + 1.0 / (here - low))
    return np.asarray(np.abs(behind - before) > np.maximum(limit, by_chance))


def means_of(values: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Means (M,) or (M, K) of values (N,) or (N, K) over rows low (M,) to high (M,), exclusive."""
    change = np.cumsum(values - values[0], axis=0, dtype=float)
    total = np.concatenate([np.zeros_like(change[:1]), change])
    count = (high - low).reshape(-1, *[1] * (values.ndim - 1))
    return np.asarray(values[0] + (total[high] - total[low]) / count)


def about_means(
    rows: Sequence[np.ndarray], mean: np.ndarray, count: np.ndarray
) -> Iterator[tuple[slice, np.ndarray]]:
    """Yield pairs: a slice of holds, and the deviations (n, 6) of their n rows from their holds'
    means. ``rows``: six channels (N,); ``mean``: (H, 6); ``count`` (H,): rows of each hold."""
    for some, at in parts(count):
        residual = np.stack([y[at] for y in rows], axis=1, dtype=float)
        residual -= np.repeat(mean[some], count[some], axis=0)
        yield some, residual


def parts(count: np.ndarray) -> Iterator[tuple[slice, slice]]:
    """Yield pairs of slices, of consecutive holds and of all their rows, about `ROWS_AT_ONCE` rows
    at a time; ``count`` (H,) is the number of rows of each hold."""
    ends = np.cumsum(count)
    first = row = 0
    while first < len(count):
        last = max(first + 1, int(np.searchsorted(ends, row + ROWS_AT_ONCE, side="right")))
        yield slice(first, last), slice(row, int(ends[last - 1]))
        first, row = last, int(ends[last - 1])


# logs of holds and moves


@dataclass(frozen=True, eq=False)
class Split:
    """Which rows of a log belong to holds (at rest) and which to moves.

    Attributes:
        hold: number of each row's hold from 0, −1 in a move (N,).
        seconds: length of each hold (H,) [s].
        moves: how many moves there are.
        slow: whether the holds are stretches of slow turning.
    """

    hold: np.ndarray
    seconds: np.ndarray
    moves: int
    slow: bool = False

    @property
    def sentence(self) -> str:
        """Sentence on the number and length of holds and moves."""
        n, s = len(self.seconds), self.seconds
        if self.slow:
            rows = int((self.hold >= 0).sum())
            return f"hardly anything rests; {rows} rows turn slowly enough to show gravity alone"
        low, middle, high = float(s.min()), float(np.median(s)), float(s.max())
        length = f"{middle:.2g} s"
        if high - low > 0.2 * middle:
            length = f"{low:.2g} … {high:.2g} s"
        holds, moves = "hold" if n == 1 else "holds", "move" if self.moves == 1 else "moves"
        return f"{n} {holds} of {length}; {self.moves} {moves}"

    def at_rest(self, recording: Recording, metadata: Metadata) -> Recording:
        """Make a recording of the rows in holds, whose numbers become its ``segment``."""
        keep = self.hold >= 0
        columns = {k: v[keep] for k, v in recording.columns.items()} | {"segment": self.hold[keep]}
        if not recording.joints:
            q = continuous(recording.q[keep])
            columns |= dict(zip(QUATERNION, q.T, strict=True))
        columns["t"] = columns["t"] - columns["t"][0]
        return Recording(metadata, columns, recording.name)


def split(recording: Recording, slow: bool = False) -> Split:
    """Find the holds and moves of a log; a `RecordingError` if there is no hold. With ``slow``, if
    hardly anything rests, stretches too slow to show inertia count as holds."""
    holds = _split(recording)
    turning = _slow(recording) if slow and recording.has_wrench else None
    rows = 0 if holds is None else np.count_nonzero(holds.hold >= 0)
    if turning is not None and np.count_nonzero(turning.hold >= 0) > 2 * rows:
        return turning
    if holds is None:
        raise RecordingError(
            f"{recording.name}: nothing rests for {LEAST_HOLD_S} s; import it with mode = 'dynamic'"
        )
    return holds


def check_at_rest(recording: Recording, clockless: str = "") -> None:
    """Raise `RecordingError` for a log of moves stated as poses at rest, in which most rows are in
    motion: each row is then a pose close to the one before, or to where a straight way leads from
    the two before it if there is no clock (``clockless``: name of the map that states none)."""
    q = _smooth(recording)
    if len(q) < _ENOUGH_TO_MOVE:
        return
    poses = len(first_rows(recording.columns))
    way = np.abs(np.diff(q, axis=0)).max(axis=1)
    close = np.median(way) < _NEXT * max(float(np.ptp(q, axis=0).max()), 1e-9)
    quick = np.median(np.diff(recording.t)) < LEAST_HOLD_S  # else there was time to rest
    if clockless:
        bend, quick = np.abs(np.diff(q, n=2, axis=0)).max(axis=1), np.True_
        close |= np.median(bend) < _STRAIGHT * np.median(way)
    if poses > _MOST_SINGLE * len(q) and close and quick:
        remedy = "--mode auto splits it into holds and moves"
        if clockless:
            remedy = f"no clock says how fast: in [recording] of {clockless} state rate_hz and "
            remedy += "mode = 'dynamic', or a rate_hz below 2.5 where each row is a rest"
        raise RecordingError(
            f"{recording.name}: {poses:,} poses in {len(q):,} rows: this is a log in motion, not "
            f"poses at rest (mode static); {remedy}"
        )


def noise_at_rest(recording: Recording) -> tuple[float, ...] | None:
    """Standard deviation of one row at rest (6,) [N, N·m]; None if too few rows are at rest."""
    holds = _split(recording)
    if holds is None:
        return None
    rest = holds.at_rest(recording, replace(recording.metadata, mode="static"))
    poses = gather(rest, np.ones(len(rest), dtype=bool))
    if poses.row_covariance is None or poses.dof < _ENOUGH_ROWS:
        return None
    std = tuple(float(x) for x in np.sqrt(np.diag(poses.row_covariance)))
    return std if min(std) > 0 else None


def with_noise(recording: Recording) -> Recording:
    """Return the recording with ``noise_std`` in its metadata, if missing there, from its rests."""
    stated = recording.metadata
    known = stated.sensor.noise_std is not None or not recording.has_wrench
    if stated.mode != "dynamic" or known or (std := noise_at_rest(recording)) is None:
        return recording
    metadata = replace(stated, sensor=replace(stated.sensor, noise_std=std))
    return Recording(metadata, recording.columns, recording.name)


@dataclass(frozen=True, eq=False)
class _Path:
    """Joint values or quaternions q (N, J) at times t (N,) [s]; ``noise`` (J,): std of one."""

    q: np.ndarray
    t: np.ndarray
    noise: np.ndarray

    def part(self, run: tuple[int, int]) -> "_Path":
        """Cut out the rows of a run (first row, end)."""
        return _Path(self.q[slice(*run)], self.t[slice(*run)], self.noise)

    def still(self, window: int, least: float) -> list[tuple[int, int]]:
        """Runs (first row, end) at rest: means over the ``window`` rows before and behind each row
        agree within noise or ``least`` [rad or m]."""
        n = len(self.q)
        row = np.clip(np.arange(n), 1, n - 2)
        low, high = np.maximum(row - window, 0), np.minimum(row + window, n - 1)
        change = means_of(self.q, row + 1, high + 1) - means_of(self.q, low, row)
        allowed = np.maximum(_SIGMAS * self.noise * np.sqrt(2.0 / window), least)
        t, shortest = self.t, max(LEAST_HOLD_S - 2.0 * _WINDOW_S, 0.0)
        still = runs((np.abs(change) <= allowed).all(axis=1))
        return [(a, b) for a, b in still if t[b - 1] - t[a] >= shortest]

    @property
    def creeps(self) -> bool:
        """Whether start and end of the path differ by more than an encoder's flicker."""
        third = max(1, len(self.q) // 3)
        way = np.abs(self.q[-third:].mean(axis=0) - self.q[:third].mean(axis=0))
        return bool((way > _DRIFT + _SIGMAS * self.noise * np.sqrt(2.0 / third)).any())

    def without_creep(self, run: tuple[int, int], window: int) -> list[tuple[int, int]]:
        """Parts of a run that rest also over longer windows, if its ends differ (a slow creep);
        else the run itself. Runs are first row and end (exclusive)."""
        path = self.part(run)
        if not path.creeps:
            return [run]
        if len(path.q) < 2 * _LONGER * window:
            return []
        parts = path.still(_LONGER * window, _CREEP)
        return [(run[0] + a, run[0] + b) for a, b in parts if not path.part((a, b)).creeps]

    def joined(self, runs: Sequence[tuple[int, int]], pause: int) -> list[tuple[int, int]]:
        """Merge consecutive runs at the same pose that at most ``pause`` rows separate."""
        done: list[tuple[int, int]] = []
        for a, b in runs:
            if done and a - done[-1][1] <= pause:
                before = np.median(self.q[slice(*done[-1])], axis=0)
                far = np.abs(np.median(self.q[a:b], axis=0) - before) - self.noise
                between = np.abs(self.q[done[-1][1] : a] - before) - _SIGMAS * self.noise
                if (far < _SAME).all() and (between < 2.0 * _SAME).all():
                    done[-1] = (done[-1][0], b)
                    continue
            done.append((a, b))
        return done

    def without_ends(self, run: tuple[int, int]) -> tuple[int, int]:
        """Cut off a run's ends, where joints may accelerate; a short run is returned as it is."""
        begin, end = self.t[run[0]], self.t[run[1] - 1]
        edge = min(_EDGE_S, _EDGE_SHARE * (end - begin))
        first = int(np.searchsorted(self.t, begin + edge))
        last = int(np.searchsorted(self.t, end - edge, side="right"))
        return (first, last) if last - first >= _LEAST_WINDOW else run


def _smooth(recording: Recording) -> np.ndarray:
    """Joint values (N, J) of a recording, or its quaternions (N, 4) without sign flips."""
    q = recording.q.astype(float)
    return q if recording.joints else continuous(q)


def continuous(q: np.ndarray) -> np.ndarray:
    """Flip signs of quaternions (N, 4) so that consecutive ones are close."""
    flips = np.cumprod(np.where((q[1:] * q[:-1]).sum(axis=1) < 0.0, -1.0, 1.0))
    return np.concatenate([q[:1], q[1:] * flips[:, None]])


def _split(recording: Recording) -> Split | None:
    """Find the holds and moves of a log; None if nothing is at rest."""
    q, t, n = _smooth(recording), recording.t, len(recording)
    step = float(np.median(np.diff(t))) if n > 1 else 0.0
    window = max(_LEAST_WINDOW, round(_WINDOW_S / step)) if step > 0 else _LEAST_WINDOW
    if n < 2 * window:
        return None
    path = _Path(q, t, _noise_of(q))
    runs = path.joined(path.still(window, _SLOWEST * window * step), 4 * window)
    runs = [r for run in runs for r in path.without_creep(run, window)]
    runs = [(a, b) for a, b in runs if b - a >= _LEAST_WINDOW]
    if not runs:
        return None
    block = max(1, round(_BLOCK_S / step)) if step > 0 else 1
    hold, wrench = np.full(n, -1), recording.wrench if recording.has_wrench else None
    for k, run in enumerate(runs):
        rest = path.without_ends(run)
        if wrench is not None:
            rest = _settled(wrench, rest, block)
        hold[slice(*rest)] = k
    between = sum(before[1] < after[0] for before, after in pairwise(runs))
    edge = 2 * window + block
    moves = between + (runs[0][0] > edge) + (runs[-1][1] < n - edge)
    seconds = np.array([t[b - 1] - t[a] for a, b in runs])
    return Split(hold, seconds, int(moves))


def _slow(recording: Recording) -> Split | None:
    """Cut slow turning into stretches of at most `_DRIFT`, each a hold; None if there is none."""
    q, t, n = _smooth(recording), recording.t, len(recording)
    step = float(np.median(np.diff(t))) if n > 1 else 0.0
    half = round(_SLOW_S / step / 2.0) if step > 0 else 0
    if half < 1 or n < 8 * half:
        return None
    row = np.arange(3 * half, n - 3 * half)
    at = ((row + (2 * k - 1) * half, row + (2 * k + 1) * half) for k in (-1, 0, 1))
    before, here, behind = (means_of(q, low, high) for low, high in at)
    speed, bend = (behind - before) / (4 * half * step), behind - 2.0 * here + before
    slow = np.zeros(n, dtype=bool)
    slow[row] = (np.abs(speed) < _SLOW).all(axis=1)
    slow[row] &= (np.abs(bend) < _SLOWLY * (2 * half * step) ** 2).all(axis=1)
    place = np.zeros_like(q, dtype=int)
    place[row] = np.floor(here / _DRIFT)
    turned_on = np.append(True, (np.diff(place, axis=0) != 0).any(axis=1))
    hold = np.where(slow, np.cumsum(turned_on | ~slow), -1)
    numbers, number, count = np.unique(hold, return_inverse=True, return_counts=True)
    keep = (numbers >= 0) & (count >= _LEAST_WINDOW)
    if not keep.any():
        return None
    hold = np.where(keep, np.cumsum(keep) - 1, -1)[number]
    return Split(hold, count[keep] * step, 0, slow=True)


def _settled(y: np.ndarray, run: tuple[int, int], block: int) -> tuple[int, int]:
    """Part of a run (first row, end) in which means of ``block`` rows of y (N, 6) are steady."""
    a, b = run
    count = (b - a) // block
    if count < 4:
        return run
    means = y[a : a + count * block].reshape(count, block, len(CHANNELS)).mean(axis=1)
    away = np.abs(means - np.median(means[count // 4 : count - count // 8], axis=0))
    usual = np.median(away[count // 4 :], axis=0) / _NORMAL
    calm = [*(away <= _SIGMAS * usual + 1e-9).all(axis=1), True]
    first = min(calm.index(True), count // 3)
    last = count - min(calm[-2::-1].index(True) if any(calm[:-1]) else count, count // 3)
    return a + first * block, (b if last == count else a + last * block)
