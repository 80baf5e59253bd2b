"""Checks of rows alone, without a robot: dead or clipped channels, spikes, a wrong clock, rows that
contradict the others of their pose."""

from collections.abc import Iterator

import numpy as np

from wrenchbed import registry
from wrenchbed.calibration.checks.finding import Finding
from wrenchbed.data.recording import QUATERNION, Recording
from wrenchbed.physics.wrench import CHANNELS, UNITS
from wrenchbed.sensors.base import STATUS_SATURATED

STUCK = 0.2
"""Least share of the rows for which a stuck channel stays at one value."""
CLIPPED = 0.3
"""Share of the rows at a channel's largest or smallest value above which it is refused."""
FEW = 10
"""Fewest rows from which the fraction at a channel's end is evaluated: of fewer rows `CLIPPED` is
three or less, which coarse counts reach by chance."""
AT_END, LEAST_CLIPPED = 0.01, 0.02
"""Largest relative distance of a clipped channel's extreme from the range; least share there."""
LEAST_AT_END = 10
"""Least number of rows at a clipped channel's extreme."""
PILE = 5.0
"""Least rows at a clipped channel's extreme, in multiples of those at any other value."""
ENDS = (1.0, 1.05)
"""Ends of converters' ranges in multiples of the sensor's range."""
SPIKE, SPIKES = 3.0, 0.005
"""Least distance of a spike from its neighbours over the channel's usual swing, and largest share
of spikes among the rows; more are noise."""
ABSURD = 30.0
"""Distance of a spike over the usual swing from which it is no blow on the tool either."""
FAR = 30.0
"""Least distance of a spike from its neighbours in multiples of the usual step between rows."""
LEAST_LOST = 3
"""Fewest rows without a reading that are named: fewer move no fit by much."""
ALIKE = 0.5
"""Largest relative difference of the rows before and after one without a reading."""
_USUAL = 0.1
"""Share of the steps from row to row that are larger than the usual one: the ninth decile leaves
moves between poses, a tenth of the rows, aside."""
MOST_NAMED = 10
"""Most rows that are named beside the worst one."""
_OR_HUBER = ", or calibrate with --loss huber"
ALL = "all joints"
"""Name that stands for the columns of all joints at once."""
MOVES = 10.0
"""Least scatter of readings over their noise that is a motion."""
CLOCK = 0.1
"""Largest relative difference of the clock's step from the stated rate."""
OFF = 8.0
"""Distance of a row from its pose's median, in standard deviations (by the median deviation), from
which it is no repeat: normal noise is so far off once in 10¹⁵ rows."""
OFF_SHARE, OFF_ROWS = 0.005, 3
"""Least share and number of rows far from their pose's median: fewer move no mean by much."""
MOVED = 3.0
"""Least shift of the poses' means by rows far from the median, in standard uncertainties."""
ALONG, MOST = 0.2, 0.8
"""Largest part of a row's deviation beside the direction to the neighbouring pose, if the row
belongs to the move there, and least share of such rows where the wrench is late or early."""
EARLY = 0.25
"""First part of a pose in which the tool may still ring after the move."""
_MAD = 1.4826
"""Standard deviation of a normal variable over its median absolute deviation."""


def of_rows(recording: Recording, *, blocking: bool = False) -> Finding | None:
    """First finding from a recording's rows alone, None without any. With ``blocking`` only
    findings count that make the recording useless even for a diagnosis. A `RecordingError` without
    a wrench."""
    recording.require_wrench()
    checks = (_lost, _channels, _spikes, _ranges, _clock, standing)
    findings = (finding for check in checks for finding in check(recording))
    return next((f for f in findings if f.blocks or not blocking), None)


def _without_lever(recording: Recording, channel: str) -> bool:
    """Whether the stated CoG makes a torque channel exactly 0, as in a simulation without noise."""
    cog = recording.metadata.tool.cog
    if cog is None or channel not in CHANNELS[3:] or recording.metadata.source != "sim":
        return False
    axis = CHANNELS.index(channel) - 3
    return all(c == 0.0 for k, c in enumerate(cog) if k != axis)


