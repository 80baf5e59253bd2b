"""Faults of many strengths that leave a recording plausible: what is published must hold the truth.

Each way states the words of which one must stand in a refusal. It is made by plain arrays. Where
the readings of a fault are those of other true values (an offset of the last joint and a turned
mount), it states these.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from altered import (
    holds,
    of_other_holds,
    with_added,
    with_columns,
    with_metadata,
    with_wrench,
    without_noise_stated,
)
from corrupted import KGF, LBF, Dice, Mutator, adds, mutator, zero_off
from sound import BASES, Good, Random
from wrenchbed.data.recording import Recording
from wrenchbed.physics.wrench import CHANNELS

Values = Mapping[str, float]
REST = ("ur5", "medrue", "oriented", "file")
ARMS = ("ur5", "motion", "file")
BIAS = tuple(f"sensor.bias.{c}" for c in CHANNELS)
MOUNT = tuple(f"mount.rotation.{a}" for a in "xyz")
LAST = {"ur5": "q6", "motion": "q6", "file": "q7", "medrue": ""}
"""The joint that turns the flange, which a turned mount replaces exactly."""


@dataclass(frozen=True, eq=False)
class Way:
    """A fault of one strength.

    Attributes:
        words: of which one stands in a sentence that names the fault.
        bases: recordings that it applies to.
        change: what it does to the rows.
        truth: values that the broken readings are true of, from those before and the base.
    """

    words: tuple[str, ...]
    bases: tuple[str, ...]
    change: Mutator
    truth: Callable[[Values, str], Values] = lambda values, base: values

    def make(self, sound: Good, base: str, rng: Random) -> Good:
        """The broken recording with the values that may be published of it."""
        truth = self.truth(sound.truth, base)
        return Good(self.change(Dice(sound.recording, rng)), truth)


@dataclass(frozen=True, eq=False)
class Mixed(Way):
    """Channels that a matrix (6, 6) mixes; a bias is what the sensor reads without a load."""

    matrix: Callable[[Random], np.ndarray] = lambda rng: np.eye(6)

    def make(self, sound: Good, base: str, rng: Random) -> Good:
        matrix = self.matrix(rng)
        read = matrix @ [sound.truth.get(n, 0.0) for n in BIAS]
        truth = {**sound.truth, **dict(zip(BIAS, map(float, read), strict=True))}
        return Good(with_wrench(sound.recording, sound.recording.wrench @ matrix.T), truth)


def mixed(words: tuple[str, ...], matrix: Callable[[Random], np.ndarray]) -> Mixed:
    """A mixture on all recordings."""
    return Mixed(
        words, BASES, lambda d: with_wrench(d.r, d.r.wrench @ matrix(d.rng).T), matrix=matrix
    )


def entry(to: str, of: str, value: float) -> Callable[[Random], np.ndarray]:
    """A channel shows a part of another one [1, m, 1/m], or more of itself."""
    matrix = np.eye(6)
    matrix[CHANNELS.index(to), CHANNELS.index(of)] += value
    return lambda rng: matrix


def gains(by: float, rng: Random) -> np.ndarray:
    """Two forces and a torque read too much or too little, by up to so much.

    A gain that all forces share cannot be told from a heavier tool, by no data.
    """
    factor = np.ones(6)
    some = [*rng.permutation(3)[:2], rng.integers(3, 6)]
    factor[some] += by * rng.uniform(0.5, 1.0, 3) * rng.choice([-1.0, 1.0], 3)
    return np.diag(factor)


@mutator
def shifted(d: Dice, rows: float) -> Recording:
    """The wrench comes so many rows late, a fraction between two."""
    k = np.arange(len(d.r), dtype=float)
    return with_wrench(d.r, np.stack([np.interp(k - rows, k, y) for y in d.r.wrench.T], axis=1))


@mutator
def low_passed(d: Dice, weight: float) -> Recording:
    """Each reading is the one before and a part of what is new: a filter of first order."""
    result = np.array(d.r.wrench)
    for k in range(1, len(result)):
        result[k] = (1.0 - weight) * result[k - 1] + weight * result[k]
    return with_wrench(d.r, result)


@mutator
def lost(d: Dice, part: float, *channels: str) -> Recording:
    """A part of the rows reads zero, in all channels or in some."""
    there = d.rng.random(len(d.r)) >= part
    return with_columns(d.r, {c: d.r.columns[c] * there for c in channels or CHANNELS})


@mutator
def lost_at_once(d: Dice, rows: int, times: int) -> Recording:
    """The wrench stays at zero for so many rows, several times."""
    there = np.ones(len(d.r))
    for begin in d.rng.integers(0, len(d.r) - rows, times):
        there[begin : begin + rows] = 0.0
    return with_wrench(d.r, d.r.wrench * there[:, None])


@mutator
def repeated(d: Dice, part: float) -> Recording:
    """A part of the rows repeats the reading before."""
    fresh = d.rng.random(len(d.r)) >= part
    fresh[0] = True
    last = np.maximum.accumulate(np.where(fresh, np.arange(len(d.r)), 0))
    return with_wrench(d.r, d.r.wrench[last])


@mutator
def of_elsewhere(d: Dice, part: float) -> Recording:
    """A part of the rows are readings of other rows of the recording."""
    wrong, rows = d.rng.random(len(d.r)) < part, np.arange(len(d.r))
    read = np.where(wrong, d.rng.integers(0, len(d.r), len(d.r)), rows)
    return with_wrench(d.r, d.r.wrench[read])


@mutator
def exchanged(d: Dice, pairs: int) -> Recording:
    """Pairs of poses read what the other one should."""
    order, places = np.arange(d.poses), d.rng.permutation(d.poses)[: 2 * pairs]
    order[places] = places.reshape(2, -1)[::-1].ravel()
    return of_other_holds(d.r, order)


def as_if_mounted(name: str, degrees: float) -> Callable[[Values, str], Values]:
    """True values where a joint's zero is off: a turned mount's, or MedRUE's own of that zero."""

    def truth(values: Values, base: str) -> Values:
        if f"d{name}" in values:
            return {**values, f"d{name}": values[f"d{name}"] - float(np.deg2rad(degrees))}
        if LAST[base] != name:
            return values
        stated = Rotation.from_rotvec([values.get(n, 0.0) for n in MOUNT])
        back = Rotation.from_euler("z", -degrees, degrees=True) * stated
        return {**values, **dict(zip(MOUNT, map(float, back.as_rotvec()), strict=True))}

    return truth


