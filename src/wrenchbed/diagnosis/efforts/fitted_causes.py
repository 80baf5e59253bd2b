"""The better simulator: stated values within their ordinary spread, and the claimed causes alone.

Nothing else is free, so its residual is what no claim explains. Uncertainty is the scatter of fits
without each block of time (jackknife over blocks, Künsch 1989, doi 10.1214/aos/1176347265), which
grows with noise that has memory and with a law that is not right, and the shift of a fit by
ordinary errors of all stated values, which are the same in every block of time. The same fits say
how far the gap shrinks on rows that they did not see.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, partial

import numpy as np

from wrenchbed.diagnosis.efforts.columns import FREE
from wrenchbed.diagnosis.efforts.dictionary import BLOCKS, Dictionary
from wrenchbed.diagnosis.efforts.search import wide
from wrenchbed.diagnosis.evidence.likelihood import Products
from wrenchbed.diagnosis.explain.verdict import Part
from wrenchbed.diagnosis.gap.gaps import Judged

ORDINARY = 2.0
"""Spreads beyond which a stated value is wrong: 95 % of ordinary robots lie within."""
_ROUNDS = 6
"""Largest number of passes that fix amplitudes which leave their range."""
_RIDGE = 1e-8
"""Share of a column's square that is added to it: columns may be alike."""
_PARTS = 4
"""Folds in which the black box is cross-fitted: few, because it has hundreds of columns."""


@dataclass(frozen=True, eq=False)
class Simulator:
    """Simulator with some causes, whose sizes are fitted to all rows.

    Attributes:
        d: columns: changes of the readings per unit of a parameter.
        blocks: indices of the causes that are free without bounds.
    """

    d: Dictionary
    blocks: tuple[int, ...]

    @property
    def x(self) -> np.ndarray:
        """Fitted amplitude of each column (P,); 0 if neither a cause nor the usual fit uses it."""
        return self._fit[0]

    @cached_property
    def each(self) -> np.ndarray:
        """Amplitudes (B, P) of P columns, fitted without each of B blocks of time."""
        return np.stack([self._fitted(weight)[0] for weight in 1.0 - np.eye(BLOCKS)])

    @cached_property
    def errors(self) -> np.ndarray:
        """Errors (S, P) of P amplitudes when one of S stated values is off by its ordinary standard
        deviation, its own true change subtracted."""
        level, at = self._fit[1], np.flatnonzero(self._bounded)
        errors = level.held(level.gram[:, at]).T
        errors[np.arange(len(at)), at] -= 1.0
        return np.asarray(self.d.std[at, None] * errors)

    def number(self, of: Callable[[np.ndarray], float]) -> dict[str, float]:
        """``value`` and ``std`` of a number that ``of`` computes from all amplitudes (P,)."""
        value = of(self.x)
        each = np.array([of(x) for x in self.each])
        scatter = (BLOCKS - 1) / BLOCKS * ((each - each.mean()) ** 2).sum()
        stated = sum((of(self.x + error) - value) ** 2 for error in self.errors)
        return {"value": value, "std": float(np.sqrt(scatter + stated))}

    @cached_property
    def _fit(self) -> tuple[np.ndarray, Products]:
        return self._fitted(np.ones(BLOCKS))

    @cached_property
    def _unbounded(self) -> np.ndarray:
        """Whether each of P amplitudes is fitted without bounds (P,), boolean."""
        result = self.d.free.copy()
        result[[k for b in self.blocks for k in self.d.at[b]]] = True
        return result

    @property
    def _bounded(self) -> np.ndarray:
        """Whether each amplitude (P,) is of a stated value, free within its ordinary spread."""
        return self.d.stated & ~self._unbounded

    def _fitted(self, weight: np.ndarray) -> tuple[np.ndarray, Products]:
        """Amplitudes (P,) fitted to B time blocks with weights (B,), and the Gaussian model."""
        d, bounded, (gram, right) = self.d, self._bounded, self.d.weighed(weight)
        free = np.where(self._unbounded, FREE / np.maximum(d.size, 1e-12), 0.0)
        variance, fixed = np.where(bounded, d.std, free) ** 2, np.zeros(right.shape)
        for _ in range(_ROUNDS):
            level = Products(gram, variance)
            x = fixed + level.held(right - gram @ fixed)
            off = bounded & (variance > 0.0) & (np.abs(x[:, 0]) > ORDINARY * d.std)
            if not off.any():
                break
            fixed[off] = np.sign(x[off]) * ORDINARY * d.std[off, None]
            variance = np.where(off, 0.0, variance)
        return x[:, 0], level


