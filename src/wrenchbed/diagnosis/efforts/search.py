"""Search over structures: which causes together explain a recording, and how probable each is.

Forward search with a beam; probabilities are means over resampled blocks of time (BayesBag: Huggins
& Miller 2023, doi 10.1214/21-BA1301), tempered, so that a law that is not quite right makes an
answer less sure.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from wrenchbed.diagnosis.efforts.dictionary import Dictionary
from wrenchbed.diagnosis.efforts.evidence import Evidence, left_square, whole

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
_PRIOR_NONE, _PRIOR_ONE, _PRIOR_MORE, _PRIOR_UNKNOWN = 0.35, 0.5, 0.05, 0.15
"""Prior probability of no cause, of one, of each further one relative, of one without a name."""

Structure = tuple[int, ...]
"""Sorted indices of the dictionary's blocks that act together."""


@dataclass(frozen=True, eq=False)
class Search:
    """Structures of causes that were searched, with their evidence.

    Attributes:
        d: the columns.
        evidence: of all rows, noise widened by the misfit of the best structure.
        structures: best first.
        log: posterior of each (S,), not normalised.
        probability: of each (S,), resampled and tempered.
    """

    d: Dictionary
    evidence: Evidence
    structures: tuple[Structure, ...]
    log: np.ndarray
    probability: np.ndarray


def search(d: Dictionary, seed: int = 0) -> Search:
    """Structures of up to `MOST_CAUSES` causes."""
    first, _ = _found(whole(d, TEMPER))
    best = first[0]
    rows = sum(float(n.weight.sum()) for n in d.noise)
    misfit = TEMPER * max(1.0, left_square(d, whole(d).amplitudes(best)) / rows)
    evidence = whole(d, misfit)
    structures, log = _found(evidence)
    rng = np.random.default_rng([seed, 7])
    count, chance = len(d.gram), np.zeros(len(structures))
    for _ in range(_DRAWS):
        weight = np.bincount(rng.integers(count, size=count), minlength=count).astype(float)
        drawn = Evidence(d, weight, misfit)
        logs = np.array([drawn.log(s) for s in structures])
        logs = logs + np.array([_prior(d, s) for s in structures])
        chance += np.exp(logs - logsumexp(logs))
    order = np.argsort(-chance, kind="stable")
    return Search(
        d, evidence, tuple(structures[k] for k in order), log[order], chance[order] / _DRAWS
    )


def _prior(d: Dictionary, structure: Structure) -> float:
    """Log prior of a structure: alike for each cause, whatever the number of its joints."""
    if not structure:
        return float(np.log(_PRIOR_NONE))
    named = {b.key for b in d.blocks if not b.outside}
    unnamed = {b.key for b in d.blocks if b.outside}
    result = float((len(structure) - 1) * np.log(_PRIOR_MORE))
    for k in structure:
        b = d.blocks[k]
        share = _PRIOR_UNKNOWN / len(unnamed) if b.outside else _PRIOR_ONE / len(named)
        result += float(np.log(share)) + b.prior
    return result


def _found(evidence: Evidence) -> tuple[list[Structure], np.ndarray]:
    """Structures, best first, with their log posterior (S,)."""
    d, score = evidence.d, dict[Structure, float]()
    score[()] = _prior(d, ())
    beam: list[Structure] = [()]
    for _ in range(MOST_CAUSES):
        every = range(len(d.blocks))
        gains = {k: _scored(evidence, score, beam[0], k) for k in every}
        likely = sorted(every, key=lambda k: -gains[k])[:_LIKELY]
        for s in beam[1:]:
            for k in likely:
                _scored(evidence, score, s, k)
        size = len(beam[0]) + 1
        grown = (s for s in score if len(s) == size)
        beam = sorted(grown, key=lambda s: -score[s])[:_BEAM]
        if score[beam[0]] < max(score.values()) - _HOPELESS:
            break
    best = sorted(score, key=lambda s: -score[s])[:_KEPT]
    if () not in best:
        best.append(())
    return best, np.array([score[s] for s in best])


def _scored(evidence: Evidence, score: dict[Structure, float], s: Structure, block: int) -> float:
    """Log posterior of a structure with one more cause; −∞ where it has that cause already."""
    d = evidence.d
    if _slot(d, block) in {_slot(d, k) for k in s}:
        return -np.inf
    grown = tuple(sorted((*s, block)))
    if grown not in score:
        log = evidence.log(grown) + _prior(d, grown)
        score[grown] = log if _resisting(evidence, grown) else -np.inf
    return score[grown]


def _resisting(evidence: Evidence, structure: Structure) -> bool:
    """Whether effects of a structure that can only resist motion do resist it."""
    d = evidence.d
    signed = [d.blocks[k] for k in structure if d.blocks[k].resists]
    if not signed:
        return True
    amplitudes = evidence.amplitudes(structure)
    return all(amplitudes[np.isin(d.names, b.resists)].sum() >= 0.0 for b in signed)


def _slot(d: Dictionary, block: int) -> tuple[str, int | None]:
    """Slot of a block: causes with one slot exclude each other, as a joint's delay and filter may
    cancel."""
    effect, joint = d.blocks[block].key
    return ("lag" if effect in ("drive.delay", "drive.bandwidth") else effect), joint
