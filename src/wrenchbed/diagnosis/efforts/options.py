"""Structures of causes of a gap in joint efforts as the options of a decision."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from wrenchbed.diagnosis.decision.decide import LARGEST_NONE, small
from wrenchbed.diagnosis.decision.facts import Facts
from wrenchbed.diagnosis.efforts.dictionary import BLOCKS, Dictionary
from wrenchbed.diagnosis.efforts.held_out import judged
from wrenchbed.diagnosis.efforts.search import Search, Structure
from wrenchbed.diagnosis.efforts.simulator import Simulator, Simulators
from wrenchbed.diagnosis.evidence.search import NONE
from wrenchbed.diagnosis.explain.contributions import CLAIMABLE
from wrenchbed.diagnosis.explain.verdict import Cause, Option, Part, Verdict
from wrenchbed.diagnosis.gap.gaps import Closure, closure

_SMALL = 1e-3
"""Total probability of the least probable structures, which are not examined."""
_BESIDE = 0.25
"""Gap of causes without a name over that of named ones, from which nothing is named; estimate."""
_LAG = (0.4, 2.5)
"""Amplitudes of a lag's column that are lags: its law holds near 1; estimate."""
_RIVAL = 0.1
"""Share of a class from which another cause is a rival: probabilities are means of 16 draws."""
BELIEVED = 0.85
"""Share of right answers where ordinary errors may imitate a cause, or causes leave a gap that
counts: 79 % of `none` were right on the development seeds, half of all arms having a cause."""
_MOSTLY = 2.0 / 3.0
"""Share of the gap that causes close at least that are surer than that; estimate."""


@dataclass(frozen=True, eq=False)
class Weighed:
    """Structures that have a probability, with what each of their causes adds."""

    structures: tuple[tuple[Structure, float, Mapping[int, float]], ...]

    def counting(self, k: int) -> dict[int, float]:
        """Gap of each cause of structure k that counts, by block."""
        return {b: g for b, g in self.structures[k][2].items() if g >= CLAIMABLE}


def weighed(s: Search) -> Weighed:
    """Probable structures with the gap that each of their causes adds."""
    candidates = list[tuple[Structure, float, dict[int, float]]]()
    for structure, p in zip(s.structures, s.probability, strict=True):
        if p >= _SMALL or not candidates:
            fit = Simulator(s.d, structure)
            gaps = {k: fit.added(k) if _plausible(fit, k) else 0.0 for k in structure}
            candidates.append((structure, float(p), gaps))
    total = sum(p for _, p, _ in candidates)
    return Weighed(tuple((x, p / total, g) for x, p, g in candidates))


def _plausible(fit: Simulator, block: int) -> bool:
    """Whether a fitted lag lies within the range for which its linear column holds."""
    d = fit.d
    if d.blocks[block].effect not in ("drive.delay", "drive.bandwidth"):
        return True
    return _LAG[0] <= float(fit.x[d.at[block][0]]) <= _LAG[1]


def outside(d: Dictionary, w: Weighed) -> str:
    """Unnamed cause that adds most, with its channel; empty if there is none."""
    unnamed = {b: g for b, g in w.counting(0).items() if d.blocks[b].outside}
    if not unnamed:
        return ""
    best = d.blocks[max(unnamed, key=lambda b: unnamed[b])]
    return f"{best.effect} of {d.scene.channels[(best.joint or 1) - 1]}"


def options(d: Dictionary, w: Weighed) -> tuple[tuple[Option[Structure], ...], float]:
    """Structures that name what they say, and the probability of those that do not."""
    result, unknown = list[Option[Structure]](), 0.0
    for k, (structure, p, _) in enumerate(w.structures):
        gaps = w.counting(k)
        named = {b: g for b, g in gaps.items() if not d.blocks[b].outside}
        unnamed = sum(gaps.values()) - sum(named.values())
        if unnamed > _BESIDE * sum(named.values()):
            unknown += p
            continue
        in_order = sorted(named, key=lambda b: -named[b])
        parts = (
            Part(d.blocks[b].effect, named[b], index=b, joint=d.blocks[b].joint) for b in in_order
        )
        result.append(Option(structure, p, tuple(parts)))
    return tuple(result) or (Option((), 0.0, ()),), unknown


def blocks(causes: Sequence[Cause]) -> tuple[int, ...]:
    """Sorted numbers of the claimed causes' blocks."""
    return tuple(sorted(c.part.index for c in causes if c.part.index is not None))


class Claims:
    """Gaps on held-out rows with the causes of a verdict; each is made once.

    Args:
        simulators: with causes.
        names: of the recording's columns, channel by channel.
        seed: of the bootstrap.
    """

    def __init__(self, simulators: Simulators, names: Sequence[str], seed: int) -> None:
        self._simulators, self._names, self._seed = simulators, names, seed
        self._made: dict[tuple[int, ...], Closure] = {}

    def gap(self, verdict: Verdict[Structure]) -> Closure:
        """Gaps there; where the usual fit leaves hardly a gap since it takes wrong stated numbers,
        the share of the configured gap that these close."""
        key, d = blocks(verdict.causes), self._simulators.d
        if key not in self._made:
            each = [judged(self._simulators, key)]
            gap = closure(each, self._names, BLOCKS, self._seed, stated=False)
            stated = all(d.stated[d.at[b]].all() for b in key)
            if gap.closed is not None and gap.closed.high >= 0.0 and small(gap) and stated:
                gap = closure(each, self._names, BLOCKS, self._seed, stated=True)
            self._made[key] = gap
        return self._made[key]


def facts_of(d: Dictionary, w: Weighed, claims: Claims) -> Facts[Structure]:
    """What a decision on joint efforts rests on; see `Facts`."""
    some, unknown = options(d, w)
    return Facts(
        some, unknown, claims.gap, _right, doubt=1.0, rival=_RIVAL,
        ordinary_fitted=True,
    )  # fmt: skip


def _right(verdict: Verdict[Structure], gap: Closure) -> float:
    """Fraction of answers like this one that are right: less where ordinary errors may imitate a
    cause, or where much of the gap, or a gap of the cause's joint that counts, is left."""
    if not verdict.causes:
        return BELIEVED if verdict.word == NONE else 1.0
    joint = verdict.causes[0].part.joint
    of_joint = [c for n, c in gap.per_channel.items() if n.lstrip("taui") == str(joint)]
    little = gap.closed is None or gap.closed.value < _MOSTLY
    left = bool(of_joint) and of_joint[0].get("after", 0.0) > LARGEST_NONE
    return BELIEVED if little or left else 1.0
