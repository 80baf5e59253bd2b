"""Evidence of structures of causes, and the search for those that explain a recording.

The Gaussian model is that of `evidence.likelihood`: a structure gives the columns of its causes
wide priors, all others keep their small ones, so that every effect is a little there. Forward
search with a beam; probabilities are means over resampled blocks of time (BayesBag: Huggins &
Miller 2023, doi 10.1214/21-BA1301), tempered, so that a law that is not quite right makes an answer
less sure.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import softmax

from wrenchbed.diagnosis.efforts.dictionary import BLOCKS, Dictionary
from wrenchbed.diagnosis.efforts.names import known
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
"""Causes that are tried beside each structure but the best: ten a joint of a six-axis arm."""
_HOPELESS = 10.0
"""Log posterior below the best at which longer structures end the search: one in 22,000."""
_KEPT = 150
"""Structures that the final comparison keeps: it resamples each, and their probabilities sum to 1
without those beyond."""
_DRAWS = 16
"""Resamples of blocks of time in the comparison of structures: a share is then known to 0.12."""
TEMPER = 4.0
"""Factor on the variance of noise: rows with memory are worth fewer than their number, a quarter of
it."""
Structure = tuple[int, ...]
"""Sorted indices of the dictionary's blocks that act together."""


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

    def all_freed(self, structures: Sequence[Structure]) -> tuple[np.ndarray, np.ndarray]:
        """`freed` of structures, filled up with zeros (S, K)."""
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

    def prior(self, blocks: Structure) -> float:
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

    def possible(self, blocks: Structure) -> bool:
        """Whether effects of a structure whose size is never below zero are not."""
        every = self.d.blocks
        signed = [k for k in blocks if not every[k].outside and known()[every[k].effect].one_way]
        x = self.amplitudes(blocks) if signed else np.zeros(0)
        return all(x[self.d.sized(k)].sum() >= 0.0 for k in signed)


@dataclass(frozen=True, eq=False)
class Search:
    """Structures of causes that were searched.

    Attributes:
        evidence: of all rows.
        structures: best first.
        probability: of each (S,), resampled and tempered.
    """

    evidence: Evidence
    structures: tuple[Structure, ...]
    probability: np.ndarray


def search(d: Dictionary, seed: int = 0) -> Search:
    """Structures of up to `MOST_CAUSES` causes."""
    evidence = Evidence(d, np.ones(BLOCKS), TEMPER)
    structures, rng = _best(evidence), np.random.default_rng([seed, 7])
    prior, chance = np.array([evidence.prior(s) for s in structures]), np.zeros(len(structures))
    freed = evidence.all_freed(structures)
    for _ in range(_DRAWS):
        weight = np.bincount(rng.integers(BLOCKS, size=BLOCKS), minlength=BLOCKS).astype(float)
        chance += softmax(Evidence(d, weight, TEMPER).logs(*freed) + prior) / _DRAWS
    order = np.argsort(-chance, kind="stable")
    return Search(evidence, tuple(structures[k] for k in order), chance[order])


def _best(evidence: Evidence) -> list[Structure]:
    """The best structures first, that of nothing among them, by a beam search."""
    slots = [b.slot for b in evidence.d.blocks]
    score: dict[Structure, float] = {(): evidence.prior(())}

    def extend(structures: Sequence[Structure], blocks: Iterable[int]) -> None:
        """Weigh structures with one more cause each, whose slot is not taken."""
        free = ((s, k) for s in structures for k in blocks if slots[k] not in {slots[i] for i in s})
        grown = dict.fromkeys(tuple(sorted((*s, k))) for s, k in free)
        fresh = [s for s in grown if s not in score]
        logs = evidence.logs(*evidence.all_freed(fresh)) if fresh else ()
        for s, log in zip(fresh, logs, strict=True):
            score[s] = float(log) + evidence.prior(s) if evidence.possible(s) else -np.inf

    beam: list[Structure] = [()]
    for size in range(1, MOST_CAUSES + 1):
        extend(beam[:1], range(len(slots)))
        gains = {k: score.get(tuple(sorted((*beam[0], k))), -np.inf) for k in range(len(slots))}
        extend(beam[1:], sorted(gains, key=lambda k: -gains[k])[:_LIKELY])
        beam = sorted((s for s in score if len(s) == size), key=lambda s: -score[s])[:_BEAM]
        if score[beam[0]] < max(score.values()) - _HOPELESS:
            break
    result = sorted(score, key=lambda s: -score[s])[:_KEPT]
    return result if () in result else [*result, ()]
