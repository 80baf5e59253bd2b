"""Evidence of sets of causes ("structures"), and the search for those that explain a recording.

The Gaussian model is that of `evidence.likelihood`: the columns of a structure's causes have wide
priors, all others keep their small ones, so that every effect is a little present; how small, the
recording itself tells. Forward search with a beam. Evidence is tempered, so that a law that is not
quite right makes an answer less sure.
"""

from collections import Counter
from itertools import product

import numpy as np
from scipy.special import softmax

from wrenchbed.diagnosis.efforts.columns import BACKGROUND, drive_effects
from wrenchbed.diagnosis.efforts.dictionary import Dictionary
from wrenchbed.diagnosis.efforts.errors_of_fit import ERROR
from wrenchbed.diagnosis.evidence.likelihood import Products, log_sum
from wrenchbed.diagnosis.evidence.search import MORE, NONE, PRIOR, UNKNOWN, Candidates, batches

AMPLITUDE = 6.0
"""Prior rms that a named cause adds to the readings, over a row's noise std: an estimate."""
SCALES = np.array([1.0, 10.0])
"""Factors on it: a second payload makes gaps of thousands."""
MOST_CAUSES = 5
"""Most causes of a set: two faults, and three effects beside them that are too small to claim."""
_BEAM = 8
"""Width of the beam: sets of causes that each step of the search continues; time grows with it."""
_LIKELY = 60
"""Sets of causes of one size that are kept: ten a joint of a six-axis arm."""
TEMPER = 4.0
"""Factor on the variance of noise: rows with memory are worth a quarter of their number."""
_LINKS = (0.3, 1.0)
"""Ordinary errors of links, over the largest that are usual: links that were weighed or identified
have a third of the errors of those that are known by drawings."""
_EFFECTS = (0.25, 0.5, 1.0)
"""What effects without a stated number add unclaimed, over `BACKGROUND`: of some fifty in a joint
together a gap of 0.03, 0.1 or 0.5."""
_LAW = 0.01
"""Share of a joint's gap, but for a constant one, that these effects add at least: the law of a
fault differs from that of its effect by a tenth (tuned on sealed cases that were used up)."""
Structure = tuple[int, ...]
"""Set of causes that act together: sorted indices in `Dictionary.blocks`."""


def wide(d: Dictionary, rms: float = AMPLITUDE) -> np.ndarray:
    """Prior variance (P,) of each column's amplitude if its cause is present and adds ``rms``, in
    noise standard deviations of a row."""
    return np.asarray((rms / np.maximum(d.size, 1e-12)) ** 2 + d.std**2)


def ordinary(d: Dictionary) -> list[np.ndarray]:
    """Prior standard deviations (P,) of ordinary errors to choose from."""
    links = np.array([name.startswith(("link.", ERROR)) for name in d.names])
    effects = ~d.stated & ~d.free & (d.joint >= 0)
    most = BACKGROUND**2 * np.bincount(d.joint[effects], minlength=len(d.channels))
    gap = np.array([np.var(c.y[c.use]) / c.std**2 for c in d.channels])
    least = np.minimum(1.0, np.sqrt(_LAW * gap / most))[d.joint]
    return [
        d.std * np.where(links, a, 1.0) * np.where(effects, np.maximum(b, least), 1.0)
        for a, b in product(_LINKS, _EFFECTS)
    ]


class Evidence(Candidates):
    """Log evidence of sets of causes (log probability of the efforts, sizes integrated out), by the
    products of the columns ``d`` over all rows, beside ordinary errors as large as makes the
    efforts likeliest with one cause at most (empirical Bayes)."""

    def __init__(self, d: Dictionary) -> None:
        super().__init__()
        self.d, (gram, right) = d, (x / TEMPER for x in d.without())
        self._more = wide(d) - d.std**2
        named = Counter({b.key: b.outside for b in d.blocks if b.columns}.values())
        each = {k: np.log(PRIOR[UNKNOWN if k else "one"] / n) for k, n in named.items()}
        self.prior = np.array([each.get(b.outside, -np.inf) + b.prior for b in d.blocks])
        """Log prior of each cause (B,): the same for all, divided among variants."""
        shown = ((k, at) for k, at in enumerate(d.at) if len(at))
        self.batches = batches(
            (k, at, np.sqrt(self._more[at]), SCALES, self.prior[k]) for k, at in shown
        )
        self.levels = [Products(gram, std**2) for std in ordinary(d)]
        scored = [level.over_noise(right) for level in self.levels]
        likely = [
            log_sum(np.array([base + np.log(PRIOR[NONE]), *(s.log_posterior for s in alone)]))
            for k, (score, (base,)) in enumerate(scored)
            for alone in [self.added(k, float(base), score[:, 0])]
        ]
        best = int(np.argmax(likely))
        self.levels, self.score = (self.levels[best],), scored[best][0][:, 0]
        self.information = self.levels[0].informations([np.arange(len(gram))[None]])[0][0]
        self._informations.clear()

    def _given(self, blocks: Structure) -> tuple[np.ndarray, np.ndarray]:
        """Score (derivative of the log likelihood) of all columns (P,) beside a set of causes, and
        H (k, P): HᵀH is the information (P, P) that the set's k columns take up."""
        freed = np.concatenate([np.zeros(0, int), *(self.d.at[b] for b in blocks)])
        at = np.unique(freed[self._more[freed] > 0.0])
        side, normal = self.information[:, at], self.information[np.ix_(at, at)]
        normal = normal + np.diag(1.0 / self._more[at])
        score = self.score - side @ np.linalg.solve(normal, self.score[at])
        return score, np.linalg.solve(np.linalg.cholesky(normal), side.T)

    def beside(self, blocks: Structure, log_posterior: float) -> dict[Structure, float]:
        """Log posterior of each set of ``blocks`` (indices of causes) and one more cause, of
        another effect or joint; ``log_posterior``: of ``blocks`` alone."""
        base = log_posterior + (np.log(MORE) if blocks else -np.log(PRIOR[NONE]))
        of = [b.key for b in self.d.blocks]
        taken = {of[k] for k in blocks}
        every = (s for s in self.added(0, base, *self._given(blocks)) if of[s.index] not in taken)
        return {tuple(sorted((*blocks, s.index))): s.log_posterior for s in every}

    def possible(self, blocks: Structure) -> bool:
        """Whether causes, by index, whose size cannot be negative are fitted with a size ≥ 0."""
        d, known, x = self.d, drive_effects(), wide(self.d) * self._given(blocks)[0]
        signed = (k for k in blocks if (e := known.get(d.blocks[k].effect)) and e.one_way)
        return all(x[d.sized(k)].sum() >= 0.0 for k in signed)


def search(evidence: Evidence) -> dict[Structure, float]:
    """Probabilities of sets of up to `MOST_CAUSES` causes, the empty set included, best first."""
    score: dict[Structure, float] = {(): float(np.log(PRIOR[NONE]))}
    beam: list[Structure] = [()]
    for _ in range(MOST_CAUSES):
        grown = dict[Structure, float]()
        for s in reversed(beam):
            grown |= evidence.beside(s, score[s])
        likely = sorted(grown, key=lambda s: -grown[s])[:_LIKELY]
        beam = [s for s in likely if evidence.possible(s)]
        score |= {s: grown[s] for s in beam}
        beam = beam[:_BEAM]
    best = sorted(score, key=lambda s: -score[s])
    return dict(zip(best, softmax([score[s] for s in best]).tolist(), strict=True))
