"""Gaps of simulators on held-out rows, each with its bootstrap interval."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

DRAWS = 500
"""Number of resamples of the bootstrap over held-out blocks."""
ROUNDED = 12
"""Decimals of the noise floor: at rest it is only the rounding error of a mean of residuals."""


@dataclass(frozen=True)
class Interval:
    """A gap or share with its 95 % bootstrap interval over blocks of time or poses."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Closure:
    """Gaps on held-out rows, which no fit used: mean squared residual in variances of one row's
    noise, noise subtracted (0 when only noise is left).

    Attributes:
        configured, floor: gap of the simulator as stated, and of noise alone.
        calibrated: gap after the fit of bias, mass and CoG.
        with_effects: gap with the claimed effects too; None without any.
        closed: share of the gap that the effects close.
        black_box: share that a flexible model of the residual closes.
        rows: number of held-out rows.
        folds: number of parts of the recording, each of which was held out once.
        per_channel: gap of each channel ``before`` and ``after`` the effects.
        members: gap that each cause closes (what comes back without it), by `Part.label`.
        readings: readings (M, 6) of the scene by simulator: ``calibrated``, ``with_effects``.
        in_all: share of the gap of all channels together that the effects close.
        further: gap of channels but the first that each cause closes, by `Part.label`.
        start: gap of which ``closed`` is a share.
        closed_from: which gap that is, ``calibrated`` or ``configured``.
        apart: whether each channel has a device of its own, which may have a fault alone (joints).
        untold: effect and joint of causes whose fitted size does not surely differ from 0.
    """

    configured: float
    calibrated: Interval
    with_effects: Interval | None
    floor: float
    closed: Interval | None
    black_box: float | None
    rows: int
    folds: int
    per_channel: Mapping[str, Mapping[str, float]]
    members: Mapping[str, Interval]
    readings: Mapping[str, np.ndarray]
    in_all: Interval | None = None
    further: Mapping[str, Interval] = field(default_factory=dict)
    start: float = 0.0
    closed_from: str = "calibrated"
    apart: bool = False
    untold: Collection[tuple[str, int | None]] = ()

    @property
    def closed_least(self) -> float:
        """Lower end of the share that the effects close; 0 without effects."""
        return 0.0 if self.closed is None else self.closed.low

    @property
    def left(self) -> float:
        """Gap beyond noise that the claimed effects leave; without any, the calibrated gap."""
        return (self.with_effects or self.calibrated).value - max(self.floor, 0.0)

    def closed_beside(self, counts: float) -> float:
        """Share of the gap that the effects close, 0…1, if they surely leave a gap above
        ``counts``, since they may then only resemble the true ones; else 1."""
        if self.closed is None or self.surely_left <= counts:
            return 1.0
        return min(max(self.closed.value, 0.0), 1.0)

    @property
    def surely_left(self) -> float:
        """Least gap beyond noise that the claimed effects leave; 0 without any."""
        return 0.0 if self.with_effects is None else self.with_effects.low - max(self.floor, 0.0)

    def outweighed(self, label: str, share: float, counts: float) -> bool:
        """Whether a cause closes less than ``share`` of a gap above ``counts`` that all causes
        together surely leave."""
        part = self.shares.get(label, 0.0) * self.excess
        return self.surely_left > counts and part < share * self.left

    @property
    def excess(self) -> float:
        """Calibrated gap above the noise floor."""
        return self.calibrated.value - max(self.floor, 0.0)

    @property
    def channels(self) -> float:
        """Mean calibrated gap of the channels, as of independent noise; the largest if `apart`."""
        each = [c["before"] for c in self.per_channel.values()]
        return float(np.max(each) if self.apart else np.mean(each))

    @property
    def shares(self) -> dict[str, float]:
        """Share of the gap that each cause closes, by `Part.label`: ``closed`` in proportion to the
        gap that returns without the cause.

        Each lies within 0 … 1: noise may let a twin end below the floor, or add to the gap.
        """
        back = {k: max(m.value, 0.0) for k, m in self.members.items()}
        total, closed = sum(back.values()), 0.0 if self.closed is None else self.closed.value
        closed = min(1.0, max(0.0, closed))
        return {k: closed * v / total if total > 0 else 0.0 for k, v in back.items()}


@dataclass(frozen=True, eq=False)
class Judged:
    """Gaps of simulators of one recording on its S observations, each held out of the fit.

    Attributes:
        block: number of each observation's block of time, or pose (S,).
        count: number of rows that each observation averages (S,).
        gaps: gap of each observation (S,) by simulator: ``configured``, ``calibrated``, ``box``,
            ``floor``; with a claim also ``with_effects``.
        without: gaps (S,) of the claimed simulator without each cause, by `Part.label`.
        channels: gap of each channel (C,) ``before`` and ``after``.
        readings: readings (M, 6) by simulator, as in `Closure.readings`.
        further: gaps (S,) of all channels beyond the first together, by simulator: ``calibrated``,
            ``with_effects``, and without each cause by its label; empty with one channel.
        names: names of the channels (C,), where they differ between recordings.
    """

    block: np.ndarray
    count: np.ndarray
    gaps: Mapping[str, np.ndarray]
    without: Mapping[str, np.ndarray]
    channels: Mapping[str, np.ndarray]
    readings: Mapping[str, np.ndarray] = field(default_factory=dict)
    further: Mapping[str, np.ndarray] = field(default_factory=dict)
    names: tuple[str, ...] = ()


