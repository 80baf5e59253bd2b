"""Input (`Facts`) and result (`Decision`) of a decision; facts of ranked sets of causes."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Generic

import numpy as np
from scipy.special import logsumexp

from wrenchbed.diagnosis.evidence.search import NONE
from wrenchbed.diagnosis.explain.claims import Explanation, complete
from wrenchbed.diagnosis.explain.contributions import CLAIMABLE
from wrenchbed.diagnosis.explain.elements import DOUBT
from wrenchbed.diagnosis.explain.structures import Ranking
from wrenchbed.diagnosis.explain.verdict import Option, S, Verdict
from wrenchbed.diagnosis.gap.gap_bootstrap import Closure


@dataclass(frozen=True, eq=False)
class Decision(Generic[S]):
    """A verdict, with the gaps on rows that no fit used.

    Attributes:
        verdict: word, causes with rivals, and probabilities.
        gap: gaps on held-out rows, with the causes of ``verdict``.
    """

    verdict: Verdict[S]
    gap: Closure

    @property
    def settled(self) -> bool:
        """Whether the verdict says that no cause is missing: none, identified or ambiguous."""
        return self.verdict.word in (NONE, "identified", "ambiguous")


@dataclass(frozen=True, eq=False)
class Facts(Generic[S]):
    """Everything that a decision depends on.

    Attributes:
        options: sets of causes, active at once, that may explain the recording; best first.
        unknown: probability of a cause that is no effect of the library.
        measure: function from a verdict to the gaps that its causes leave on rows that no fit used.
        right: function to the share of such verdicts that were right.
        doubt: factor by which log odds are overstated, since residuals are not white noise.
        least: smallest probability of a cause: above 0 where few rows are left to separate causes.
        ordinary_fitted: whether the calibrated simulator fits all stated values within the spread
            that healthy robots have, so that it may imitate causes.
        own_rest: whether the unexplained residual counts as noise; no cause is then ``unknown``.
        seen: names of effects that values of single readings show, such as a channel's limit.
    """

    options: Sequence[Option[S]]
    unknown: float
    measure: Callable[[Verdict[S]], Closure]
    right: Callable[[Verdict[S], Closure], float]
    doubt: float = DOUBT
    least: float = 0.0
    ordinary_fitted: bool = False
    own_rest: bool = False
    seen: Collection[str] = ()


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
) -> Facts[Explanation]:
    """Facts for a decision on ranked sets of causes; arguments as the attributes of `Facts`."""
    weight = weights(ranking)
    both = zip(weight[1:], ranking.explanations, strict=True)
    options = tuple(Option(e, float(w), e.parts) for w, e in both)
    return Facts(options, float(weight[0]), measure, right)
