"""How far the gap shrinks, on blocks of time that no fit saw."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrenchbed.diagnosis.efforts.dictionary import BLOCKS, Dictionary
from wrenchbed.diagnosis.efforts.evidence import Evidence
from wrenchbed.diagnosis.efforts.twin_fit import TwinFit, fitted
from wrenchbed.diagnosis.explain.verdict import Part
from wrenchbed.diagnosis.gap.gaps import Closure, Interval

DRAWS = 500
"""Resamples of the bootstrap over blocks of time."""
_PARTS = 4
"""Folds in which the black box is cross-fitted; estimate: it has hundreds of columns."""


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Residuals of simulators on rows that their fits did not see, in noises of a row.

    Attributes:
        d: the columns.
        left: (M, J) by simulator: ``configured``, ``calibrated``, ``box``, and with causes
            ``with_effects`` and one without each cause, by its number.
        fit: with causes, on all rows.
    """

    d: Dictionary
    left: dict[str | int, np.ndarray]
    fit: TwinFit

    def gaps(self, which: str | int) -> np.ndarray:
        """Gap of a simulator at each row (M,), averaged over the joints that count there."""
        return self.gaps_of(self.left[which])

    def gaps_of(self, left: np.ndarray) -> np.ndarray:
        """The same (M,) of a residual (M, C) in noises of a row."""
        use = self.d.use * (self.d.y.size / self.d.use.sum())
        return np.asarray(((left**2 - 1.0) * self.d.noise_counts * use).mean(axis=1))


def held_out(d: Dictionary, blocks: Sequence[int]) -> HeldOut:
    """Residuals of all simulators on held-out rows."""
    left: dict[str | int, np.ndarray] = {
        "configured": _in_noise(d, np.zeros(len(d.names))), "calibrated": _cross_fitted(d, ()),
        "box": _box(d),
    }  # fmt: skip
    if blocks:
        left["with_effects"] = _cross_fitted(d, blocks)
        for k in blocks:
            beside = [b for b in blocks if b != k]
            left[k] = _cross_fitted(d, blocks, k) if _is_tool(d, k) else _cross_fitted(d, beside)
    return HeldOut(d, left, fitted(d, blocks))


def _in_noise(d: Dictionary, x: np.ndarray, rows: np.ndarray | None = None) -> np.ndarray:
    use = slice(None) if rows is None else rows
    std = np.array([n.std for n in d.noise])
    made = []
    for j in range(d.y.shape[1]):
        at, data = d.columns(j)
        made.append(data[use] @ x[at])
    return np.asarray((d.y[use] - np.stack(made, axis=-1)) / std)


def _is_tool(d: Dictionary, block: int) -> bool:
    """Whether a cause is a wrong number of the stated tool: it counts from what is configured
    (`docs/contracts.md`), so no ordinary error of a link takes its place."""
    return d.blocks[block].effect.startswith("tool.")


def _cross_fitted(d: Dictionary, blocks: Sequence[int], absent: int | None = None) -> np.ndarray:
    """Held-out residual (M, C) beside causes, in noises of a row; ``absent`` is fitted with the
    others and then left out."""
    result = np.zeros_like(d.y)
    std = np.array([n.std for n in d.noise])
    x = np.stack([fitted(d, blocks, without=k).x for k in range(BLOCKS)])
    if absent is not None:
        x[:, d.at[absent]] = 0.0
    some = np.flatnonzero(np.abs(x).max(axis=0) > 0.0)
    for j in range(d.y.shape[1]):
        at, data = d.columns(j)
        own = np.isin(at, some)
        used, values = data[:, own], x[:, at[own]]
        result[:, j] = d.y[:, j] - np.einsum("mk,mk->m", used, values[d.fold])
    return result / std


def _box(d: Dictionary) -> np.ndarray:
    """Held-out residual (M, J) of a regression on all columns at once, in noises of a row."""
    result, std = np.zeros_like(d.y), np.array([n.std for n in d.noise])
    every = list(range(len(d.blocks)))
    for part in range(_PARTS):
        weight = (np.arange(BLOCKS) * _PARTS // BLOCKS != part).astype(float)
        x = Evidence(d, weight, 1.0).amplitudes(every)
        rows = np.isin(d.fold, np.flatnonzero(weight == 0.0))
        result[rows] = _in_noise(d, x, rows) * std
    return result / std


def closed_of_configured(h: HeldOut, blocks: Sequence[int], seed: int = 0) -> Interval | None:
    """Share of the configured gap that causes close if all are stated numbers; else None."""
    if not blocks or not all(h.d.stated[h.d.at[b]].all() for b in blocks):
        return None
    before = h.gaps("configured")
    return _ratio(h, seed, before - h.gaps("with_effects"), before)


def _ratio(h: HeldOut, seed: int, part: np.ndarray, of: np.ndarray) -> Interval | None:
    """Ratio of two sums over rows (M,) with its bootstrap interval over blocks; None if the second
    sum is not positive."""
    rng = np.random.default_rng([seed, 30])
    drawn = rng.integers(BLOCKS, size=(DRAWS, BLOCKS))
    top, bottom = (np.bincount(h.d.fold, v, BLOCKS) for v in (part, of))
    if bottom.sum() <= 0.0:
        return None
    scale = bottom[drawn].sum(axis=1)
    each = top[drawn].sum(axis=1) / np.where(scale > 0.0, scale, np.nan)
    value = float(top.sum() / bottom.sum())
    low, high = np.nanquantile(each, [0.025, 0.975])
    return Interval(value, min(value, float(low)), max(value, float(high)))


def label(d: Dictionary, block: int) -> str:
    """Name of a cause with its joint, as `Part.label` has it."""
    return Part(d.blocks[block].effect, 0.0, joint=d.blocks[block].joint).label


def _names(d: Dictionary, prefix: str) -> list[str]:
    """Recording's column of each channel (C,)."""
    joints = [f"{prefix}{j + 1}" for j in range(d.scene.joints)]
    return [*joints, *d.scene.channels[len(joints) :]]


def closure(h: HeldOut, blocks: Sequence[int], prefix: str, seed: int = 0) -> Closure:
    """Gaps with intervals from blocks of time drawn anew."""

    def mean(gaps: np.ndarray) -> Interval:
        ratio = _ratio(h, seed, gaps, np.ones(len(gaps)))
        assert ratio is not None
        return ratio

    before = h.gaps("calibrated")
    after = h.gaps("with_effects") if blocks else None
    scale = float(before.mean())
    last = h.left["with_effects"] if blocks else None
    channels = {}
    for j, name in enumerate(_names(h.d, prefix)):
        use, scale = h.d.use[:, j], h.d.noise_counts[j]
        own = {"before": float(scale * ((h.left["calibrated"][use, j] ** 2).mean() - 1.0))}
        if last is not None:
            own["after"] = float(scale * ((last[use, j] ** 2).mean() - 1.0))
        channels[name] = own
    return Closure(
        configured=float(h.gaps("configured").mean()),
        calibrated=mean(before),
        with_effects=None if after is None else mean(after),
        floor=0.0,
        closed=None if after is None else _ratio(h, seed, before - after, before),
        black_box=None if scale <= 0.0 else float((before - h.gaps("box")).mean()) / scale,
        rows=len(h.d.y),
        folds=BLOCKS,
        per_channel=channels,
        members={label(h.d, k): mean(h.gaps(k) - h.gaps("with_effects")) for k in blocks},
        in_sample=None if after is None else float(h.gaps_of(_in_noise(h.d, h.fit.x)).mean()),
        readings={},
    )
