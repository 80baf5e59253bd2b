"""Search over structures: which causes together explain a recording, and how probable each is.

Forward search with a beam; probabilities are means over resampled blocks of time (BayesBag: Huggins
& Miller 2023, doi 10.1214/21-BA1301), tempered, so that a law that is not quite right makes an
answer less sure.
"""

from dataclasses import dataclass

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
        evidence: of all rows.
        structures: best first.
        probability: of each (S,), resampled and tempered.
    """

    d: Dictionary
    evidence: Evidence
    structures: tuple[Structure, ...]
    probability: np.ndarray


def search(d: Dictionary, seed: int = 0) -> Search:
    """Structures of up to `MOST_CAUSES` causes."""
    evidence = Evidence(d, np.ones(BLOCKS), TEMPER)
    structures, rng = _best(evidence), np.random.default_rng([seed, 7])
    prior, chance = np.array([evidence.prior(s) for s in structures]), np.zeros(len(structures))
    for _ in range(_DRAWS):
        weight = np.bincount(rng.integers(BLOCKS, size=BLOCKS), minlength=BLOCKS).astype(float)
        drawn = Evidence(d, weight, TEMPER)
        chance += softmax([drawn.log(s) for s in structures] + prior) / _DRAWS
    order = np.argsort(-chance, kind="stable")
    return Search(d, evidence, tuple(structures[k] for k in order), chance[order])


def _best(evidence: Evidence) -> list[Structure]:
    """The best structures first, that of nothing among them, by a beam search."""
    every = range(len(evidence.d.blocks))
    score: dict[Structure, float] = {(): evidence.prior(())}

    def extended(s: Structure, block: int) -> float:
        """Log posterior of a structure with one more cause; −∞ where its slot is taken."""
        blocks = evidence.d.blocks
        if blocks[block].slot in {blocks[k].slot for k in s}:
            return -np.inf
        grown = tuple(sorted((*s, block)))
        if grown not in score:
            log = evidence.log(grown) + evidence.prior(grown)
            score[grown] = log if _resisting(evidence, grown) else -np.inf
        return score[grown]

    beam: list[Structure] = [()]
    for size in range(1, MOST_CAUSES + 1):
        likely = sorted(every, key=lambda k: -extended(beam[0], k))[:_LIKELY]
        for s in beam[1:]:
            for k in likely:
                extended(s, k)
        beam = sorted((s for s in score if len(s) == size), key=lambda s: -score[s])[:_BEAM]
        if score[beam[0]] < max(score.values()) - _HOPELESS:
            break
    result = sorted(score, key=lambda s: -score[s])[:_KEPT]
    return result if () in result else [*result, ()]


def _resisting(evidence: Evidence, s: Structure) -> bool:
    """Whether effects of a structure that can only resist motion do resist it."""
    d, signed = evidence.d, [b for k in s if (b := evidence.d.blocks[k]).resists]
    amplitudes = evidence.amplitudes(s) if signed else np.zeros(0)
    return all(amplitudes[np.isin(d.names, b.resists)].sum() >= 0.0 for b in signed)
