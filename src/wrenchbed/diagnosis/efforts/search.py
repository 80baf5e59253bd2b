"""Search over structures: which causes together explain a recording, and how probable each is.

Forward search with a beam; probabilities are means over resampled blocks of time (BayesBag: Huggins
& Miller 2023, doi 10.1214/21-BA1301), tempered, so that a law that is not quite right makes an
answer less sure.
"""

from collections.abc import Iterable, Sequence
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
    freed = evidence.all_freed(structures)
    for _ in range(_DRAWS):
        weight = np.bincount(rng.integers(BLOCKS, size=BLOCKS), minlength=BLOCKS).astype(float)
        chance += softmax(Evidence(d, weight, TEMPER).logs(*freed) + prior) / _DRAWS
    order = np.argsort(-chance, kind="stable")
    return Search(d, evidence, tuple(structures[k] for k in order), chance[order])


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
            score[s] = float(log) + evidence.prior(s) if _resisting(evidence, s) else -np.inf

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


def _resisting(evidence: Evidence, s: Structure) -> bool:
    """Whether effects of a structure that can only resist motion do resist it."""
    d, signed = evidence.d, [b for k in s if (b := evidence.d.blocks[k]).resists]
    amplitudes = evidence.amplitudes(s) if signed else np.zeros(0)
    return all(amplitudes[np.isin(d.names, b.resists)].sum() >= 0.0 for b in signed)
