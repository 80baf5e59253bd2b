"""Explanations of a recording as the options of a decision, each with its probability."""

from collections.abc import Callable

import numpy as np
from scipy.special import logsumexp

from wrenchbed.diagnosis.decision.decide import Facts
from wrenchbed.diagnosis.explain.claims import Explanation, complete
from wrenchbed.diagnosis.explain.contributions import CLAIMABLE
from wrenchbed.diagnosis.explain.elements import DOUBT, RIVAL
from wrenchbed.diagnosis.explain.structures import MARGIN, Ranking
from wrenchbed.diagnosis.explain.verdict import Option, Verdict
from wrenchbed.diagnosis.gap.gaps import Closure


def weights(ranking: Ranking) -> np.ndarray:
    """Probability of something unknown, then of each explanation (1 + E,)."""
    best, unknown = ranking.explanations[0], ranking.unknown
    if ranking.gap < CLAIMABLE:  # normal imperfections, whatever they look like
        unknown = -np.inf
    elif not complete(best):
        unknown = float(np.logaddexp(unknown, max(ranking.mixed, best.log_posterior + 3.0)))
    logs = np.array([unknown, *(e.log_posterior for e in ranking.explanations)])
    return np.asarray(np.exp(logs - logsumexp(logs)))


def facts_of(
    ranking: Ranking,
    measure: Callable[[Verdict[Explanation]], Closure],
    right: Callable[[Verdict[Explanation], Closure], float],
    *,
    least: float = 0.0,
    own_rest: bool = False,
) -> Facts[Explanation]:
    """What a decision on a ranking rests on; see `Facts`.

    Beside a rest of the recording's own, what predicts left-out blocks no worse than the claim is a
    rival: the rest is no white noise, so that evidence alone tells them apart too surely.
    """
    weight = weights(ranking)
    votes = (*ranking.votes, *(None for _ in ranking.explanations[len(ranking.votes) :]))
    options = tuple(
        Option(e, float(w), e.parts, vote)
        for w, e, vote in zip(weight[1:], ranking.explanations, votes, strict=True)
    )
    ahead = -MARGIN if own_rest else MARGIN
    return Facts(options, float(weight[0]), measure, right, DOUBT, RIVAL, ahead, least, own_rest)
