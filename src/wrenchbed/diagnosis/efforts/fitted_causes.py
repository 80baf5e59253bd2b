"""Fits of a corrected simulator: stated values within their ordinary spread, and claimed causes.

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
from wrenchbed.diagnosis.efforts.dictionary import Dictionary
from wrenchbed.diagnosis.efforts.noise import RIDGE
from wrenchbed.diagnosis.efforts.search import AMPLITUDE, wide
from wrenchbed.diagnosis.evidence.likelihood import Products
from wrenchbed.diagnosis.explain.verdict import Part
from wrenchbed.diagnosis.gap.gap_bootstrap import Judged
from wrenchbed.drives.identify import jackknife
from wrenchbed.drives.joint_least_squares import FOLDS

ORDINARY = 2.0
"""Standard deviations by which a fit may move a stated value: 95 % of healthy robots lie within."""
_ROUNDS = 6
"""Largest number of passes that fix amplitudes which leave their range."""


@dataclass(frozen=True, eq=False)
class Simulator:
    """Simulator with some causes, whose sizes are fitted to all rows.

    Attributes:
        d: columns: changes of the readings per unit of a parameter.
        blocks: indices, in ``d.blocks``, of the causes that are free without bounds.
        rms: prior rms that each cause adds to the readings, over a row's noise std.
    """

    d: Dictionary
    blocks: tuple[int, ...]
    rms: float = FREE

    @property
    def x(self) -> np.ndarray:
        """Fitted amplitude of each column (P,); 0 for columns that the fit does not use."""
        return self._fit[0]

    @cached_property
    def each(self) -> np.ndarray:
        """Amplitudes (B, P) of P columns, fitted without each of B blocks of time."""
        return np.stack([self._fitted(fold)[0] for fold in range(FOLDS)])

    @cached_property
    def errors(self) -> np.ndarray:
        """Errors (S, P) of P fitted amplitudes if one of S stated values is wrong by its standard
        deviation in healthy robots; its own amplitude, which follows it, has no error."""
        level, at = self._fit[1], np.flatnonzero(self._bounded)
        errors = level.held(level.gram[:, at]).T
        errors[np.arange(len(at)), at] -= 1.0
        return np.asarray(self.d.std[at, None] * errors)

    def number(self, of: Callable[[np.ndarray], float]) -> dict[str, float]:
        """``value`` and ``std`` of a number that ``of`` computes from all amplitudes (P,)."""
        value = of(self.x)
        scatter = jackknife(np.array([[of(x)] for x in self.each]))[0, 0]
        stated = sum((of(self.x + error) - value) ** 2 for error in self.errors)
        return {"value": value, "std": float(np.sqrt(scatter + stated))}

    @cached_property
    def _fit(self) -> tuple[np.ndarray, Products]:
        return self._fitted()

    @cached_property
    def _unbounded(self) -> np.ndarray:
        """Whether each of P amplitudes is fitted without bounds (P,), boolean."""
        result = self.d.free.copy()
        result[[k for b in self.blocks for k in self.d.at[b]]] = True
        return result

    @property
    def _bounded(self) -> np.ndarray:
        """Whether each amplitude (P,) is of a stated value and kept within its ordinary spread."""
        return self.d.stated & ~self._unbounded

    def _fitted(self, fold: int | None = None) -> tuple[np.ndarray, Products]:
        """Amplitudes (P,) fitted to all time blocks but ``fold`` (None: all), and their model."""
        d, bounded, (gram, right) = self.d, self._bounded, self.d.without(fold)
        variance = np.where(bounded, d.std**2, self._unbounded * wide(d, self.rms))
        fixed = np.zeros(right.shape)
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
    """Cache of simulators fitted to joint efforts, by the indices of the causes in each."""

    def __init__(self, d: Dictionary) -> None:
        self.d, self._made = d, cache(partial(Simulator, d))
        self._box = Simulator(d, tuple(range(len(d.blocks))), AMPLITUDE)

    def of(self, blocks: Iterable[int] = ()) -> Simulator:
        """Simulator with the causes of these indices in ``d.blocks``; fitted at the first call."""
        return self._made(tuple(sorted(blocks)))

    def judged(self, blocks: Sequence[int]) -> Judged:
        """Held-out gaps: as stated, fitted without causes, with those of indices ``blocks``.

        To measure one cause, the others are refitted without it. But a wrong number of the stated
        tool is measured from the configured value (`docs/contracts.md`), so no ordinary error of a
        link takes its place. The black box, for comparison, has all causes at once.
        """
        d, fit, use = self.d, self.of(blocks), self._use
        each = {
            "configured": 0.0 * fit.each, "calibrated": self.of().each,
            "box": self._box.each,
        }  # fmt: skip
        stages = {"before": "calibrated"}
        if blocks:
            each["with_effects"], stages["after"] = fit.each, "with_effects"
        labels = {k: Part(d.blocks[k].effect, 0.0, joint=d.blocks[k].joint).label for k in blocks}
        for k, label in labels.items():
            each[label] = self.of([b for b in blocks if b != k]).each
            if d.blocks[k].effect.startswith("tool."):
                each[label] = fit.each.copy()
                each[label][:, d.at[k]] = 0.0
        every = {name: self._left(x) for name, x in each.items()}
        rows = {name: self._of_rows(x) for name, x in every.items()}
        rows["floor"] = np.zeros(len(use))
        channels = {s: every[name].sum(axis=0) / use.sum(axis=0) for s, name in stages.items()}
        without = {label: rows.pop(label) for label in labels.values()}
        return Judged(d.fold, np.ones(len(use)), rows, without, channels)

    def gap(self, blocks: Iterable[int], joint: int | None) -> np.ndarray:
        """Held-out gap (M,) by row with causes ``blocks``: of ``joint`` (from 1); None: of all."""
        left = self._left(self.of(blocks).each)
        return self._of_rows(left) if joint is None else left[:, joint - 1]

    @cached_property
    def _use(self) -> np.ndarray:
        return np.stack([c.use for c in self.d.channels], axis=-1)

    def _left(self, each: np.ndarray) -> np.ndarray:
        """Gap (M, C) of readings, 0 if unused; amplitudes (B, P) are fitted without each block."""
        counts = self._use * np.square([c.noise.std / c.counts for c in self.d.channels])
        return np.asarray((remaining(self.d, each) ** 2 - 1.0) * counts)

    def _of_rows(self, left: np.ndarray) -> np.ndarray:
        """Gap (M,) of each row, from gaps (M, C) of readings; its mean is that of used readings."""
        return np.asarray(left.sum(axis=1) * len(left) / self._use.sum())


def added(d: Dictionary, x: np.ndarray, columns: np.ndarray) -> float:
    """Gap that the columns of indices ``columns``, with amplitudes x (P,), add at the joint where
    it is largest, less what the columns that are free in every fit take up there.

    Columns common to all joints, known from the others, take up nothing of a cause in one drive.
    """
    joint, gap = d.joint[columns], 0.0
    in_one = bool((joint >= 0).all())
    free = d.free & (d.joint >= 0) if in_one else d.free
    for channel in [d.channels[joint[0]]] if in_one else d.channels:
        here = np.flatnonzero(np.isin(channel.at, columns))
        taken = free[channel.at] & ~np.isin(channel.at, columns)
        square = np.maximum(np.diagonal(channel.gram), 1e-300)
        beside = Products(channel.gram, np.where(taken, 1.0 / (square * RIDGE), 0.0))
        amplitudes = x[channel.at[here]]
        gap = max(gap, float(amplitudes @ beside.information(here[None])[0] @ amplitudes))
    return gap


def remaining(d: Dictionary, each: np.ndarray) -> np.ndarray:
    """Residual (M, C) of C channels over a row's noise: each of B time blocks is predicted by its
    row of ``each`` (B, P), amplitudes fitted without that block."""
    some, result = np.abs(each).max(axis=0) > 0.0, list[np.ndarray]()
    for channel in d.channels:
        of_channel = some[channel.at]
        values = each[:, channel.at[of_channel]][d.fold]
        made = np.einsum("mk,mk->m", channel.data[:, of_channel], values)
        result.append((channel.y - made) / channel.noise.std)
    return np.stack(result, axis=-1)