class Simulators:
    """Cache of fitted simulators, by the indices of the causes that each contains."""

    def __init__(self, d: Dictionary) -> None:
        self.d, self._made = d, cache(partial(Simulator, d))

    def of(self, blocks: Iterable[int] = ()) -> Simulator:
        """Simulator with the causes of these indices; fitted at the first call."""
        return self._made(tuple(sorted(blocks)))

    def judged(self, blocks: Sequence[int]) -> Judged:
        """Gaps on rows that no fit used: as stated, after the usual fit, and with these causes.

        To measure one cause, the others are refitted without it. But a wrong number of the stated
        tool is measured from the configured value (`docs/contracts.md`), so no ordinary error of a
        link takes its place.
        """
        d, fit = self.d, self.of(blocks)
        each = {
            "configured": np.zeros((BLOCKS, len(d.names))), "calibrated": self.of().each,
            "box": _box(d),
        }  # fmt: skip
        if blocks:
            each["with_effects"] = fit.each
        without = dict[str, np.ndarray]()
        for k in blocks:
            amplitudes = self.of([b for b in blocks if b != k]).each
            if d.blocks[k].effect.startswith("tool."):
                amplitudes = fit.each.copy()
                amplitudes[:, d.at[k]] = 0.0
            label = Part(d.blocks[k].effect, 0.0, joint=d.blocks[k].joint).label
            without[label] = _gaps(d, remaining(d, amplitudes))
        residuals = {name: remaining(d, x) for name, x in each.items()}
        rows = len(d.fold)
        every = {name: _gaps(d, x) for name, x in residuals.items()} | {"floor": np.zeros(rows)}
        stages = {"before": "calibrated"} | ({"after": "with_effects"} if blocks else {})
        channels = {stage: _of_channels(d, residuals[name]) for stage, name in stages.items()}
        return Judged(d.fold, np.ones(rows), every, without, channels)


def added(d: Dictionary, x: np.ndarray, columns: np.ndarray) -> float:
    """Gap that some columns with amplitudes x (P,) add at the joint where it is largest, after the
    columns that every fit takes are fitted to it there.

    Columns common to all joints are known from the other joints, so they take up nothing of a cause
    in one drive.
    """
    joint, gap = d.joint[columns], 0.0
    in_one = bool((joint >= 0).all())
    free = d.free & (d.joint >= 0) if in_one else d.free
    for channel in [d.channels[joint[0]]] if in_one else d.channels:
        at, gram = channel.at, channel.gram
        here = np.isin(at, columns)
        taken = free[at] & ~here
        amplitudes = x[at[here]]
        square = float(amplitudes @ gram[np.ix_(here, here)] @ amplitudes)
        across, taking = gram[np.ix_(taken, here)] @ amplitudes, gram[np.ix_(taken, taken)]
        ridge = np.diag(np.maximum(np.diagonal(taking), 1e-300) * _RIDGE)
        gap = max(gap, square - float(across @ np.linalg.solve(taking + ridge, across)))
    return gap


def remaining(d: Dictionary, each: np.ndarray) -> np.ndarray:
    """Residual (M, C) in row noises; ``each`` (B, P): amplitudes fitted without each time block."""
    some, result = np.abs(each).max(axis=0) > 0.0, list[np.ndarray]()
    for channel in d.channels:
        of_channel = some[channel.at]
        values = each[:, channel.at[of_channel]][d.fold]
        made = np.einsum("mk,mk->m", channel.data[:, of_channel], values)
        result.append((channel.y - made) / channel.noise.std)
    return np.stack(result, axis=-1)


def _gaps(d: Dictionary, residual: np.ndarray) -> np.ndarray:
    """Gap at each of M rows (M,): mean over the C channels used there of a residual (M, C) in row
    noises."""
    use = np.stack([c.use for c in d.channels], axis=-1)
    counts = np.array([c.noise_counts for c in d.channels])
    return np.asarray(((residual**2 - 1.0) * counts * use * (use.size / use.sum())).mean(axis=1))


def _of_channels(d: Dictionary, residual: np.ndarray) -> np.ndarray:
    """Gap of each channel (C,) on the rows used, of a residual (M, C) in row noises."""
    each = zip(d.channels, residual.T, strict=True)
    return np.array([c.noise_counts * (np.mean(x[c.use] ** 2) - 1.0) for c, x in each])


def _box(d: Dictionary) -> np.ndarray:
    """Amplitudes (B, P) of a regression on all P columns, cross-fitted over B blocks of time."""
    part, of_causes = np.arange(BLOCKS) * _PARTS // BLOCKS, np.concatenate(d.at)
    std = d.std.copy()
    std[of_causes] = np.maximum(std, wide(d))[of_causes]
    both = [d.weighed((part != k).astype(float)) for k in range(_PARTS)]
    return np.stack([Products(gram, std**2).held(right)[:, 0] for gram, right in both])[part]
