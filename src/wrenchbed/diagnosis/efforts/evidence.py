"""Evidence of structures: the Gaussian model of `evidence.likelihood`, every effect a little there.

A structure gives the columns of its causes wide priors; all others keep their small ones.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from wrenchbed.diagnosis.efforts.dictionary import Dictionary
from wrenchbed.diagnosis.evidence.likelihood import Products, gains
from wrenchbed.diagnosis.evidence.search import MORE, NONE, PRIOR, UNKNOWN

AMPLITUDE = 6.0
"""Rms that a named cause adds a priori, in noises of a row: twice what just counts; estimate."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """The Gaussian model of weighted blocks of time.

    Attributes:
        d: the columns.
        weight: of each block (B,).
        temper: factor on the variance of noise.
    """

    d: Dictionary
    weight: np.ndarray
    temper: float = 1.0

    @cached_property
    def level(self) -> Products:
        """The background: no cause is free."""
        gram = np.tensordot(self.weight, self.d.products[0], axes=1) / self.temper
        return Products(gram, self.d.std**2)

    @cached_property
    def right(self) -> np.ndarray:
        """Weighted products (P, 1) of columns and torque residual."""
        return np.asarray(self.weight @ self.d.products[1] / self.temper)[:, None]

    @cached_property
    def known(self) -> tuple[np.ndarray, np.ndarray]:
        """P (P, P) and w (P,) of all columns over the background alone."""
        every = np.arange(len(self.d.std))[None]
        score = self.right - self.level.gram @ self.level.held(self.right)
        return self.level.information(every)[0], score[:, 0]

    def freed(self, blocks: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
        """Indices of the columns (K,) that some causes set free, and the standard deviations (K,)
        that these add to theirs."""
        at = np.unique(np.concatenate([np.zeros(0, int), *(self.d.at[b] for b in blocks)]))
        wide = AMPLITUDE / np.maximum(self.d.size[at], 1e-12)
        return at, np.sqrt(np.maximum(wide**2 - self.level.V[at], 0.0))

    def all_freed(self, structures: Sequence[Sequence[int]]) -> tuple[np.ndarray, np.ndarray]:
        """`freed` of structures (indices of blocks), filled up with zeros (S, K)."""
        each = [self.freed(blocks) for blocks in structures]
        shape = len(each), max(len(at) for at, _ in each)
        columns, more = np.zeros(shape, dtype=int), np.zeros(shape)
        for k, (at, std) in enumerate(each):
            columns[k, : len(at)], more[k, : len(at)] = at, std
        return columns, more

    def logs(self, columns: np.ndarray, more: np.ndarray) -> np.ndarray:
        """Log evidence of structures (S,), of which `all_freed` is known, over that of the
        background alone."""
        information, score = self.known
        p = information[columns[:, :, None], columns[:, None, :]]
        return gains(p, score[columns][:, :, None], more, np.ones(1))[:, 0, 0]

    @cached_property
    def _each(self) -> np.ndarray:
        """Log prior of each block (B,): alike for each cause, whatever its number of variants."""
        every = self.d.blocks
        counts = Counter({b.key: b.outside for b in every}.values())
        of = {k: np.log(PRIOR[UNKNOWN if k else "one"] / n) for k, n in counts.items()}
        return np.array([of[b.outside] + b.prior for b in every])

    def prior(self, blocks: Sequence[int]) -> float:
        """Log prior of a structure."""
        none = np.log(PRIOR[NONE]) if not blocks else (len(blocks) - 1) * np.log(MORE)
        return float(none + self._each[list(blocks)].sum())

    def amplitudes(self, blocks: Sequence[int]) -> np.ndarray:
        """Posterior mean (P,) of all amplitudes under a structure."""
        (information, score), (at, more) = self.known, self.freed(blocks)
        inner = np.eye(len(at)) + information[np.ix_(at, at)] * more**2
        more_of = np.zeros((len(score), 1))
        more_of[at, 0] = more**2 * np.linalg.solve(inner, score[at])
        return (more_of + self.level.held(self.right - self.level.gram @ more_of))[:, 0]
