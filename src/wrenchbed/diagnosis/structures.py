"""Which effects, alone or up to three together, explain a case: finalists, ranked."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from wrenchbed.diagnosis.broad import beside
from wrenchbed.diagnosis.claims import Explanation, explained
from wrenchbed.diagnosis.crossvote import score
from wrenchbed.diagnosis.dictionary import STATED
from wrenchbed.diagnosis.finalist import Finalist
from wrenchbed.diagnosis.parts import CLAIMABLE, share
from wrenchbed.diagnosis.refit import Refitter
from wrenchbed.diagnosis.search import PRIOR, UNKNOWN, Searcher, Single
from wrenchbed.diagnosis.swaps import swapped
from wrenchbed.diagnosis.twins import doubled

SINGLES, EXTENDED, LONGER = 6, 4, 5
"""How many single effects are refitted, how many of these extended, and with how many more."""
AT_ONCE = 3
"""Most effects named together."""
MINOR = 1
"""Effects beside them that are too small to be named, but that evidence asks for."""
SHAPED = 0.5
"""Share of its linear gain by which an effect may be behind another before its shape is fitted."""
VOTERS = 6
"""Explanations that are cross-validated."""
NEGLIGIBLE = 30.0
"""Explanations so much less likely than the best (natural logarithm) are dropped."""


@dataclass(frozen=True, eq=False)
class Ranking:
    """Every explanation of a case with its log posterior.

    Attributes:
        explanations: refitted structures, best first; one of them has no effect at all.
        unknown: log posterior of something that no effect of the library makes, alone.
        mixed: of the best finalist with something unknown beside it.
        kernel: the variable on which the unknown depends, of the best such explanation.
        gap: of the calibrated simulator, beyond the noise.
        votes: how well the first explanations foretell left-out blocks, see `crossvote`.
    """

    explanations: tuple[Explanation, ...]
    unknown: float
    mixed: float
    kernel: str
    gap: float
    votes: tuple[float, ...] = ()


def rank(searcher: Searcher, refitter: Refitter) -> Ranking:
    """Refit the best single effects, then pairs, then triples, as long as they gain."""
    singles = searcher.singles(refitter.y)
    nulls = searcher.nulls(refitter.y)
    normal = np.array([r.normal for r in searcher.rungs])
    kernels = [s for s in singles if s.index < 0]
    unknown = float(
        logsumexp([*(s.log_posterior for s in kernels), *(nulls[~normal] + np.log(PRIOR[UNKNOWN]))])
    )
    kernel = _kernel(searcher, kernels)
    chosen = _distinct(searcher, singles, SINGLES, float(nulls.max()))
    found = [
        refitter.fit((searcher.hypotheses[s.index],), s.rung)
        for s in (*chosen, *_other_clocks(searcher, singles, chosen))
    ]
    found += _beside_broad(refitter, found, singles)
    mixed, kernel_beside = -np.inf, kernel
    beam = sorted(found, key=_posterior)[:EXTENDED]
    for _ in range(AT_ONCE + MINOR - 1):
        longer: list[Finalist] = []
        drafts: list[tuple[float, Finalist, Single]] = []
        for f in beam:
            more = refitter.added(f)
            beside = [s for s in more if s.index < 0]
            total = float(logsumexp([s.log_posterior for s in beside]))
            if total > mixed:
                mixed, kernel_beside = total, _kernel(searcher, beside)
            drafts += [
                (s.log_posterior, f, s) for s in _distinct(searcher, more, LONGER, f.log_posterior)
            ]
        seen: set[frozenset[str]] = {frozenset(f.names) for f in found}
        for value, f, s in sorted(drafts, key=lambda d: -d[0]):
            h = searcher.hypotheses[s.index]
            names = frozenset((*f.names, h.name))
            most = max(x.log_posterior for x in found)
            if names in seen or value < most - 3.0 or len(longer) == LONGER:
                continue
            seen.add(names)
            pair = refitter.extended(f, h)
            if pair.log_posterior <= f.log_posterior or doubled(refitter, pair):
                continue
            if len(_claimed(refitter, pair)) <= AT_ONCE:
                longer.append(pair)
        if not longer:
            break
        found += longer
        beam = sorted(longer, key=_posterior)[:2]
    best = min(found, key=_posterior)
    found += swapped(refitter, best, _claimed(refitter, best), singles)
    found = [refitter.nothing(), *found]
    found.sort(key=_posterior)
    if mixed > max(unknown, found[0].log_posterior):
        kernel = kernel_beside
    least = found[0].log_posterior - NEGLIGIBLE
    told = [explained(refitter, f) for f in found if f.log_posterior > least]
    gap = searcher.d.gap(refitter.y) - float(searcher.d.prepared.variance.mean())
    votes = tuple(score(refitter, e.finalist) for e in told[:VOTERS])
    return Ranking(tuple(told), unknown, mixed, kernel, gap, votes)


def _beside_broad(
    refitter: Refitter, found: Sequence[Finalist], singles: Sequence[Single]
) -> list[Finalist]:
    """Special effects beside the best explanation where it is broad; then one more."""
    best = min(found, key=_posterior)
    pairs = beside(refitter, best, singles)
    if not pairs:
        return []
    return pairs + beside(refitter, min(pairs, key=_posterior), singles)


def _other_clocks(
    searcher: Searcher, singles: Sequence[Single], chosen: Sequence[Single]
) -> list[Single]:
    """All that makes readings late or smears them, where one such effect is chosen.

    Their slopes are alike, and true only while the delay is short beside what moves.
    """

    def late(s: Single) -> bool:
        return s.index >= 0 and searcher.hypotheses[s.index].effect.stage == "timing"

    taken = {s.index for s in chosen}
    if not any(map(late, chosen)):
        return []
    best: dict[int, Single] = {}
    for s in sorted(filter(late, singles), key=lambda s: -s.log_posterior):
        if s.index not in taken:
            best.setdefault(s.index, s)
    return list(best.values())


def _posterior(f: Finalist) -> float:
    return -f.log_posterior


def _claimed(refitter: Refitter, f: Finalist) -> list[int]:
    named = [k for k, h in enumerate(f.parts) if h.name not in STATED]
    return [k for k in named if share(refitter, f, k) >= CLAIMABLE]


def _kernel(searcher: Searcher, kernels: Sequence[Single]) -> str:
    best = max(kernels, key=lambda s: s.log_posterior)
    return searcher.kernels[-1 - best.index]


def _distinct(
    searcher: Searcher, singles: Sequence[Single], count: int, base: float
) -> list[Single]:
    """The best of each effect, with a second variant where it is nearly as good."""
    kept: list[Single] = []
    best: dict[str, list[Single]] = {}
    for s in sorted(singles, key=lambda s: -s.log_posterior):
        if s.index < 0:
            continue
        own = best.setdefault(searcher.hypotheses[s.index].name, [])
        repeated = any(s.index == o.index for o in own)
        if repeated or len(own) == 2 or (own and s.log_posterior < own[0].log_posterior - 2.0):
            continue
        own.append(s)
        kept.append(s)
        if len(best) > count:
            break
    top = kept[0].log_posterior
    far = 60.0 + SHAPED * max(top - base, 0.0)
    return [s for s in kept if s.log_posterior > top - far]