@mutator
def clock(d: Dice, times: float, stated: bool) -> Recording:
    """Time runs faster or slower; whether the stated rate does so too."""
    begin = d.r.t[0]
    run = with_columns(d.r, {"t": begin + times * (d.r.t - begin)})
    return with_metadata(run, rate_hz=d.r.metadata.rate_hz / times) if stated else run


@mutator
def drift(
    d: Dice, shape: Callable[[Dice], np.ndarray], rows: float, noise_stated: bool = False
) -> Recording:
    """A zero that wanders about its mean, by so many deviations of a row in all.

    Args:
        shape: its course (N, 6).
        rows: how far it wanders, in deviations of a row.
        noise_stated: whether the recording states its noise.
    """
    size = rows * d.noise * d.rng.choice([-1.0, 1.0], 6) * d.rng.uniform(0.5, 1.0, 6)
    course = shape(d)
    moved = with_added(d.r, size * (course - course.mean(axis=0)))
    return moved if noise_stated else without_noise_stated(moved)


def walk(d: Dice) -> np.ndarray:
    """A random walk (N, 6) of unit size at its end."""
    return np.cumsum(d.white(), axis=0) / np.sqrt(len(d.r))


def warm_up(d: Dice) -> np.ndarray:
    """An exponential (N, 1) that is over after a third of the recording."""
    return np.exp(-9.0 * d.along)


