"""Structures of causes of a gap in joint efforts as the options of a decision."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache

from wrenchbed.diagnosis.decision.decide import LARGEST_NONE, small
from wrenchbed.diagnosis.decision.facts import Facts
from wrenchbed.diagnosis.efforts.dictionary import BLOCKS, Dictionary
from wrenchbed.diagnosis.efforts.fitted_causes import Simulators, added
from wrenchbed.diagnosis.efforts.search import Structure
from wrenchbed.diagnosis.evidence.search import NONE
from wrenchbed.diagnosis.explain.contributions import CLAIMABLE
from wrenchbed.diagnosis.explain.verdict import Cause, Option, Part, Verdict
from wrenchbed.diagnosis.gap.gaps import Closure, closure

_SMALL = 1e-3
"""Total probability of the least probable structures, which are not examined."""
_BESIDE = 0.25
"""Gap of causes without a name over that of named ones, from which nothing is named: the unnamed
are then no small part."""
_RIVAL = 0.1
"""Share of a class from which another cause is a rival: odds of ten to one are those of two
noises, which ordinary errors make. With the share of wrenches, and their doubt, a cable of no
stiffness is a rival of every zero of a torque sensor."""
BELIEVED = 0.85
"""Share of right answers where ordinary errors may imitate a cause, or causes leave a gap that
counts: 79 % of `none` were right on the development seeds, half of all arms having a cause."""


_MOSTLY = 2.0 / 3.0
"""Share of the gap that causes close at least that are surer than that: clearly more than half."""


@dataclass(frozen=True, eq=False)
class Weighed:
    """A structure with its probability, and the gap that each cause adds, by block index."""

    structure: Structure
    probability: float
    gaps: Mapping[int, float]

    @property
    def counting(self) -> dict[int, float]:
        """Gaps of the causes that are large enough for a claim, by block index."""
        return {b: g for b, g in self.gaps.items() if g >= CLAIMABLE}


def weighed(chances: Mapping[Structure, float], simulators: Simulators) -> tuple[Weighed, ...]:
    """Probable structures, the best of all first, with the gap that each of their causes adds."""
    likely = {s: p for k, (s, p) in enumerate(chances.items()) if p >= _SMALL or k == 0}
    total, result = sum(likely.values()), list[Weighed]()
    for structure, p in likely.items():
        x = simulators.of(structure).x
        gaps = {b: added(simulators.d, x, b) for b in structure}
        result.append(Weighed(structure, p / total, gaps))
    return tuple(result)


def outside(d: Dictionary, best: Weighed) -> str:
    """Name and channel of the unnamed cause that adds most; empty if there is none."""
    unnamed = {b: g for b, g in best.counting.items() if d.blocks[b].outside}
    if not unnamed:
        return ""
    most = d.blocks[max(unnamed, key=lambda b: unnamed[b])]
    return f"{most.effect} of {d.scene.channels[(most.joint or 1) - 1]}"


def options(
    d: Dictionary, every: Sequence[Weighed], least: float = CLAIMABLE
) -> tuple[tuple[Option[Structure], ...], float]:
    """Options made of named causes that each add the gap ``least``, and the probability of
    structures in which unnamed causes add too much."""
    result, unknown = list[Option[Structure]](), 0.0
    for w in every:
        named = {b: g for b, g in w.gaps.items() if g >= least and not d.blocks[b].outside}
        counts = sum(g for g in named.values() if g >= CLAIMABLE)
        if sum(w.counting.values()) > (1.0 + _BESIDE) * counts:
            unknown += w.probability
            continue
        in_order = sorted(named, key=lambda b: -named[b])
        parts = (
            Part(d.blocks[b].effect, named[b], index=b, joint=d.blocks[b].joint) for b in in_order
        )
        result.append(Option(w.structure, w.probability, tuple(parts)))
    return tuple(result) or (Option((), 0.0, ()),), unknown


def blocks(causes: Sequence[Cause]) -> tuple[int, ...]:
    """Sorted indices of the claimed causes' blocks."""
    return tuple(sorted(c.part.index for c in causes if c.part.index is not None))


def facts_of(
    s: Simulators, every: Sequence[Weighed], seed: int, least: float = CLAIMABLE
) -> Facts[Structure]:
    """Facts for a decision on joint efforts, from probable structures, best first; see `Facts`.

    A cause must add the gap ``least``.
    """
    some, unknown = options(s.d, every, least)

    @cache
    def measured(causes: tuple[int, ...]) -> Closure:
        each, names = [s.judged(causes)], s.d.scene.columns
        gap = closure(each, names, BLOCKS, seed, stated=False)
        stated = all(s.d.stated[s.d.at[b]].all() for b in causes)
        if gap.closed is None or gap.closed.high < 0.0 or not (small(gap) and stated):
            return gap
        # the usual fit takes wrong stated numbers: they close the configured gap
        return closure(each, names, BLOCKS, seed, stated=True)

    return Facts(
        some, unknown, lambda verdict: measured(blocks(verdict.causes)), _right,
        doubt=1.0, rival=_RIVAL, ordinary_fitted=True,
    )  # fmt: skip


def _right(verdict: Verdict[Structure], gap: Closure) -> float:
    """Share of such answers that are right: less where ordinary errors may imitate a cause, or
    where much of the gap, or a gap of 1, is left in all joints or in the cause's."""
    if not verdict.causes:
        return BELIEVED if verdict.word == NONE else 1.0
    joint = verdict.causes[0].part.joint
    of_joint = [c for n, c in gap.per_channel.items() if n.lstrip("taui") == str(joint)]
    little = gap.closed is None or gap.closed.value < _MOSTLY
    much = bool(of_joint) and of_joint[0].get("after", 0.0) > LARGEST_NONE
    return gap.closed_beside(LARGEST_NONE) * (BELIEVED if little or much else 1.0)