def _channels(recording: Recording) -> Iterator[Finding]:
    for c in CHANNELS:
        column = recording.columns[c]
        if np.ptp(column) == 0.0 and not (column[0] == 0.0 and _without_lever(recording, c)):
            yield Finding(
                "dead channel",
                f"column {c!r} is {column[0] + 0.0:g} in every row: a dead or missing "
                "channel, not a measurement. Repair it, or check the column map",
            )
        row, rows = _longest_run(column)
        if rows > max(2.0, STUCK * len(column)):
            yield Finding(
                "stuck channel",
                f"column {c!r} stays at {column[row]:g} for {rows} rows from row "
                f"{row} on: the channel is stuck. Leave these rows out, or record again",
            )
        most = max(np.count_nonzero(column == end) for end in (column.max(), column.min()))
        if most > CLIPPED * len(column) and len(column) >= FEW:
            yield Finding(
                "saturated",
                f"column {c!r} stands at its end in {100 * most / len(column):.0f} % of "
                "the rows: it is saturated. Choose a larger range",
            )
        if most > max(LEAST_AT_END, LEAST_CLIPPED * len(column)):
            yield from _one_sided(recording, c)


def _one_sided(recording: Recording, channel: str) -> Iterator[Finding]:
    """Yield a finding if a channel is clipped at one end of its range but not at the other.

    A limit that holds in both directions is an effect, which a diagnosis can name.
    """
    levels, count = np.unique(recording.columns[channel], return_counts=True)
    for end, other in ((-1, 0), (0, -1)):
        rest = count[:-1] if end else count[1:]
        clipped = count[end] > max(LEAST_AT_END, LEAST_CLIPPED * len(recording))
        read = levels[end] != 0.0  # rows without a reading, see `_lost`
        farther = abs(levels[other]) > 1.02 * abs(levels[end])
        if clipped and read and count[end] > PILE * rest.max() and farther:
            row = int(np.argmax(recording.columns[channel] == levels[end]))
            yield Finding(
                "saturated",
                f"column {channel!r}, row {row}: {count[end]} rows stand at "
                f"exactly {levels[end]:g}, beyond which nothing is read: it is saturated. Choose a "
                "larger range, or leave these rows out",
            )


def usable(recording: Recording) -> np.ndarray:
    """Booleans (N,): rows without a channel that is marked as saturated. Live drivers mark them in
    ``saturated``, simulations in ``status``; a real device's status word drops nothing."""
    flags = recording.columns.get("saturated")
    if flags is None and recording.metadata.source == "sim":
        flags = recording.columns.get("status")
    if flags is None:
        return np.ones(len(recording), dtype=bool)
    return (flags.astype(np.uint32) & STATUS_SATURATED) == 0


def _ranges(recording: Recording) -> Iterator[Finding]:
    """Yield findings on rows at the end of one of the sensor's ranges, not marked as saturated."""
    model, keep = recording.metadata.sensor.model, usable(recording)
    if model is None or not registry.is_known("sensors", model):
        return
    for calibration in registry.load("sensors", model).calibrations:
        for c, full in zip(CHANNELS, calibration.range, strict=True):
            size = np.abs(recording.columns[c][keep])
            top = float(size.max())
            ends = np.flatnonzero(size == top)
            near = min(abs(top / (full * end) - 1.0) for end in ENDS)
            if near < AT_END and len(ends) > max(2, LEAST_CLIPPED * len(size)):
                row = int(np.flatnonzero(keep)[ends[0]])
                yield Finding(
                    "saturated",
                    f"column {c!r}, row {row}: stands at {top:g}, the end of the "
                    f"range {calibration.name} of {model}, in {len(ends)} rows that no status "
                    "marks: it is saturated. Choose a larger range or a lighter tool",
                )


def _lost(recording: Recording) -> Iterator[Finding]:
    """Yield findings on rows without a reading: all channels 0, or one 0 amid large values."""
    blank = np.asarray(~recording.wrench.any(axis=1))
    if LEAST_LOST <= blank.sum() < len(recording):
        yield _no_readings("all channels are", blank)
    for c in CHANNELS:
        y = np.asarray(recording.columns[c], dtype=float)
        there = np.flatnonzero(y)
        if len(y) - len(there) < LEAST_LOST or len(there) < 2:
            continue
        change = np.abs(np.diff(y[there]))
        step = max(float(np.median(change)), float(change.min(initial=np.inf, where=change > 0.0)))
        size = np.minimum(np.abs(y[there])[:-1], np.abs(y[there])[1:])
        lost = (np.diff(there) > 1) & (size > FAR * step) & (change < ALIKE * size)
        if lost.sum() >= LEAST_LOST:
            yield _no_readings(f"column {c!r} is", y == 0.0)


