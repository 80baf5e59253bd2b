"""How far the gap shrinks, on blocks of time that no fit saw."""

from collections.abc import Sequence

import numpy as np

from wrenchbed.diagnosis.efforts.dictionary import BLOCKS, Dictionary
from wrenchbed.diagnosis.efforts.evidence import Evidence
from wrenchbed.diagnosis.efforts.simulator import Simulators
from wrenchbed.diagnosis.explain.verdict import Part
from wrenchbed.diagnosis.gap.gaps import Judged

_PARTS = 4
"""Folds in which the black box is cross-fitted; estimate: it has hundreds of columns."""


def remaining(d: Dictionary, each: np.ndarray) -> np.ndarray:
    """Residual (M, C) in noises of a row beside amplitudes (B, P) of each block of time."""
    some, result = np.flatnonzero(np.abs(each).max(axis=0) > 0.0), d.y.copy()
    for j, noise in enumerate(d.noise):
        at, data = d.columns(j)
        own = np.isin(at, some)
        used, values = data[:, own], each[:, at[own]]
        result[:, j] -= np.einsum("mk,mk->m", used, values[d.fold])
        result[:, j] /= noise.std
    return result


def judged(s: Simulators, blocks: Sequence[int]) -> Judged:
    """Simulators on held-out rows: as stated, after the usual fit, and with some causes.

    A cause is left out where the others are fitted anew without it. But a wrong number of the
    stated tool counts from what is configured (`docs/contracts.md`), so no ordinary error of a link
    takes its place.
    """
    d, fit = s.d, s.of(blocks)
    each = {
        "configured": np.zeros((BLOCKS, len(d.names))), "calibrated": s.of().each, "box": _box(d),
    }  # fmt: skip
    if blocks:
        each |= {"with_effects": fit.each, "in_sample": np.tile(fit.x, (BLOCKS, 1))}
    without = dict[str, np.ndarray]()
    for k in blocks:
        amplitudes = s.of([b for b in blocks if b != k]).each
        if d.blocks[k].effect.startswith("tool."):
            amplitudes = fit.each.copy()
            amplitudes[:, d.at[k]] = 0.0
        without[Part(d.blocks[k].effect, 0.0, joint=d.blocks[k].joint).label] = gaps(
            d, remaining(d, amplitudes)
        )
    left = {name: remaining(d, x) for name, x in each.items()}
    every = {name: gaps(d, x) for name, x in left.items()} | {"floor": np.zeros(len(d.y))}
    stages = {"before": "calibrated"} | ({"after": "with_effects"} if blocks else {})
    channels = {stage: _of_channels(d, left[name]) for stage, name in stages.items()}
    return Judged(d.fold, np.ones(len(d.y)), every, without, channels)


def gaps(d: Dictionary, left: np.ndarray) -> np.ndarray:
    """Gap at each row (M,) of a residual (M, C) in noises of a row, averaged over the joints that
    count there."""
    use = d.use * (d.y.size / d.use.sum())
    return np.asarray(((left**2 - 1.0) * d.noise_counts * use).mean(axis=1))


def _of_channels(d: Dictionary, left: np.ndarray) -> np.ndarray:
    """Gap of each channel (C,) on the rows that count there."""
    return np.asarray(d.noise_counts * ((left**2 * d.use).sum(axis=0) / d.use.sum(axis=0) - 1.0))


def _box(d: Dictionary) -> np.ndarray:
    """Amplitudes (B, P) of a regression on all columns at once, cross-fitted in few parts."""
    part, every = np.arange(BLOCKS) * _PARTS // BLOCKS, list(range(len(d.blocks)))
    each = [Evidence(d, (part != k).astype(float)).amplitudes(every) for k in range(_PARTS)]
    return np.stack(each)[part]
