"""Sets of causes of a gap in joint efforts as the options of a decision (`decision.decide`)."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache, partial

import numpy as np

from wrenchbed.diagnosis.decision.decide import LARGEST_NONE, small
from wrenchbed.diagnosis.decision.facts import Facts
from wrenchbed.diagnosis.decision.rivals import not_apart
from wrenchbed.diagnosis.efforts.fitted_causes import Simulators, added
from wrenchbed.diagnosis.efforts.search import TEMPER, Structure
from wrenchbed.diagnosis.evidence.search import NONE
from wrenchbed.diagnosis.explain.contributions import CLAIMABLE
from wrenchbed.diagnosis.explain.elements import DOUBT
from wrenchbed.diagnosis.explain.reliability import RIGHT_ELSEWHERE
from wrenchbed.diagnosis.explain.verdict import Cause, Key, Option, Part, Verdict
from wrenchbed.diagnosis.gap.gap_bootstrap import Bootstrap, Closure, closure
from wrenchbed.drives.joint_least_squares import FOLDS

_SMALL = 1e-3
"""Probability of a set of causes below which it is not examined; the best one always is."""
_BESIDE = 0.25
"""Gap of causes without a name, over that of named ones, above which a set of causes counts as
unknown: the unnamed causes are then no small part."""
_MOSTLY = 2.0 / 3.0
"""Closed share of the gap below which claims are believed to at most `RIGHT_ELSEWHERE`: clearly
more than half. That probability also bounds `none`, since ordinary errors may imitate a cause (79 %
of `none` were right on the development seeds), and claims that leave a gap of 1 in a joint."""


def weighed(
    chances: Mapping[Structure, float], simulators: Simulators
) -> tuple[Option[Structure], ...]:
    """Probable sets of causes from ``chances``, their probabilities: best first, each with its
    causes and the gap that each adds, largest first."""
    likely = {s: p for k, (s, p) in enumerate(chances.items()) if p >= _SMALL or k == 0}
    total, result = sum(likely.values()), list[Option[Structure]]()
    for structure, p in likely.items():
        every = [_part(simulators, chances, structure, b) for b in structure]
        parts = {part.key: part for part in sorted(every, key=lambda part: part.share)}
        result.append(Option(structure, p / total, tuple(reversed(parts.values()))))
    return tuple(result)


def _part(
    s: Simulators, chances: Mapping[Structure, float], structure: Structure, block: int
) -> Part:
    """Cause ``block``, an index, of the set ``structure``, with its gap. It is named by a simpler
    cause that it contains (an offset, not a cable) unless ``chances``, sets' probabilities, prefer
    it.
    """
    d, b, beside = s.d, s.d.blocks[block], [k for k in structure if k != block]
    for k, other in enumerate(d.blocks):
        if other.joint == b.joint and {*other.columns} < {*b.columns}:
            less = tuple(sorted((*beside, k)))
            block = k if chances.get(less, 0.0) >= chances[structure] else block
    gap = added(d, s.of(structure).x, d.at[block])
    return Part(d.blocks[block].effect, gap, index=block, joint=b.joint)


def outside(s: Simulators, best: Option[Structure]) -> str:
    """Description and channel of the largest cause that is no effect of the library; else empty."""
    unnamed = (p for p in best.parts if "." not in p.name and p.share >= CLAIMABLE)
    each = (f"{p.name} of {s.d.scene.channels[(p.joint or 1) - 1][0]}" for p in unnamed)
    return next(each, "")


def blocks(causes: Sequence[Cause]) -> tuple[int, ...]:
    """Sorted indices of the claimed causes in the dictionary, for a fit with all of them."""
    return tuple(sorted(c.part.index for c in causes if c.part.index is not None))


def facts_of(
    s: Simulators, every: Sequence[Option[Structure]], seed: int, least: float = CLAIMABLE
) -> Facts[Structure]:
    """Facts for a decision on joint efforts, from probable sets of causes, best first; see `Facts`.

    Causes add ``least`` gap; sets with large unnamed causes are unknown. ``seed``: of bootstrap.
    """
    some, unknown = list[Option[Structure]](), 0.0
    for o in every:
        parts = tuple(p for p in o.parts if "." in p.name and p.share >= least)
        large = sum(p.share for p in o.parts if p.share >= CLAIMABLE)
        if large > (1.0 + _BESIDE) * sum(p.share for p in parts if p.share >= CLAIMABLE):
            unknown += o.probability
        else:
            some.append(replace(o, parts=parts))

    @cache
    def measured(causes: tuple[int, ...]) -> Closure:
        names = [column for _, column, _ in s.d.scene.channels]
        of = partial(closure, [s.judged(causes)], names, FOLDS, seed)
        gap = of(stated=False)
        stated = all(s.d.stated[s.d.at[b]].all() for b in causes)
        shrinks = gap.closed is not None and gap.closed.high >= 0.0
        # the usual fit takes wrong stated numbers: they close the configured gap
        return of(stated=True) if shrinks and stated and small(gap) else gap

    return Facts(
        some or (Option((), 0.0, ()),), unknown, lambda verdict: measured(blocks(verdict.causes)),
        _right, doubt=DOUBT / TEMPER, ordinary_fitted=True,
    )  # fmt: skip


def as_good(s: Simulators, verdict: Verdict[Structure], seed: int) -> tuple[Key, ...]:
    """Effects that do as well in the leading cause's place on held-out rows, best first; none if
    the claimed causes leave only noise in its joint. ``seed``: of the bootstrap over blocks."""
    if not verdict.causes or (index := verdict.causes[0].part.index) is None:
        return ()
    d, (lead, *others) = s.d, verdict.causes
    claim, joint = blocks(verdict.causes), lead.part.joint
    mean, leading = Bootstrap([(d.fold, np.ones(len(d.fold)))], seed).mean, s.gap(claim, joint)
    if mean(leading).low <= 0.0:
        return ()
    taken = {key for c in verdict.causes for key in c.keys}
    simpler = {*d.blocks[index].columns}
    each = (
        (b.key, s.gap((*blocks(others), k), joint), partial(s.gap, (*claim, k), joint))
        for k, b in enumerate(d.blocks)
        if b.joint == joint and not b.outside and b.key not in taken
        if len(d.at[k]) and not simpler < {*b.columns}
    )
    return not_apart(mean, s.gap(blocks(others), joint), leading, 0.0, each)


def _right(verdict: Verdict[Structure], gap: Closure) -> float:
    """Share of verdicts like this that are right, 0…1: less where ordinary errors may imitate a
    cause, or where much of the gap, or a gap of 1, is left in all joints or in the cause's."""
    if not verdict.causes:
        return RIGHT_ELSEWHERE if verdict.word == NONE else 1.0
    joint = verdict.causes[0].part.joint
    of_joint = [c for n, c in gap.per_channel.items() if n.lstrip("taui") == str(joint)]
    little = gap.closed is None or gap.closed.value < _MOSTLY
    much = bool(of_joint) and of_joint[0].get("after", 0.0) > LARGEST_NONE
    return gap.closed_beside(LARGEST_NONE) * (RIGHT_ELSEWHERE if little or much else 1.0)
