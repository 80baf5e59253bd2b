"""Causes beside a residual that no effect explains, which counts as noise of the recording.

A real robot leaves a gap that no library explains. Against the sensor's noise every explanation is
incomplete then, and the one that takes up most of the residual wins. Here the residual variance of
the best explanation in each channel is added to the noise, fitted numbers counted; then all is
weighed again: empirical Bayes for a noise of unknown size (Gelman et al. 2013, Bayesian Data
Analysis, ch. 5). A residual that a smooth function predicts is no noise: nothing is claimed then.
"""

from dataclasses import replace

import numpy as np

from wrenchbed.diagnosis.evidence.search import Searcher
from wrenchbed.diagnosis.explain.claims import complete
from wrenchbed.diagnosis.explain.contributions import CLAIMABLE
from wrenchbed.diagnosis.explain.finalist import Finalist
from wrenchbed.diagnosis.explain.refit import Refitter
from wrenchbed.diagnosis.explain.structures import MARGIN, Analysis, rank

PASSES = 2
"""Number of passes that estimate the remaining residual: the first explanation ignored it."""
MUCH = 3.0
"""Gap, left by the best causes, too large for errors of their formulas: three times what counts."""
MOST_FREE = 0.7
"""Largest share of all readings that is subtracted for fitted numbers in a variance: beyond it the
estimate would rest on too few readings."""
FREE = 1e-8
"""Prior precision of bias, mass and CoG, which are fitted freely."""


def is_left(a: Analysis) -> bool:
    """Whether the best explanation leaves an abnormal residual that no smooth function explains.

    A large effect may leave more, since its formula is only nearly right, but at most `MUCH`.
    """
    r, best = a.ranking, a.ranking.explanations[0]
    rough = r.mixed < best.log_posterior + MARGIN
    much = not complete(best) or best.rest > MUCH
    return not a.others and r.gap >= CLAIMABLE and rough and much


def weighed_again(a: Analysis) -> Analysis:
    """Repeat an analysis with the unexplained residual as noise."""
    again = a
    for _ in range(PASSES):
        d, best = a.dictionary, again.ranking.explanations[0].finalist
        noise = np.maximum(d.prepared.noise, rest_variance(again, best) * d.prepared.stride)
        noisy = replace(d, prepared=replace(d.prepared, noise=noise))
        searcher = Searcher(noisy)
        refitter = Refitter(searcher, a.refitter.y)
        ranking = rank(searcher, refitter)
        again = replace(a, searcher=searcher, refitter=refitter, ranking=ranking)
    return again


def rest_variance(a: Analysis, f: Finalist) -> np.ndarray:
    """Residual variance of fitted causes in each channel (C,), over that of one row's noise."""
    d = a.dictionary
    rest = d.without_stated(f.residual).reshape(-1, d.channels)
    variance = (rest**2).mean(axis=0)
    root = np.tile(np.sqrt(np.maximum(variance, d.prepared.variance)), len(rest))
    design = np.column_stack([d.E[:, d.always], f.design]) / root[:, None]
    precision = np.concatenate([np.full(len(d.always), FREE), 1.0 / f.spread**2])
    gram = design.T @ design
    free = float(np.trace(np.linalg.solve(gram + np.diag(precision), gram)))
    return np.asarray(variance / (1.0 - min(free / rest.size, MOST_FREE)))
