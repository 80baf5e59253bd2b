"""Which effects, alone or up to three together, explain a case: finalists, ranked.

Broad hypotheses take the signal of special ones: the special ones get their chance beside them.

A crosstalk of all channels can be a turned sensor and five gains as well, at the price of thirty
numbers. Alone it fits better than any of them as soon as small imperfections matter too; beside
one of them it need only be small, and the evidence of both together tells which is right.

Rivals: what else could stand in the place of each part of the best explanation.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from wrenchbed.diagnosis.evidence.dictionary import STATED, Hypothesis
from wrenchbed.diagnosis.evidence.search import PRIOR, UNKNOWN, Searcher, SingleEvidence
from wrenchbed.diagnosis.explain.claims import Explanation, explained
from wrenchbed.diagnosis.explain.contributions import CLAIMABLE, doubled, score, share
from wrenchbed.diagnosis.explain.finalist import Finalist
from wrenchbed.diagnosis.explain.refit import Refitter

BROAD = 6
"""Columns from which a hypothesis counts as broad."""
SPECIAL = 5
"""How many special ones are tried beside it; a wrong mass is one of them, a bias is not."""


def beside(refitter: Refitter, f: Finalist, singles: Sequence[SingleEvidence]) -> list[Finalist]:
    """A finalist with a broad part, and with each of the best special effects besides.

    Args:
        singles: every hypothesis alone, best first of each effect is tried.
    """
    if not any(is_broad(h) for h in f.parts):
        return []
    broad = next(h for h in f.parts if is_broad(h))
    hypotheses = refitter.searcher.hypotheses
    chosen: list[Hypothesis] = []
    for s in sorted(singles, key=lambda s: -s.log_posterior):
        if s.index < 0 or len(chosen) == SPECIAL:
            continue
        h = hypotheses[s.index]
        taken = {*f.names, STATED[0], *(c.name for c in chosen)}
        if h.name not in taken and not is_broad(h) and not h.effect.rough:
            chosen.append(h)
    places = [k for k, (p, _, _) in enumerate(refitter.variables(f.parts)) if f.parts[p] is broad]
    kept = np.delete(f.x, places)
    others = tuple(p for p in f.parts if p is not broad)
    found = []
    for h in chosen:
        start = np.concatenate([kept, refitter.start((h,)), 0.0 * f.x[places]])
        found.append(refitter.shrunk(refitter.fit((*others, h, broad), f.rung, start)))
    return found


def is_broad(h: Hypothesis) -> bool:
    """Whether a hypothesis has so many amplitudes that it can pass for others."""
    return len(h.columns) >= BROAD and h.name not in STATED and not h.variant.shape


NEAR = 12.0
"""A rival is refitted if its linear evidence is so near that of the part it replaces (natural
logarithm)."""
MOST = 3
"""Rivals refitted for each part."""


def with_rivals(
    refitter: Refitter, f: Finalist, parts: Sequence[int], singles: Sequence[SingleEvidence]
) -> list[Finalist]:
    """A finalist with each of some parts replaced by effects that do nearly as well.

    Args:
        parts: numbers of the parts that would be claimed.
        singles: every hypothesis alone.
    """
    found = []
    for k in parts:
        if f.parts[k].name in STATED:
            continue
        rest = tuple(h for i, h in enumerate(f.parts) if i != k)
        more: Sequence[SingleEvidence] = singles
        base = None
        if rest:
            keep = [i for i, (p, _, _) in enumerate(refitter.variables(f.parts)) if p != k]
            base = refitter.at(rest, f.rung, f.x[keep], f.spread[keep])
            more = refitter.added(base)
        for s in _near(refitter, more, f, k):
            h = refitter.searcher.hypotheses[s.index]
            found.append(refitter.fit((h,), s.rung) if base is None else refitter.extended(base, h))
    return found


def _near(
    refitter: Refitter, more: Sequence[SingleEvidence], f: Finalist, part: int
) -> list[SingleEvidence]:
    """The best variant of each other effect, if it comes near the part itself."""
    hypotheses, own = refitter.searcher.hypotheses, f.parts[part].name
    best: dict[str, SingleEvidence] = {}
    for s in more:
        if s.index >= 0:
            name = hypotheses[s.index].name
            if name not in best or s.log_posterior > best[name].log_posterior:
                best[name] = s
    mark = best[own].log_posterior if own in best else -np.inf
    others = [s for n, s in best.items() if n not in f.names and n not in STATED]
    others = [s for s in others if s.log_posterior > mark - NEAR]
    return sorted(others, key=lambda s: -s.log_posterior)[:MOST]


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
        drafts: list[tuple[float, Finalist, SingleEvidence]] = []
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
    found += with_rivals(refitter, best, _claimed(refitter, best), singles)
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
    refitter: Refitter, found: Sequence[Finalist], singles: Sequence[SingleEvidence]
) -> list[Finalist]:
    """Special effects beside the best explanation where it is broad; then one more."""
    best = min(found, key=_posterior)
    pairs = beside(refitter, best, singles)
    if not pairs:
        return []
    return pairs + beside(refitter, min(pairs, key=_posterior), singles)


def _other_clocks(
    searcher: Searcher, singles: Sequence[SingleEvidence], chosen: Sequence[SingleEvidence]
) -> list[SingleEvidence]:
    """All that makes readings late or smears them, where one such effect is chosen.

    Their slopes are alike, and true only while the delay is short beside what moves.
    """

    def late(s: SingleEvidence) -> bool:
        return s.index >= 0 and searcher.hypotheses[s.index].effect.stage == "timing"

    taken = {s.index for s in chosen}
    if not any(map(late, chosen)):
        return []
    best: dict[int, SingleEvidence] = {}
    for s in sorted(filter(late, singles), key=lambda s: -s.log_posterior):
        if s.index not in taken:
            best.setdefault(s.index, s)
    return list(best.values())


def _posterior(f: Finalist) -> float:
    return -f.log_posterior


def _claimed(refitter: Refitter, f: Finalist) -> list[int]:
    named = [k for k, h in enumerate(f.parts) if h.name not in STATED]
    return [k for k in named if share(refitter, f, k) >= CLAIMABLE]


def _kernel(searcher: Searcher, kernels: Sequence[SingleEvidence]) -> str:
    best = max(kernels, key=lambda s: s.log_posterior)
    return searcher.kernels[-1 - best.index]


def _distinct(
    searcher: Searcher, singles: Sequence[SingleEvidence], count: int, base: float
) -> list[SingleEvidence]:
    """The best of each effect, with a second variant where it is nearly as good."""
    kept: list[SingleEvidence] = []
    best: dict[str, list[SingleEvidence]] = {}
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