def _no_readings(what: str, rows: np.ndarray) -> Finding:
    """Finding that ``what`` (such as "all channels are") is 0 in the rows marked in ``rows`` (N,),
    a boolean mask, for lack of a reading."""
    return Finding(
        "spike",
        f"{what} exactly 0 in {rows.sum()} rows (the first: row {int(np.argmax(rows))}) between "
        f"others: no readings came. Leave them out{_OR_HUBER}",
        blocks=False,
    )


def _spikes(recording: Recording) -> Iterator[Finding]:
    """Yield findings on single rows far from both neighbours, which no load can cause."""
    if len(recording) < 20:
        return
    for c, unit in zip(CHANNELS, UNITS, strict=True):
        y = np.asarray(recording.columns[c], dtype=float)
        off = _off_neighbours(y)
        if np.count_nonzero(off >= off.max() / FAR) > _USUAL * len(y) + 1.0:
            continue  # the usual step is no less than that
        step = max(float(np.quantile(off, 1.0 - _USUAL)), 1e-12)
        usual = _MAD * float(np.median(np.abs(y - np.median(y))))
        far = off > max(SPIKE * usual, FAR * step)
        if far.any() and far.sum() <= max(2, SPIKES * len(y)):
            row = int(np.argmax(off))
            more = np.setdiff1d(np.flatnonzero(far), row)
            others = f" (so are rows {', '.join(map(str, more[:MOST_NAMED]))})" if len(more) else ""
            yield Finding(
                "spike",
                f"column {c!r}, row {row}: a spike, {y[row]:.4g} {unit} between {y[row - 1]:.4g} "
                f"and {y[row + 1]:.4g}{others}: no load comes and goes within a row. Leave it "
                f"out{_OR_HUBER}",
                blocks=bool(off[row] > ABSURD * usual),
            )


def _off_neighbours(y: np.ndarray) -> np.ndarray:
    """Distance (N,) of each value from the interval between its two neighbours; 0 at both ends."""
    low, high = np.minimum(y[:-2], y[2:]), np.maximum(y[:-2], y[2:])
    off = np.zeros(len(y))
    np.abs(np.subtract(y[1:-1], np.clip(y[1:-1], low, high, out=low), out=high), out=off[1:-1])
    return off


def _clock(recording: Recording) -> Iterator[Finding]:
    rate = recording.metadata.rate_hz
    if recording.metadata.mode != "dynamic" or rate is None or len(recording) < 3:
        return
    step = float(np.median(np.diff(recording.t)))
    if abs(step * rate - 1.0) > CLOCK:
        hint = next(
            (f" (is t in {u}?)" for u, f in (("ms", 1e3), ("µs", 1e6), ("min", 1 / 60.0))
             if abs(step * rate / f - 1.0) < CLOCK), "",
        )  # fmt: skip
        yield Finding(
            "clock",
            f"column 't' steps by {step:.4g} s, metadata rate_hz = {rate:g} means "
            f"{1.0 / rate:.4g} s{hint}: in motion all accelerations depend on it. State t in s and "
            "the rate that was recorded",
        )


def frozen_joints(recording: Recording) -> list[tuple[str, int, int]]:
    """Joint columns that are exactly constant for more rows than any pose lasts, while others
    change. Returns of each: column, or `ALL` for all joints together; first row; number of rows."""
    names = recording.joints or QUATERNION
    columns = [np.asarray(recording.columns[n]) for n in names]
    moved = np.zeros(len(recording) - 1, dtype=bool)
    for x in columns:
        moved |= np.diff(x) != 0.0
    travelled = np.concatenate([[0], np.cumsum(moved)])
    most = max(3, int(0.05 * travelled[-1]))
    runs = []
    for name, x in zip(names, columns, strict=True):
        row, rows = _longest_run(x)
        if travelled[row + rows - 1] - travelled[row] > most:
            runs.append((name, row, rows))
    row, rows = _longest_run(travelled)
    segment = recording.columns.get("segment", np.zeros(len(recording)))
    poses = len(np.unique(segment[row : row + rows]))
    if poses > most if recording.metadata.mode == "static" else rows > 0.05 * len(recording):
        runs.append((ALL, row, rows))
    return runs


def standing(recording: Recording) -> Iterator[Finding]:
    """Yield findings on a motion in which all joints stand for a while but the readings change."""
    std = recording.metadata.sensor.noise_std
    if recording.metadata.mode != "dynamic" or std is None or not recording.joints:
        return
    for name, row, count in frozen_joints(recording):
        part = recording.wrench[row : row + count]
        if name == ALL and (part.std(axis=0) > MOVES * np.asarray(std)).any():
            yield Finding(
                "frozen joint",
                f"all joints stay where they are for {count} rows from row {row} on while the "
                "readings move on: frozen, or a hand at rest. Leave these rows out",
            )


