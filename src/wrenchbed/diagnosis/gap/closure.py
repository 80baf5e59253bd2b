"""How far the gap shrinks: the twin runs in MuJoCo on rows that took no part in any fit.

Beside it a black box, a flexible model of the residual: it closes a gap and names nothing.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from wrenchbed.diagnosis.evidence.dictionary import variables
from wrenchbed.diagnosis.explain.refit import Finalist
from wrenchbed.diagnosis.explain.structures import Analysis
from wrenchbed.diagnosis.gap.held_out import CrossFit, HeldOut, corrected
from wrenchbed.diagnosis.prepare.prepared import Prepared
from wrenchbed.effects.chain import ActiveEffect
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.twin.twin import Twin

RIDGES = 10.0 ** np.arange(-3.0, 3.0, 0.5)
"""Prior variances of a coefficient, in noises of a row, that are tried."""
NOISES = 2.0 ** np.arange(0.0, 8.0)
"""Variances of what the box does not fit, in noises of a row, that are tried."""


def black_box(prepared: Prepared, reading: np.ndarray) -> np.ndarray:
    """What ridge regressions on all kernels add to readings (M, 6) of a simulator.

    Each fold is predicted by a regression on the others, channel by channel, with the prior of
    largest evidence.
    """
    held = prepared.scene.held
    x = np.concatenate(list(variables(prepared).values()), axis=1)
    y = (prepared.y - reading[held]) / prepared.sigma
    at = np.flatnonzero(held)
    result = np.zeros_like(reading)
    for fold in prepared.folds:
        fitted = prepared.without(fold).fitted
        away = _ridge(x, y, fitted, prepared.stride, float(prepared.noise.mean()))
        result[at[~fitted]] = away[~fitted] * prepared.sigma
    return result


def _ridge(x: np.ndarray, y: np.ndarray, fit: np.ndarray, stride: int, noise: float) -> np.ndarray:
    """Predictions (H, 6) of whitened y (H, 6) from x (H, k), learnt where ``fit`` (H,)."""
    x = (x - x[fit].mean(axis=0)) / np.maximum(x[fit].std(axis=0), 1e-9)
    x = np.column_stack([np.ones(len(x)), x])
    use = np.flatnonzero(fit)[::stride]
    u, s, vt = np.linalg.svd(x[use], full_matrices=False)
    inside = u.T @ y[use]
    outside = (y[use] ** 2).sum() - (inside**2).sum()
    free = y[use].size - inside.size

    def evidence(prior: float, level: float) -> float:
        k = (s**2 * prior + level)[:, None]
        fitted = (inside**2 / k).sum() + 6 * np.log(k).sum()
        return -0.5 * float(fitted + outside / level + free * np.log(level))

    prior, level = max(((p, v) for p in RIDGES for v in noise * NOISES), key=lambda t: evidence(*t))
    shrunk = (s * prior / (s**2 * prior + level))[:, None] * inside
    return np.asarray(x @ (vt.T @ shrunk))


DRAWS = 500
"""Of the bootstrap over held-out blocks."""


@dataclass(frozen=True)
class Interval:
    """An estimate with its 95 % interval, from blocks drawn anew."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Closure:
    """Gaps on held-out rows (`docs/nomenclature.md`: 0 when only noise is left).

    Attributes:
        configured, floor: of the simulator as stated, and of noise alone.
        calibrated: after bias, mass and CoG.
        with_effects: with the claimed effects too.
        closed: share of the gap that the effects close.
        black_box: share that a flexible model of the residual closes.
        rows: held-out rows.
        folds: parts of the recording, each of which was held out once.
        per_channel: gap per channel before and after.
        members: gap that each cause closes, by name: what comes back without it.
        in_sample: gap with the claimed effects on rows that the fit did see.
        readings: (M, 6) of the scene's rows by simulator: ``calibrated``, ``with_effects``.
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
    in_sample: float | None
    readings: Mapping[str, np.ndarray]

    @property
    def excess(self) -> float:
        """Calibrated gap beyond the noise."""
        return self.calibrated.value - max(self.floor, 0.0)

    @property
    def shares(self) -> dict[str, float]:
        """The closed share among the causes, by how much of the gap comes back without each."""
        back = {k: max(m.value, 0.0) for k, m in self.members.items()}
        total, closed = sum(back.values()), 0.0 if self.closed is None else self.closed.value
        return {k: closed * v / total if total > 0 else 0.0 for k, v in back.items()}


def calibrated(a: Analysis) -> Twin:
    """The simulator after bias, mass and CoG are fitted."""
    return Twin(a.prepared.model, a.baseline.configuration.theta, (), a.prepared.recording.name)


def twin_of(a: Analysis, f: Finalist, keep: Sequence[int]) -> Twin:
    """The twin with some parts of a finalist, and the stated numbers as they come out beside it."""
    values = a.refitter.values(f.parts, f.x)
    active = tuple(ActiveEffect(f.parts[k].effect, values[k]) for k in keep)
    configuration = corrected(a.refitter, f, a.prepared.configuration)
    return Twin(a.prepared.model, configuration.theta, active, a.prepared.recording.name)


@dataclass(frozen=True, eq=False)
class Claimed:
    """The diagnosed simulator.

    Attributes:
        twin: fitted on all rows.
        finalist: the structure behind it.
        keep: parts of it that the twin has.
        wrong: stated numbers that are claimed to be wrong.
    """

    twin: Twin
    finalist: Finalist
    keep: tuple[int, ...]
    wrong: tuple[str, ...]


def measure(a: Analysis, claim: Claimed | None, seed: int = 0) -> Closure:
    """Configured, calibrated and diagnosed simulators on rows that their fits did not see.

    Args:
        a: the analysis of all rows.
        claim: the diagnosed simulator, None where no cause is claimed.
        seed: of the bootstrap.
    """
    p, held_out, fits = a.prepared, HeldOut(a.prepared), CrossFit(a)
    drawn = Bootstrap(held_out, seed)
    stated = held_out.of(Twin(p.model, p.theta).wrench(p.scene))
    before = fits.calibrated(calibrated(a))
    fitted, floor = held_out.of(before), held_out.floor()
    box = held_out.mean(held_out.of(before + black_box(p, before)))
    scale = held_out.mean(fitted) - held_out.mean(floor)
    channels, readings = {"before": held_out.channels(before)}, {"calibrated": before}
    with_effects, closed, in_sample = None, None, None
    members: dict[str, Interval] = {}
    if claim is not None:
        after, without = fits.explained(claim.twin, claim.finalist, claim.keep, claim.wrong)
        gaps = held_out.of(after)
        with_effects = drawn.mean(gaps)
        origin = stated if claim.wrong and not claim.keep else fitted
        closed = drawn.ratio(origin - gaps, origin - floor)
        members = {name: drawn.mean(held_out.of(r) - gaps) for name, r in without.items()}
        in_sample = held_out.mean(held_out.of(claim.twin.wrench(p.scene)))
        channels["after"], readings["with_effects"] = held_out.channels(after), after
    return Closure(
        configured=held_out.mean(stated),
        calibrated=drawn.mean(fitted),
        with_effects=with_effects,
        floor=held_out.mean(floor),
        closed=closed,
        black_box=None if scale <= 0 else (held_out.mean(fitted) - box) / scale,
        rows=held_out.rows,
        folds=len(p.folds),
        per_channel={
            c: {stage: float(gap[k]) for stage, gap in channels.items()}
            for k, c in enumerate(CHANNELS)
        },
        members=members,
        in_sample=in_sample,
        readings=readings,
    )


class Bootstrap:
    """Blocks of held-out rows drawn anew: what a mean, or a ratio of means, might as well be."""

    def __init__(self, held_out: HeldOut, seed: int) -> None:
        blocks, self._at = np.unique(held_out.block, return_inverse=True)
        self._count, self._weight = len(blocks), held_out.count.astype(float)
        rng = np.random.default_rng([seed, 30])
        self._drawn = rng.integers(len(blocks), size=(DRAWS, len(blocks)))
        self._rows = self._sums(np.ones(len(self._weight)))

    def mean(self, gaps: np.ndarray) -> Interval:
        """Of gaps (S,), over rows."""
        result = self.ratio(gaps, np.ones(len(gaps)))
        assert result is not None  # there are rows
        return result

    def ratio(self, part: np.ndarray, of: np.ndarray) -> Interval | None:
        """Of the sums of two gaps (S,); None where the second has none."""
        top, bottom = self._sums(part), self._sums(of)
        if bottom.sum() <= 0:
            return None
        scale = bottom[self._drawn].sum(axis=1)
        each = top[self._drawn].sum(axis=1) / np.where(scale > 0, scale, np.nan)
        low, high = np.nanquantile(each, [0.025, 0.975])
        return Interval(float(top.sum() / bottom.sum()), float(low), float(high))

    def _sums(self, gaps: np.ndarray) -> np.ndarray:
        return np.bincount(self._at, gaps * self._weight, self._count)
