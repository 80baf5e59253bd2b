"""Clocks: stamps in text, whole nanoseconds, even steps, and values at the times of another clock.

Times are whole nanoseconds while they are read: an epoch time in µs has 16 digits; a float of
seconds would lose the last of them.
"""

import re
from collections.abc import Collection, Mapping
from contextlib import suppress
from datetime import UTC, datetime, time, timedelta
from itertools import pairwise

import numpy as np
import pyarrow as pa
import scipy  # which loads its slow submodules when they are first used
from numpy.polynomial import polynomial

from wrenchbed.data.recording import QUATERNION, joint_columns
from wrenchbed.errors import MapError

PER_S = 1e9
"""Nanoseconds in a second."""
JITTER = 0.02
"""Relative difference of steps below which a clock is even; `calibrate` demands it of a motion."""
_GAP = 3.5
"""Least step over the usual one that is a gap; over less, a straight line is the joints' path."""
_DEGREE, _TRIED = 5, 40
"""Degree of the polynomial that fills a gap, fitted to rows before and behind of the gap's length,
and number of stretches without a gap on which it is tried first."""
_LONGEST_S = 0.05
"""Longest gap that is filled [s]. Straight lines fill all columns but joints; over a gap g they are
off by 1 − cos(π g / T) of what repeats with the period T: 5 % for half a second."""
_PARTED = 1.5
"""Least step over the usual one between rows that do not follow each other."""
_SMOOTHER = 0.5
"""Largest ratio of the joints' squared changes of speed, on an even clock over those on the stamps,
at which they were read evenly: either is larger where its clock is not the true one."""
_FIRST, _MOST, _RATES, _BINS = 64, 4000, 81, 50
"""Search for a clock's rate: rows by which it begins, which then double; most rows used; rates
tried within a cycle more or less; and parts of a frame in which stamps are counted."""
_FASTEST = 10.0
"""Top speed of arms' joints [rad/s]: a faster step is an angle that wrapped from π to −π."""
_LATEST_S = 9e9
"""Largest time [s], in the year 2255: a larger one is in another unit."""
_MARK = re.compile(r"(:\d\d:\d\d)[:,](?=\d)")
"""Where some programs write a colon or comma before the parts of a second."""
_WHOLE = re.compile(r"(:\d\d:\d\d)(?![.\d])")
_LOCAL = [
    f"{day}{hour}"
    for day in ("%d.%m.%Y ", "%m-%d-%Y ", "%d-%m-%Y ", "%d-%b-%Y ", "")
    for hour in ("%H:%M:%S.%f", "%I:%M:%S.%f %p")
]
"""Time stamps that are not of ISO 8601: of Excel in two countries, of MATLAB, and with AM or PM."""
_DAY = 86_400 * 1_000_000_000
"""A day [ns]."""
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