def _longest_run(column: np.ndarray) -> tuple[int, int]:
    """First row and length of the longest run of equal values in a column (N,)."""
    starts = np.concatenate([[0], np.flatnonzero(np.diff(column)) + 1])
    lengths = np.diff(np.append(starts, len(column)))
    longest = int(lengths.argmax())
    return int(starts[longest]), int(lengths[longest])


def contradicted(recording: Recording, keep: np.ndarray, count: np.ndarray) -> Finding | None:
    """Finding if the rows of a pose differ too much to be repeats of it; None otherwise.

    Rows of the move before, or of no measurement, shift the pose's mean and enlarge the noise by
    its repeats, so that no later check detects them. ``keep`` (N,), boolean, are the rows to use,
    ``count`` (M,) the number of those in each pose, in recorded order.
    """
    if count.mean() < OFF_ROWS:
        return None
    rows, y = np.flatnonzero(keep), recording.wrench[keep]
    pose = np.repeat(np.arange(len(count)), count)
    start = np.cumsum(count) - count
    # a row's value, as no row is at the median of a pose whose rows split in halves
    if (count == count[0]).all():
        middle = np.quantile(y.reshape(len(count), -1, 6), 0.5, axis=1, method="lower")
    else:
        parts = np.split(y, start[1:])
        middle = np.stack([np.quantile(part, 0.5, axis=0, method="lower") for part in parts])
    away = np.abs(y - middle[pose])
    step = np.where(away > 1e-9 * np.ptp(y, axis=0), away, np.inf).min(axis=0)  # of coarse sensors
    std = np.maximum(_MAD * np.median(away, axis=0), step)
    far = (away > OFF * std).any(axis=1)
    if far.sum() < max(OFF_ROWS, OFF_SHARE * len(y)):
        return None
    mean = np.add.reduceat(y, start) / count[:, None]
    moved = (mean - middle) / (std / np.sqrt(count)[:, None])
    if np.sqrt((moved**2).mean(axis=0)).max() < MOVED:
        return None
    share, row = 100.0 * far.mean(), int(rows[np.flatnonzero(far)[0]])
    off, at, last = (y - middle[pose])[far] / std, pose[far], len(count) - 1
    place = (np.arange(len(y)) - start[pose])[far]
    before, after = (
        _along(off, (middle[other] - middle[at]) / std) >= MOST
        for other in (np.maximum(at - 1, 0), np.minimum(at + 1, last))
    )
    rings = (place < EARLY * count[at]).mean() >= MOST
    if before or (rings and not after):
        return Finding(
            "order of poses",
            f"the first rows of the poses ({share:.1f} % of all, the first in row {row}) are those "
            f"of the move before: the wrench is late or filtered, or the tool still rings. Leave "
            f"out the first {int(np.quantile(place, 0.9)) + 1} rows of each pose",
        )
    if after:
        return Finding(
            "order of poses",
            f"the last rows of the poses ({share:.1f} % of all, the first in row {row}) are those "
            "of the move after: the wrench is early, or the joints are late. Leave out the last "
            f"{int(np.quantile(count[at] - place, 0.9))} rows of each pose",
        )
    if far.mean() > 0.5:
        return Finding(
            "order of poses",
            f"{share:.0f} % of the rows lie far from the middle of their pose, so its rows are no "
            "repeats: the wrench is late or is early by a good part of a pose, or poses begin at "
            "other rows. Compare the clocks of joints and wrench, and the column segment",
        )
    return Finding(
        "spike",
        f"{share:.1f} % of the rows lie far from all others of their pose (the first: row {row}): "
        f"they are no measurements of it. Leave them out{_OR_HUBER}",
    )


def _along(off: np.ndarray, way: np.ndarray) -> float:
    """Fraction of F deviations ``off`` (F, 6) that point along ``way`` (F, 6) and are shorter."""
    size = np.maximum((way**2).sum(axis=1), 1e-300)
    part = np.clip((off * way).sum(axis=1) / size, 0.0, 1.0)
    beside = ((off - part[:, None] * way) ** 2).sum(axis=1)
    return float((beside < ALONG * (off**2).sum(axis=1)).mean())
