"""The better simulator: stated values within their ordinary spread, and the claimed causes alone.

Nothing else is free, so that what it leaves is what nobody named. Uncertainty is the scatter of
fits without each block of time (jackknife over blocks, Künsch 1989, doi 10.1214/aos/1176347265),
which grows with noise that remembers and with a law that is not right, and what ordinary errors of
all stated values move a fit by: the same in every block of time.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache, cached_property, partial

import numpy as np

from wrenchbed.diagnosis.efforts.columns import FREE
from wrenchbed.diagnosis.efforts.dictionary import BLOCKS, Dictionary
from wrenchbed.diagnosis.efforts.evidence import Evidence
from wrenchbed.diagnosis.evidence.likelihood import Products

ORDINARY = 2.0
"""Spreads beyond which a stated value is wrong: 95 % of ordinary robots lie within."""
_ROUNDS = 6
"""Largest number of passes that fix amplitudes which leave their range."""
_RIDGE = 1e-8
"""Share of a column's square that is added to it: columns may be alike."""


@dataclass(frozen=True, eq=False)
class Simulator:
    """A simulator with some causes.

    Attributes:
        d: the columns.
        blocks: causes that are free without bounds.
    """

    d: Dictionary
    blocks: tuple[int, ...]

    @property
    def x(self) -> np.ndarray:
        """Amplitudes of all columns (P,), zero where they take no part."""
        return self._fit[0]

    @cached_property
    def each(self) -> np.ndarray:
        """Amplitudes (B, P) without each block of time."""
        return np.stack([self._fitted(weight)[0] for weight in 1.0 - np.eye(BLOCKS)])

    @cached_property
    def errors(self) -> np.ndarray:
        """What a fit takes for other values, less what was off: errors (S, P) of all amplitudes
        where one stated value is off by its ordinary spread."""
        level, at = self._fit[1], np.flatnonzero(self._bounded)
        errors = level.held(level.gram[:, at]).T
        errors[np.arange(len(at)), at] -= 1.0
        return np.asarray(self.d.std[at, None] * errors)

    def number(self, of: Callable[[np.ndarray], float]) -> dict[str, float]:
        """``value`` and ``std`` of a number that is made ``of`` amplitudes (P,)."""
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
        """Which amplitudes (P,) have no bounds, boolean."""
        result = self.d.free.copy()
        result[[k for b in self.blocks for k in self.d.at[b]]] = True
        return result

    @property
    def _bounded(self) -> np.ndarray:
        """Which amplitudes (P,) are of stated values within their ordinary spread, boolean."""
        return self.d.stated & ~self._unbounded

    def _fitted(self, weight: np.ndarray) -> tuple[np.ndarray, Products]:
        """Amplitudes (P,) of weighted blocks of time (B,), and what they were fitted with."""
        d, evidence, bounded = self.d, Evidence(self.d, weight), self._bounded
        gram, right = evidence.level.gram, evidence.right
        wide = np.where(self._unbounded, FREE / np.maximum(d.size, 1e-12), 0.0)
        variance, fixed = np.where(bounded, d.std, wide) ** 2, np.zeros(right.shape)
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
    """Simulators with causes, each of which is fitted once; of columns ``d``."""

    def __init__(self, d: Dictionary) -> None:
        self.d, self._made = d, cache(partial(Simulator, d))

    def of(self, blocks: Iterable[int] = ()) -> Simulator:
        """The simulator with some causes."""
        return self._made(tuple(sorted(blocks)))


def added(d: Dictionary, x: np.ndarray, block: int) -> float:
    """Gap that a cause with amplitudes x (P,) adds at the joint where it is largest, after the
    columns that every fit leaves free are fitted to it there.

    Columns shared by all joints are known from the other joints, so they take up no part of a
    cause in one drive.
    """
    own, gap = d.joint[d.at[block]], 0.0
    free = d.free & (d.joint >= 0) if (own >= 0).all() else d.free
    for j in own[:1].tolist() if (own >= 0).all() else range(d.y.shape[1]):
        at, gram = d.by_joint(j)
        here = np.isin(at, d.at[block])
        beside = free[at] & ~here
        amplitudes = x[at[here]]
        square = float(amplitudes @ gram[np.ix_(here, here)] @ amplitudes)
        across, taking = gram[np.ix_(beside, here)] @ amplitudes, gram[np.ix_(beside, beside)]
        ridge = np.diag(np.maximum(np.diagonal(taking), 1e-300) * _RIDGE)
        gap = max(gap, square - float(across @ np.linalg.solve(taking + ridge, across)))
    return gap