def closure(
    each: Sequence[Judged], names: Sequence[str], folds: int, seed: int, *, stated: bool
) -> Closure:
    """Combine the gaps of all recordings, with bootstrap intervals over blocks.

    ``names`` of channels (C,) are those of recordings that do not state them. ``stated``: whether
    all causes are wrong stated numbers: the fit of bias, mass and CoG corrects these, so ``closed``
    counts from the configured gap.
    """
    drawn = Bootstrap([(j.block, j.count) for j in each], seed)
    gaps = {s: np.concatenate([j.gaps[s] for j in each]) for s in each[0].gaps}
    fitted, floor = gaps["calibrated"], gaps["floor"]
    scale = drawn.average(fitted) - drawn.average(floor)
    box = drawn.average(fitted) - drawn.average(gaps["box"])
    with_effects, closed, in_all = None, None, None
    members, further = dict[str, Interval](), dict[str, Interval]()
    if "with_effects" in gaps:
        after = gaps["with_effects"]
        with_effects = drawn.mean(after)
        origin = gaps["configured"] if stated else fitted
        closed = drawn.ratio(origin - after, origin - floor)
        beside = {
            s: np.concatenate([j.further.get(s, np.zeros(len(j.count))) for j in each])
            for s in ("calibrated", "with_effects", *each[0].without)
        }
        before, diagnosed = origin + beside["calibrated"], after + beside["with_effects"]
        in_all = drawn.ratio(before - diagnosed, before - floor)
        for name in each[0].without:
            without = np.concatenate([j.without[name] for j in each])
            members[name] = drawn.mean(without + beside[name] - diagnosed)
            further[name] = drawn.mean(beside[name] - beside["with_effects"])
    rows = np.array([int(j.count.sum()) for j in each])
    known = [tuple(j.names or names) for j in each]
    per_channel = dict[str, dict[str, float]]()
    for name in dict.fromkeys(n for of in known for n in of):
        having = [(j, of.index(name)) for j, of in zip(each, known, strict=True) if name in of]
        weight = np.array([float(j.count.sum()) for j, _ in having])
        per_channel[name] = {
            stage: float(weight @ [j.channels[stage][k] for j, k in having] / weight.sum())
            for stage in each[0].channels
        }
    return Closure(
        configured=drawn.average(gaps["configured"]),
        calibrated=drawn.mean(fitted),
        with_effects=with_effects,
        floor=float(np.round(drawn.average(floor), ROUNDED)),
        closed=closed,
        black_box=None if scale <= 0 else box / scale,
        rows=int(rows.sum()),
        folds=folds,
        per_channel=per_channel,
        members=members,
        readings=each[0].readings,
        in_all=in_all,
        further=further,
        start=drawn.average(gaps["configured"] if stated else fitted),
        closed_from="configured" if stated else "calibrated",
    )


class Bootstrap:
    """Bootstrap over blocks of rows that no fit used, for means and ratios of means."""

    def __init__(self, each: Sequence[tuple[np.ndarray, np.ndarray]], seed: int) -> None:
        """Take for each recording the blocks (S,) of its observations and their row counts (S,)."""
        block = [np.stack([np.full_like(b, k), b]) for k, (b, _) in enumerate(each)]
        blocks, at = np.unique(np.concatenate(block, axis=1), axis=1, return_inverse=True)
        self._at = at.ravel()
        self._count = blocks.shape[1]
        self._weight = np.concatenate([count for _, count in each]).astype(float)
        rng = np.random.default_rng([seed, 30])
        self._drawn = rng.integers(self._count, size=(DRAWS, self._count))

    def average(self, gaps: np.ndarray) -> float:
        """Mean of gaps (S,), weighted by rows."""
        return float(gaps @ self._weight / self._weight.sum())

    def mean(self, gaps: np.ndarray) -> Interval:
        """Mean of gaps (S,), weighted by rows, with its interval."""
        result = self.ratio(gaps, np.ones(len(gaps)))
        assert result is not None  # there are rows
        return result

    def ratio(self, part: np.ndarray, of: np.ndarray) -> Interval | None:
        """Ratio of the sums of gaps ``part`` and ``of`` (S,), with its interval; None if of ≤ 0."""
        top, bottom = self._sums(part), self._sums(of)
        if bottom.sum() <= 0:
            return None
        scale = bottom[self._drawn].sum(axis=1)
        each = top[self._drawn].sum(axis=1) / np.where(scale > 0, scale, np.nan)
        value = float(top.sum() / bottom.sum())
        low, high = np.nanquantile(each, [0.025, 0.975])
        return Interval(value, min(value, float(low)), max(value, float(high)))

    def _sums(self, gaps: np.ndarray) -> np.ndarray:
        return np.bincount(self._at, gaps * self._weight, self._count)
