"""Rivals of the leading cause on held-out rows: a paired comparison, row by row.

Evidence takes the residual for white noise. That of a real robot is not white, and an effect of
many numbers takes up some of it. So each candidate is fitted in the leading cause's place, all are
judged on held-out rows, and one that closes as much there, within the interval of the difference,
is a rival. Channels are weighted by the noise of the analysis, unexplained residual included.
"""

from collections.abc import Callable, Iterable, Sequence
from functools import partial

import numpy as np

from wrenchbed.diagnosis.decision.decide import DOUBTFUL, MOST_RIVALS
from wrenchbed.diagnosis.evidence.search import SingleEvidence, best_variants
from wrenchbed.diagnosis.explain.claims import Explanation
from wrenchbed.diagnosis.explain.finalist import Finalist
from wrenchbed.diagnosis.explain.structures import Analysis
from wrenchbed.diagnosis.explain.verdict import Key, Verdict
from wrenchbed.diagnosis.gap.gap_bootstrap import Bootstrap, Interval
from wrenchbed.diagnosis.gap.held_out import Claimed, CrossFit, HeldOut
from wrenchbed.diagnosis.prepare.configured_simulator import STATED

TRIED = 5
"""Number of rivals that are fitted, the likeliest first."""
ALIKE = 0.8
"""Share of the leading cause's closed gap that a rival closes at least: the fifth that it lacks may
be residual that no effect explains."""
APART = 0.5
"""Share of its closed gap that the leading cause still closes beside a candidate, from which the
two are separate causes and no rivals: the larger half is its own."""

Tried = tuple[Key, np.ndarray, Callable[[], np.ndarray]]
"""Candidate for the leading cause's place: effect and joint, gap of each observation (S,) with it
alone, and a function that returns the gap (S,) with both."""


def as_good(a: Analysis, verdict: Verdict[Explanation], seed: int) -> tuple[Key, ...]:
    """Effects that do as well in the leading cause's place on held-out rows, best first.

    Empty if that is a wrong stated number. ``seed``: of the bootstrap over held-out blocks.
    """
    if not verdict.causes or (leading := verdict.causes[0].part.index) is None:
        return ()
    f = verdict.explanation.finalist
    lead, *others = verdict.causes
    claimed = {n for c in others for n in c.names}
    beside = [c.part.index for c in others if c.part.index is not None and c.probability > DOUBTFUL]
    wrong = [c.names[0] for c in others if c.part.index is None]
    base = a.refitter.keeping(f, beside)
    judge = _Judge(a, wrong, seed)
    without = judge.gaps(base)
    with_lead = judge.gaps(a.refitter.keeping(f, [leading, *beside]))

    def tried(s: SingleEvidence) -> Tried:
        h = a.searcher.hypotheses[s.index]
        rival = a.refitter.extended(base, h, s.rung)
        both = partial(a.refitter.extended, rival, f.parts[leading])
        return (h.name, None), judge.gaps(rival), lambda: judge.gaps(both())

    singles = a.refitter.added(base) if base.parts else a.searcher.singles(a.refitter.y)
    taken = {*claimed, lead.names[0], *STATED}
    best = best_variants(a.searcher.hypotheses, singles).items()
    each = map(tried, [s for name, s in best if name not in taken][:TRIED])
    spare = (1.0 - ALIKE) * judge.mean(without - with_lead).value
    alike = not_apart(judge.mean, without, with_lead, spare, each)
    more = [key for key in alike if key[0] not in lead.names]
    return tuple(more[: 1 + MOST_RIVALS - len(lead.names)])


def not_apart(
    mean: Callable[[np.ndarray], Interval], without: np.ndarray, leading: np.ndarray, spare: float,
    each: Iterable[Tried],
) -> tuple[Key, ...]:  # fmt: skip
    """Keys of the candidates that do as well as the leading cause on held-out rows, best first.

    ``mean`` returns the mean of gaps (S,) with its interval. Gaps of each observation (S,) are
    ``leading`` with the leading cause and ``without`` it and candidates; a rival may leave
    ``spare`` beyond what the leading cause leaves.
    """
    closes, worse = mean(without - leading).value, dict[Key, float]()
    for key, gaps, both in each:
        behind = mean(gaps - leading)
        if mean(without - gaps).low <= 0.0 or (behind.low > 0.0 and behind.value > spare):
            continue
        if mean(gaps - both()).value < APART * closes:
            worse[key] = min(behind.value, worse.get(key, np.inf))
    return tuple(sorted(worse, key=lambda key: worse[key]))


class _Judge:
    """Computes the gaps that fitted sets of causes leave on rows that no fit used."""

    def __init__(self, a: Analysis, wrong: Sequence[str], seed: int) -> None:
        self._a, self._wrong = a, wrong
        p = a.prepared
        self._fits = CrossFit(a, {k: a.refitter.without(k) for k in p.folds})
        self._scale = p.sigma * np.sqrt(a.dictionary.prepared.noise)
        rows = HeldOut(p)
        self.mean = Bootstrap([(rows.block, rows.count)], seed).mean

    def gaps(self, f: Finalist) -> np.ndarray:
        """Gap (S,) at each of S observations that no fit used, with the causes of a fitted set."""
        claim = Claimed(f, tuple(range(len(f.parts))), tuple(self._wrong))
        reading = self._fits.explained(claim)[0]
        p = self._a.prepared
        away = (p.y - reading[p.scene.held])[p.judged] / self._scale
        return np.asarray((away**2).mean(axis=1))