def touched(d: Dice) -> np.ndarray:
    """A light push (N, 6) of a fifth of the weight in every twentieth hold."""
    hold = holds(d.r)
    some = d.rng.permutation(hold.max() + 1)[: max(1, hold.max() // 20)]
    push = np.concatenate([d.rng.normal(0.0, 1.0, 3), d.rng.normal(0.0, 0.1, 3)])
    return np.isin(hold, some)[:, None] * push * 0.2 * KGF


@mutator
def limited(d: Dice, part: float, *channels: str) -> Recording:
    """Channels read no more than a part of their largest pose mean; the noise comes after."""
    wrench, hold = np.array(d.r.wrench), holds(d.r)
    for k in map(CHANNELS.index, channels):
        mean = (np.bincount(hold, wrench[:, k]) / np.bincount(hold))[hold]
        most = part * np.abs(mean).max()
        wrench[:, k] += np.clip(mean, -most, most) - mean
    return with_wrench(d.r, wrench)


@mutator
def bent(d: Dice, part: float, *channels: str) -> Recording:
    """Channels lack a part of their largest reading there, by the third power of the reading."""
    x = {c: d.r.columns[c] for c in channels}
    return with_columns(d.r, {c: y * (1.0 - part * (y / abs(y).max()) ** 2) for c, y in x.items()})


def _turned(make: Callable[..., Mutator], some: tuple[str, ...]) -> tuple[str, ...]:
    """Recordings where a curve shows: nearly constant forces, as MedRUE's, only read less."""
    every = REST if make is limited else BASES
    return tuple(b for b in every if b != "medrue" or some != CHANNELS[:3])


_LATE = ("is late", "is early", "one pose apart")
_GONE = ("far from all others", "spike", "no readings", "stays at 0")
_OTHERS = (*_GONE, *_LATE, "contact", "those of other rows")
_ZEROS = ("zero of q", "direction of gravity", "outside its limits")
_DRIFT = ("drift", "zero of the sensor jumps")
SUBTLE: dict[str, Way] = {
    **{
        f"gain of {c} {100 * by:+.0f} %": mixed((f"gain of {c}",), entry(c, c, by))
        for c in CHANNELS
        for by in (0.05, 0.1, 0.2, 0.3)
    },
    **{
        f"gains ±{100 * by:.0f} %": mixed(("gain of", "unknown"), partial(gains, by))
        for by in (0.05, 0.1, 0.3)
    },
    **{
        f"crosstalk of {of} in {to}, {100 * part:g} %": mixed(
            ("crosstalk", f"column {to!r}"), entry(to, of, part)
        )
        for to, of in map(str.split, ("fx fz", "fz fx", "ty fz", "tx fy", "tz fx", "tx ty"))
        for part in (0.01, 0.03, 0.05)
    },
    **{
        f"{c} in {unit}": mixed((c,), entry(c, c, factor - 1.0))
        for c, unit, factor in (
            ("fz", "kgf", 1.0 / KGF),
            ("fx", "lbf", 1.0 / LBF),
            ("tx", "N·mm", 1e3),
            ("ty", "N·cm", 1e2),
        )
    },
    **{
        f"wrench {rows:g} rows late": Way(_LATE, BASES, shifted(rows))
        for rows in (-1.0, 0.3, 0.5, 1.0, 1.5, 2.0, 3.0)
    },
    "wrench 10 rows late": Way(_LATE, ("motion",), shifted(10.0)),
    **{
        f"low-passed, {w:g}": Way((*_LATE, "filter"), BASES, low_passed(w))
        for w in (0.8, 0.6, 0.4, 0.2)
    },
    **{f"{100 * part:g} % lost": Way(_GONE, BASES, lost(part)) for part in (0.01, 0.05, 0.1)},
    "5 % of fz lost": Way(_GONE, BASES, lost(0.05, "fz")),
    "5 % of tx lost": Way(_GONE, BASES, lost(0.05, "tx")),
    "10 rows lost twice": Way(_GONE, BASES, lost_at_once(10, 2)),
    **{f"{100 * part:g} % repeated": Way(_LATE, BASES, repeated(part)) for part in (0.05, 0.2)},
    **{
        f"{100 * part:g} % of other rows": Way(_OTHERS, BASES, of_elsewhere(part))
        for part in (0.01, 0.05, 0.1)
    },
    "two poses exchanged": Way(_OTHERS, REST, exchanged(1)),
    "six poses exchanged": Way(_OTHERS, REST, exchanged(3)),
    **{
        f"{name} off by {degrees:g}°": Way(
            _ZEROS,
            (*ARMS, "medrue") if name in ("q2", "q6") else ARMS,
            zero_off(name, np.deg2rad(degrees)),
            as_if_mounted(name, degrees),
        )
        for name in ("q2", "q3", "q4", "q5", "q6")
        for degrees in (0.3, 1.0, 3.0)
    },
    **{
        f"time × {times:g}" + ", rate too" * stated: Way(
            ("clock", "column 't'", "is late"), ("motion",), clock(times, stated)
        )
        for times in (0.8, 0.9, 0.95, 0.98, 1.05, 1.1)
        for stated in (False, True)
    },
    **{
        f"drift of {rows} rows' noise" + ", stated" * stated: Way(
            _DRIFT, BASES, drift(lambda d: d.along, rows, stated)
        )
        for rows in (10, 30, 100)
        for stated in (False, True)
    },
    "walk of 30 rows' noise": Way(_DRIFT, BASES, drift(walk, 30)),
    "walk of 100 rows' noise": Way(_DRIFT, BASES, drift(walk, 100)),
    "warm-up of 30 rows' noise": Way(_DRIFT, BASES, drift(warm_up, 30)),
    "warm-up of 100 rows' noise": Way(_DRIFT, BASES, drift(warm_up, 100)),
    **{
        f"{' '.join(some)} {'bent' if make is bent else 'limited'}, {100 * part:g} %": Way(
            ("curve or limit",), _turned(make, some), make(part, *some)
        )
        for make, parts in ((limited, (0.5, 0.8, 0.95)), (bent, (0.02, 0.1, 0.3)))
        for some in (("fz",), ("tx", "ty"), CHANNELS[:3])
        for part in parts
    },
    "light touches": Way((*_OTHERS, "zero jumps"), BASES, adds(touched)),
}
"""Every fault of one strength by its name."""
