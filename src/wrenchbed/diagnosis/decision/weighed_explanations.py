"""Explanations of a recording as the options of a decision, each with its probability."""

from collections.abc import Callable, Collection

import numpy as np
from scipy.special import logsumexp

from wrenchbed.diagnosis.decision.facts import Facts
from wrenchbed.diagnosis.explain.claims import Explanation, complete
from wrenchbed.diagnosis.explain.contributions import CLAIMABLE
from wrenchbed.diagnosis.explain.structures import Ranking
from wrenchbed.diagnosis.explain.verdict import Option, Verdict
from wrenchbed.diagnosis.gap.gap_bootstrap import Closure


def weights(ranking: Ranking) -> np.ndarray:
    """Probabilities (1 + E,): of a cause that the library lacks, then of each of E explanations."""
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
    seen: Collection[str] = (),
) -> Facts[Explanation]:
    """Facts for a decision on ranked sets of causes; arguments as the attributes of `Facts`."""
    weight = weights(ranking)
    both = zip(weight[1:], ranking.explanations, strict=True)
    options = tuple(Option(e, float(w), e.parts) for w, e in both)
    return Facts(
        options, float(weight[0]), measure, right, least=least, own_rest=own_rest, seen=seen
    )