def nanoseconds_of(column: pa.ChunkedArray) -> np.ndarray | None:
    """Convert a column of times or of texts to times (N,) [ns] since 1970; None for other columns.

    Where texts state no date, midnight is passed at a fall by more than half a day.
    """
    kind = column.type
    if column.null_count or not len(column):
        return None
    if pa.types.is_timestamp(kind):
        stamps = column.cast(pa.timestamp("ns", kind.tz)).cast(pa.int64())
        return np.asarray(stamps.to_numpy())
    if not pa.types.is_string(kind) and not pa.types.is_time(kind):
        return None
    moments = list[datetime]()
    for form in ("", *_LOCAL):
        with suppress(ValueError):
            moments = [_moment(str(text), form) for text in column.to_pylist()]
            break
    if not moments:
        return None
    t = np.array([(m - _EPOCH) // timedelta(microseconds=1) for m in moments]) * 1_000
    if max(moments) - _EPOCH > timedelta(days=1):
        return t
    passed = np.cumsum(np.diff(t, prepend=t[0]) < -_DAY // 2)
    return np.asarray(t + _DAY * passed)


def _moment(text: str, form: str) -> datetime:
    """Parse a stamp of ISO 8601 or of a ``form``; without a date it is of 1970. A `ValueError`."""
    text = _MARK.sub(r"\1.", text.strip().replace("/", "-"))
    if ":" not in text:
        raise ValueError(f"{text} is no stamp of time")
    if form:
        moment = datetime.strptime(_WHOLE.sub(r"\1.0", text), form).replace(tzinfo=UTC)
        return moment if moment.year > _EPOCH.year else moment.replace(year=_EPOCH.year)
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        moment = datetime.combine(_EPOCH.date(), time.fromisoformat(text))
    return moment if moment.tzinfo else moment.replace(tzinfo=UTC)


def nanoseconds(values: np.ndarray, zero: float, size: float, where: str) -> np.ndarray:
    """Convert clock values (N,) in units of ``size`` [s], counted from ``zero``, to times (N,)
    [ns]; a `MapError`, which begins with ``where``, if they do not advance or have another unit."""
    if values.dtype.kind in "iu":
        t = (continued(values) - round(zero)) * round(size * PER_S)
    else:
        seconds = (values - zero) * size
        if np.abs(seconds).max(initial=0.0) > _LATEST_S:
            raise MapError(f"{where}: {seconds[-1]:.4g} s is no time: give the unit of the clock")
        t = np.rint(seconds * PER_S).astype(np.int64)
    bad = np.flatnonzero(np.diff(t) <= 0)
    if len(bad):
        raise MapError(
            f"{where}, row {bad[0] + 1}: the clock does not advance: leave out rows that repeat "
            "others, or if all come evenly leave t out of the map and state rate_hz"
        )
    return np.asarray(t)


def continued(values: np.ndarray) -> np.ndarray:
    """Counts (N,) of a clock, continued where its counter of 16 or 32 bits begins again at 0."""
    counts = values.astype(np.int64)
    for size in (2**16, 2**32):
        fall = counts[:-1] - counts[1:]
        counts[1:] += size * np.cumsum((fall > 0.9 * size) & (fall < size))
    return np.asarray(counts)


def even_clock(t: np.ndarray, bridged: float = 0.0) -> tuple[np.ndarray, str] | None:
    """Evenly spaced times (M,) [s] nearest to a clock t (N,) [s], none in its gaps, and a sentence
    on what was done; None if t is even already, or too short. Steps up to ``bridged`` [s] are no
    gaps, however many frames are lost in them."""
    step = np.diff(t)
    if len(step) < 2:
        return None
    usual = float(np.median(step))
    # mean step of rows that follow each other: less than a frame is lost between them
    h = float(step[(step > 0.5 * usual) & (step < 1.5 * usual)].mean())
    if np.abs(step - h).max() <= JITTER * h:
        return None
    most = max(_GAP * usual, bridged)
    breaks = np.flatnonzero(step > most)
    parts = []
    for begin, end in zip([0, *(breaks + 1)], [*breaks, len(t) - 1], strict=True):
        first = np.ceil((t[begin] - t[0]) / h - 1e-6)
        last = np.floor((t[end] - t[0]) / h + 1e-6)
        parts.append(t[0] + h * np.arange(first, last + 1))
    inside = step[step <= most]
    sentence = (
        f"steps of {1e3 * inside.min():.3g} … {1e3 * inside.max():.3g} ms resampled to "
        f"{1.0 / h:.6g} Hz"
    )
    if dropped := int(np.maximum(np.rint(inside / usual) - 1, 0).sum()):
        sentence += f", {dropped} dropped frames interpolated"
    if len(breaks):
        sentence += f", {len(breaks)} gaps of {step[breaks].sum():.3g} s in all kept"
    return np.concatenate(parts), sentence


def at_times(data: Mapping[str, np.ndarray], t: np.ndarray) -> dict[str, np.ndarray]:
    """Interpolate columns (N,), ``t`` among them, to times t (M,): linearly, joint values along
    cubics, orientations along the shortest rotation, whole numbers from the nearest row."""
    old = data["t"]
    columns: dict[str, np.ndarray] = {}
    if QUATERNION[0] in data:
        rotation, each = scipy.spatial.transform, np.stack([data[c] for c in QUATERNION], axis=-1)
        q = rotation.Rotation.from_quat(each, scalar_first=True)
        turned = rotation.Slerp(old, q)(np.clip(t, old[0], old[-1]))
        columns |= quaternion_columns(turned)
    if joints := [name for name in data if name[0] == "q" and name[1:].isdecimal()]:
        path = along(old, np.stack([data[name] for name in joints], axis=1), t)
        columns |= dict(zip(joints, path.T, strict=True))
    nearest = np.searchsorted((old[1:] + old[:-1]) / 2.0, t, side="right")
    for name, values in data.items():
        if name not in ("t", *QUATERNION, *joints):
            whole = name in ("segment", "status") or values.dtype.kind in "iu"
            columns[name] = values[nearest] if whole else np.interp(t, old, values)
    return columns


def quaternion_columns(rotation: "scipy.spatial.transform.Rotation") -> dict[str, np.ndarray]:
    """Convert N rotations to the quaternion columns qw qx qy qz (N,), with qw ≥ 0."""
    q = rotation.as_quat(canonical=True, scalar_first=True)
    return dict(zip(QUATERNION, q.T, strict=True))


def unwrapped(
    data: dict[str, np.ndarray], angles: Collection[str]
) -> tuple[dict[str, np.ndarray], tuple[str, ...]]:
    """Make joint angles, the columns named in ``angles``, continuous where they jump from π to −π;
    return the columns and a sentence for each joint that changed."""
    turned_on = dict[str, np.ndarray]()
    for name in set(data) & set(angles):
        steps = np.diff(data[name])
        turns = np.round(steps / (2.0 * np.pi))
        # the joint may have gone there
        if (turns[np.abs(steps) > _FASTEST * np.diff(data["t"])] != 0.0).any():
            turned_on[name] = data[name] - 2.0 * np.pi * np.append(0.0, np.cumsum(turns))
    notes = [f"{name} passes ±180°: unwrapped" for name in sorted(turned_on)]
    return data | turned_on, tuple(notes)


def evened(data: dict[str, np.ndarray]) -> tuple[dict[str, np.ndarray], tuple[str, ...]]:
    """Resample a motion of joints to even times, as its acceleration needs; return the columns and
    sentences on what was done."""
    joints = joint_columns(data)
    if not joints or len(data["t"]) < 2:
        return data, ()
    data, notes = own_clock(data)
    q = np.stack([data[name] for name in joints], axis=1)
    clock = even_clock(data["t"], _longest_known(data["t"], q))
    if clock is None:
        return data, notes
    t, sentence = clock
    path = _bridged(data["t"], q, t)
    columns = at_times(data, t) | dict(zip(joints, path.T, strict=True))
    return {"t": t} | columns, (*notes, sentence)


def own_clock(data: dict[str, np.ndarray]) -> tuple[dict[str, np.ndarray], tuple[str, ...]]:
    """Restore the even clock by which joints were read where stamps are the rows' arrival: on it
    the joints' speed changes much less from row to row. Return columns and sentences on it."""
    t, joints = data["t"], joint_columns(data)
    if not joints or even_clock(t) is None or (frames := _frames(t)) is None:
        return data, ()
    (frame, first, step_s), bends = frames, list[float]()
    q = np.stack([data[name] for name in joints], axis=1)
    frame = _one_earlier(frame, q)
    for clock in (frame, t):
        step = np.diff(clock)[:, None]
        speed, near = np.diff(q, axis=0) / step, np.diff(frame) < _GAP
        bend = np.diff(speed, axis=0)[near[1:] & near[:-1]] * step.mean()
        bends.append(float((bend**2).sum()))
    if bends[0] >= _SMOOTHER * bends[1]:
        return data, ()
    own = first + step_s * frame
    words = f"stamps are late by up to {1e3 * (t - own).max():.2g} ms, the joints move by even "
    words += f"steps of {1e3 * step_s:.6g} ms: their own clock restored"
    return data | {"t": own}, (words,)


def _one_earlier(frame: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Frame numbers (N,), lower by 1 where the joints q (N, J) show that a frame was only late."""
    row = 1 + np.flatnonzero(np.diff(frame)[:-1] >= 2)
    before, behind = q[row - 1], q[row + 1]
    misses = []
    for at in (frame[row], frame[row] - 1):
        share = (at - frame[row - 1]) / (frame[row + 1] - frame[row - 1])
        expected = before + share[:, None] * (behind - before)
        misses.append(((q[row] - expected) ** 2).sum(axis=1))
    frame[row[misses[1] < _SMOOTHER * misses[0]]] -= 1
    return frame


def _frames(t: np.ndarray) -> tuple[np.ndarray, float, float] | None:
    """Frame number (N,) of each stamp t (N,) [s], which comes late, on an even clock; time of frame
    0 and step of that clock [s]. None if steps differ too much.

    The clock's rate is the strongest line in the stamps' spectrum; stamps cluster after a frame.
    """
    since, step = t - t[0], np.diff(t)
    near = np.abs(step / np.median(step) - 1.0) < 0.5
    rows = min(_FIRST, len(t))
    if np.count_nonzero(near) < rows // 2:
        return None
    rate = 1.0 / float(step[near].mean())
    while True:
        some = since[np.linspace(0, rows - 1, min(rows, _MOST)).astype(int)]
        tried = rate + np.linspace(-1.0, 1.0, _RATES) / some[-1]
        rate = float(tried[np.abs(np.exp(2j * np.pi * np.outer(tried, some)).sum(axis=1)).argmax()])
        if rows == len(t):
            break
        rows = min(2 * rows, len(t))
    count = np.histogram(since * rate % 1.0, _BINS, (0.0, 1.0))[0]
    after = np.sum([np.roll(count, -k) for k in range(_BINS // 10)], axis=0)
    begin = float(np.argmax(after - np.roll(after, _BINS // 10))) / _BINS
    frame = np.floor(since * rate - begin + 2.0 / _BINS)
    place = np.arange(len(t))  # what comes later than the next frame is still of its own
    frame = np.minimum.accumulate((frame - place)[::-1])[::-1] + place
    return frame - frame[0], float(t[0] + (frame[0] + begin) / rate), 1.0 / rate


def in_gap(old: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Booleans (M,): whether times t (M,) [s] lie in gaps of a clock ``old`` (N,) [s]."""
    wide = np.append(np.diff(old) > _GAP * np.median(np.diff(old)), False)
    return np.asarray(wide[np.searchsorted(old[:-1], t, side="right") - 1])


def pieces(columns: Mapping[str, np.ndarray], lost: bool = False) -> list[slice]:
    """Slices of a motion's rows between gaps of its clock, column ``t``, and ends of segments;
    ``lost``: a gap of some lost rows, which interpolation fills, parts nothing."""
    step = np.diff(columns["t"])
    least = _GAP if lost else _PARTED
    parted = step > least * float(np.median(step)) if len(step) else step > 0.0
    if "segment" in columns:
        parted |= np.diff(columns["segment"]) != 0
    ends = [0, *(np.flatnonzero(parted) + 1).tolist(), len(columns["t"])]
    return [slice(a, b) for a, b in pairwise(ends)]


def _longest_known(t: np.ndarray, q: np.ndarray) -> float:
    """Longest gap [s] between times t (N,) that interpolation may fill; 0 if there is none.

    For a trial, polynomials fill stretches of its length that have no gap: their rms error, to the
    joint values q (N, J) there, may be twice that of straight lines across every second row.
    """
    step, longest = np.diff(t), 0.0
    most = _GAP * float(np.median(step))
    line = ((q[1:-1] - (q[:-2] + q[2:]) / 2.0) ** 2).mean(axis=0)
    for gap in np.sort(step[(step > most) & (step < _LONGEST_S)]):
        error = list[np.ndarray]()
        for middle in np.linspace(t[0] + 1.5 * gap, t[-1] - 1.5 * gap, _TRIED):
            rows = np.flatnonzero(np.abs(t - middle) < 1.5 * gap)
            near = rows[np.abs(t[rows] - middle) > 0.5 * gap]
            if len(near) > 2 * _DEGREE and np.diff(t[rows]).max() < most:
                hidden = np.setdiff1d(rows, near)
                filled = _through(t[near], q[near], t[hidden])
                error.append(((q[hidden] - filled) ** 2).mean(axis=0))
        if not error or (np.mean(error, axis=0) > 4.0 * line).any():
            break
        longest = float(gap)
    return longest


def _through(t: np.ndarray, q: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Values (M, J) at times ``at`` (M,) of polynomials fitted to values q (N, J) at t (N,)."""
    middle, half = (t[0] + t[-1]) / 2.0, (t[-1] - t[0]) / 2.0
    slopes = polynomial.polyfit((t - middle) / half, q, _DEGREE)
    return np.asarray(polynomial.polyval((at - middle) / half, slopes).T)


def along(old: np.ndarray, q: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Interpolate values q (N, J) at times ``old`` (N,) to t (M,) by cubics with smooth slopes."""
    slope = np.gradient(q, old, axis=0, edge_order=2 if len(old) > 2 else 1)
    k = np.clip(np.searchsorted(old, t, side="right") - 1, 0, len(old) - 2)
    h = (old[k + 1] - old[k])[:, None]
    x = np.clip((t - old[k])[:, None] / h, 0.0, 1.0)  # at a row its values come back bit for bit
    by_ends = q[k] + x**2 * (3.0 - 2.0 * x) * (q[k + 1] - q[k])
    return np.asarray(by_ends + x * (1.0 - x) * h * ((1.0 - x) * slope[k] - x * slope[k + 1]))


def _bridged(old: np.ndarray, q: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Interpolate q (N, J) at times ``old`` (N,) to t (M,) by cubics, in gaps by polynomials."""
    step = np.diff(old)
    result = along(old, q, t)
    for k in np.flatnonzero((step > _GAP * np.median(step)) & (step < _LONGEST_S)):
        inside = (t > old[k]) & (t < old[k + 1])
        near = (old > old[k] - step[k]) & (old < old[k + 1] + step[k])
        if inside.any() and near.sum() > 2 * _DEGREE:
            result[inside] = _through(old[near], q[near], t[inside])
    return result
