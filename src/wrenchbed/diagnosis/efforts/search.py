"""Evidence of structures of causes, and the search for those that explain a recording.

The Gaussian model is that of `evidence.likelihood`: the columns of a structure's causes have wide
priors, all others keep their small ones, so that every effect is a little present. Forward search
with a beam. Evidence is tempered, so that a law that is not quite right makes an answer less sure.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import softmax

from wrenchbed.diagnosis.efforts.dictionary import BLOCKS, Dictionary
from wrenchbed.diagnosis.efforts.names import all_effects
from wrenchbed.diagnosis.evidence.likelihood import Products, gains
from wrenchbed.diagnosis.evidence.search import MORE, NONE, PRIOR, UNKNOWN

AMPLITUDE = 6.0
"""Rms that a named cause adds a priori, in noises of a row: twice what just counts."""
MOST_CAUSES = 5
"""Causes of a structure, those among them that are too small to count: two faults, and three small
effects beside them."""
_BEAM = 8
"""Structures that each step of the beam search continues: time grows with it."""
_LIKELY = 60
"""Structures of as many causes that are kept: ten a joint of a six-axis arm."""
_HOPELESS = 10.0
"""Log posterior below the best at which longer structures end the search: one in 22,000."""
TEMPER = 4.0
"""Factor on the variance of noise: rows with memory are worth fewer than their number, a quarter of
it."""
Structure = tuple[int, ...]
"""Sorted indices of the dictionary's blocks that act together."""


def wide(d: Dictionary) -> np.ndarray:
    """Standard deviation (P,) of each column's amplitude in a fit whose cause uses it."""
    return np.asarray(AMPLITUDE / np.maximum(d.size, 1e-12))


@dataclass(frozen=True, eq=False)
class Evidence:
    """Log evidence of sets of causes, Gaussian, from all rows of the columns ``d``."""

    d: Dictionary

    @cached_property
    def level(self) -> Products:
        """Gaussian model without any cause: columns that every fit takes, and noise."""
        return Products(self._products[0], self.d.std**2)

    @cached_property
    def _products(self) -> tuple[np.ndarray, np.ndarray]:
        gram, right = self.d.weighed(np.ones(BLOCKS))
        return gram / TEMPER, right / TEMPER

    @cached_property
    def known(self) -> tuple[np.ndarray, np.ndarray]:
        """Information (P, P) and score (P,) of P columns, beside what every fit takes."""
        (gram, right), every = self._products, np.arange(len(self.d.std))[None]
        score = right - gram @ self.level.held(right)
        return self.level.information(every)[0], score[:, 0]

    def information(self, columns: np.ndarray) -> np.ndarray:
        """Information matrices (b, k, k) of b sets of k columns, by the columns' indices."""
        return np.asarray(self.known[0][columns[:, :, None], columns[:, None, :]])

    @cached_property
    def _added_std(self) -> np.ndarray:
        """Standard deviation (P,) that a cause adds in quadrature to that of its columns."""
        return np.sqrt(np.maximum(wide(self.d) ** 2 - self.level.V, 0.0))

    def _freed(self, blocks: Structure) -> np.ndarray:
        """Indices of the columns (K,) that these causes use."""
        return np.unique(np.concatenate([np.zeros(0, int), *(self.d.at[b] for b in blocks)]))

    def logs(self, structures: Sequence[Structure]) -> np.ndarray:
        """Log evidence (S,) of S sets of causes, less that of the model without any cause."""
        each = [self._freed(blocks) for blocks in structures]
        shape = len(each), max(len(at) for at in each)
        columns, more = np.zeros(shape, dtype=int), np.zeros(shape)
        for k, at in enumerate(each):
            columns[k, : len(at)], more[k, : len(at)] = at, self._added_std[at]
        score = self.known[1]
        p = self.information(columns)
        return gains(p, score[columns][:, :, None], more, np.ones(1))[:, 0, 0]

    @cached_property
    def _block_prior(self) -> np.ndarray:
        """Log prior of each candidate cause (B,): the same for all, divided among variants."""
        every = self.d.blocks
        counts = Counter({b.key: b.outside for b in every}.values())
        of = {k: np.log(PRIOR[UNKNOWN if k else "one"] / n) for k, n in counts.items()}
        return np.array([of[b.outside] + b.prior for b in every])

    def prior(self, blocks: Structure) -> float:
        """Log prior of a set of causes, given by their indices."""
        none = np.log(PRIOR[NONE]) if not blocks else (len(blocks) - 1) * np.log(MORE)
        return float(none + self._block_prior[list(blocks)].sum())

    def possible(self, blocks: Structure) -> bool:
        """Whether all causes of a set whose size cannot be negative come out so in its fit."""
        every = self.d.blocks
        signed = [
            k for k in blocks if not every[k].outside and all_effects()[every[k].effect].one_way
        ]
        if not signed:
            return True
        (information, score), at = self.known, self._freed(blocks)
        x, more = np.zeros(len(score)), self._added_std[at] ** 2
        x[at] = more * np.linalg.solve(
            np.eye(len(at)) + information[np.ix_(at, at)] * more, score[at]
        )
        x += self.level.held(self._products[1] - self.level.gram @ x[:, None])[:, 0]
        return all(x[self.d.sized(k)].sum() >= 0.0 for k in signed)


def search(evidence: Evidence) -> dict[Structure, float]:
    """Probabilities of sets of up to `MOST_CAUSES` causes, the empty set included, best first."""
    slots = [b.slot for b in evidence.d.blocks]
    score: dict[Structure, float] = {(): evidence.prior(())}
    beam: list[Structure] = [()]
    for _ in range(MOST_CAUSES):
        taken = [{slots[k] for k in s} for s in beam]  # of causes that exclude others
        pairs = ((i, k) for i in range(len(beam)) for k in range(len(slots)))
        free = (tuple(sorted((*beam[i], k))) for i, k in pairs if slots[k] not in taken[i])
        grown = list(dict.fromkeys(free))
        logs = evidence.logs(grown) + [evidence.prior(s) for s in grown]
        likely = [(grown[i], float(logs[i])) for i in np.argsort(-logs)[:_LIKELY]]
        possible = {s: log for s, log in likely if evidence.possible(s)}
        score |= possible
        beam = list(possible)[:_BEAM]
        if not beam or score[beam[0]] < max(score.values()) - _HOPELESS:
            break
    best = sorted(score, key=lambda s: -score[s])
    return dict(zip(best, softmax([score[s] for s in best]).tolist(), strict=True))
