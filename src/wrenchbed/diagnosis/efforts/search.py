"""Search over structures: which causes together explain a recording, and how probable each is.

Forward search with a beam; probabilities are means over resampled blocks of time (BayesBag: Huggins
& Miller 2023, doi 10.1214/21-BA1301), tempered, so that a law that is not quite right makes an
answer less sure.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.special import softmax

from wrenchbed.diagnosis.efforts.dictionary import BLOCKS, Dictionary
from wrenchbed.diagnosis.efforts.evidence import Evidence

MOST_CAUSES = 5
"""Causes of a structure, those among them that are too small to count; estimate."""
_BEAM = 8
"""Structures that each step of the beam search continues; estimate."""
_LIKELY = 60
"""Causes that are tried beside each structure but the best; estimate."""
_HOPELESS = 10.0
"""Log posterior below the best at which longer structures end the search; estimate."""
_KEPT = 150
"""Structures that the final comparison keeps; estimate."""
_DRAWS = 16
"""Resamples of blocks of time in the comparison of structures; estimate."""
TEMPER = 4.0
"""Factor on the variance of noise: rows are worth fewer than their number; estimate."""

Structure = tuple[int, ...]
"""Sorted indices of the dictionary's blocks that act together."""


@dataclass(frozen=True, eq=False)
class Search:
    """Structures of causes that were searched.

    Attributes:
        d: the columns.
        evidence: of all rows, noise widened by the misfit of the best structure.
        structures: best first.
        probability: of each (S,), resampled and tempered.
    """

    d: Dictionary
    evidence: Evidence
    structures: tuple[Structure, ...]
    probability: np.ndarray


def search(d: Dictionary, seed: int = 0) -> Search:
    """Structures of up to `MOST_CAUSES` causes."""
    every = np.ones(BLOCKS)
    best = _Found(Evidence(d, every, TEMPER)).best[0]
    rows = sum(float(n.weight.sum()) for n in d.noise)
    evidence = Evidence(d, every)
    misfit = TEMPER * max(1.0, evidence.left_square(evidence.amplitudes(best)) / rows)
    found = _Found(Evidence(d, every, misfit))
    structures, rng = found.best, np.random.default_rng([seed, 7])
    prior, chance = np.array([evidence.prior(s) for s in structures]), np.zeros(len(structures))
    for _ in range(_DRAWS):
        weight = np.bincount(rng.integers(BLOCKS, size=BLOCKS), minlength=BLOCKS).astype(float)
        drawn = Evidence(d, weight, misfit)
        chance += softmax([drawn.log(s) for s in structures] + prior) / _DRAWS
    order = np.argsort(-chance, kind="stable")
    return Search(d, found.evidence, tuple(structures[k] for k in order), chance[order])


@dataclass(frozen=True, eq=False)
class _Found:
    """Structures with their log posterior, which a beam search found."""

    evidence: Evidence
    score: dict[Structure, float] = field(default_factory=dict)

    @cached_property
    def best(self) -> list[Structure]:
        """The best structures first, that of nothing among them."""
        score, every = self.score, range(len(self.evidence.d.blocks))
        beam: list[Structure] = [()]
        score[()] = self.evidence.prior(())
        for size in range(1, MOST_CAUSES + 1):
            gains = {k: self._extended(beam[0], k) for k in every}
            likely = sorted(every, key=lambda k: -gains[k])[:_LIKELY]
            for s in beam[1:]:
                for k in likely:
                    self._extended(s, k)
            beam = sorted((s for s in score if len(s) == size), key=lambda s: -score[s])[:_BEAM]
            if score[beam[0]] < max(score.values()) - _HOPELESS:
                break
        result = sorted(score, key=lambda s: -score[s])[:_KEPT]
        return result if () in result else [*result, ()]

    def _extended(self, s: Structure, block: int) -> float:
        """Log posterior of a structure with one more cause; −∞ where it has that cause already."""
        blocks = self.evidence.d.blocks
        if blocks[block].slot in {blocks[k].slot for k in s}:
            return -np.inf
        grown = tuple(sorted((*s, block)))
        if grown not in self.score:
            log = self.evidence.log(grown) + self.evidence.prior(grown)
            self.score[grown] = log if self._resisting(grown) else -np.inf
        return self.score[grown]

    def _resisting(self, s: Structure) -> bool:
        """Whether effects of a structure that can only resist motion do resist it."""
        d, signed = self.evidence.d, [b for k in s if (b := self.evidence.d.blocks[k]).resists]
        amplitudes = self.evidence.amplitudes(s) if signed else np.zeros(0)
        return all(amplitudes[np.isin(d.names, b.resists)].sum() >= 0.0 for b in signed)
