"""What may be said of a search: which causes, with which rivals, how probable; or none, or unknown.

A cause counts from a gap of 1 (`docs/contracts.md`); held-out rows have the last word.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from wrenchbed.diagnosis.decision.decide import LARGEST_NONE, LEAST, MOST, PARTIAL
from wrenchbed.diagnosis.efforts.dictionary import Dictionary
from wrenchbed.diagnosis.efforts.search import Search, Structure
from wrenchbed.diagnosis.efforts.signs import HELD, Sign
from wrenchbed.diagnosis.efforts.twin_fit import TwinFit, added, fitted
from wrenchbed.diagnosis.evidence.search import NONE, UNKNOWN
from wrenchbed.diagnosis.explain.reliability import credible
from wrenchbed.diagnosis.gap.gaps import Closure, Interval

COUNTS = 0.75
"""Gap from which a part counts: it estimates what adds 1 with an error; estimate."""
_RIVAL = 0.1
"""Share of a cause's probability from which another is its rival."""
_SMALL = 1e-3
"""Total probability of the least probable structures, which are not examined."""
_BESIDE = 0.25
"""Gap of causes without a name over that of named ones, from which nothing is named; estimate."""
_MOST_RIVALS = 4
"""Members of a class beside its first (the contract's)."""
_LAG = (0.4, 2.5)
"""Amplitudes of a lag's column that are lags: its law holds near 1; estimate."""
_LITTLE = 0.25
"""Least share of the gap that causes close together: estimate, imperfect models close less."""
_FURTHER = 0.1
"""Share of the gap that a further cause closes by itself at least; estimate."""
_CLEAR = 3.0
"""Standard errors by which the gap that a further cause closes must exceed zero; estimate."""
_NORMAL = 3.92
"""Standard errors in a 95 % interval."""
_LARGEST_JOINT = 2.0
"""Gap of one joint up to which there may be no cause: ordinary arms reach 1.5; estimate."""
DOUBTFUL = 0.85
"""Largest probability of `none`, which ordinary errors may imitate, and of an answer that leaves a
gap that counts; estimate: 79 % of `none` were right on the development seeds, half of all arms
having a cause."""
_MOSTLY = 2.0 / 3.0
"""Share of the gap that causes close at least that are surer than that; estimate."""
_FIRM = 0.75
"""Probability from which evidence names a cause beside which ordinary errors leave hardly a gap
either; estimate."""
_WITHDRAWN = 0.15
"""Share of a withdrawn answer's probability that it keeps, for evidence and held-out rows disagree;
estimate."""

Key = tuple[str, int | None]
"""Effect and joint (from 1) of a cause."""


@dataclass(frozen=True, eq=False)
class Cause:
    """One claimed cause of a gap in joint efforts.

    Attributes:
        block: number of the cause in the dictionary.
        key: effect and joint.
        rivals: causes that may be present instead, likeliest first.
        probability: that the cause or one of its rivals is present.
        share: of the gap that it adds.
        weights: of the cause and each rival in that probability; alike where there are none.
    """

    block: int
    key: Key
    rivals: tuple[Key, ...]
    probability: float
    share: float
    weights: tuple[float, ...] = ()

    @property
    def shares(self) -> tuple[float, ...]:
        """Share of the cause and of each rival in the probability."""
        each = self.weights or (1.0,) * (1 + len(self.rivals))
        return tuple(p / sum(each) for p in each)


@dataclass(frozen=True, eq=False)
class Verdict:
    """Answer to a recording of joint efforts: a word, and the claimed causes.

    Attributes:
        word: of the contract.
        causes: claims.
        probabilities: of the leading cause by name.
        outside: what a gap without a name looks most like, in words.
        imitated: whether ordinary errors together explain the recording as well.
        of_configured: whether closure counts from the configured simulator.
    """

    word: str
    causes: tuple[Cause, ...]
    probabilities: Mapping[str, float]
    outside: str = ""
    imitated: bool = False
    of_configured: bool = False

    def set90(self) -> tuple[str, ...]:
        """Names of a 90 % credible set of answers, the causes and their rivals included."""
        names = credible(self.probabilities, 0.9)
        return tuple(dict.fromkeys(
            (*names, *(k[0] for c in self.causes for k in (c.key, *c.rivals)))
        ))  # fmt: skip


@dataclass(frozen=True, eq=False)
class Weighed:
    """Structures that have a probability, with what each of their causes adds."""

    structures: tuple[tuple[Structure, float, Mapping[int, float]], ...]

    def counting(self, k: int) -> dict[int, float]:
        """Gap of each cause of structure k that counts, by block."""
        return {b: g for b, g in self.structures[k][2].items() if g >= COUNTS}


def weighed(s: Search) -> Weighed:
    """Probable structures with the gap that each of their causes adds."""
    candidates = list[tuple[Structure, float, dict[int, float]]]()
    for structure, p in zip(s.structures, s.probability, strict=True):
        if p >= _SMALL or not candidates:
            fit = fitted(s.d, structure)
            gaps = {k: added(s.d, fit, k) if _plausible(s.d, fit, k) else 0.0 for k in structure}
            candidates.append((structure, float(p), gaps))
    total = sum(p for _, p, _ in candidates)
    return Weighed(tuple((x, p / total, g) for x, p, g in candidates))


def _plausible(d: Dictionary, fit: TwinFit, block: int) -> bool:
    """Whether a fitted lag lies within the range for which its linear column holds."""
    if d.blocks[block].effect not in ("drive.delay", "drive.bandwidth"):
        return True
    return _LAG[0] <= float(fit.x[d.at[block][0]]) <= _LAG[1]


def decide(d: Dictionary, w: Weighed) -> Verdict:
    """Verdict from the evidence alone, before held-out rows are compared."""
    leading: dict[Key | str, float] = {NONE: 0.0, UNKNOWN: 0.0}
    mass: dict[Structure, float] = {}
    for k, (_, p, _) in enumerate(w.structures):
        own = w.counting(k)
        named = {b: g for b, g in own.items() if not d.blocks[b].outside}
        other = sum(g for b, g in own.items() if d.blocks[b].outside)
        lead: Key | str = NONE
        if own:
            lead = UNKNOWN
            if named and other <= _BESIDE * sum(named.values()):
                lead = d.blocks[max(named, key=lambda b: named[b])].key
                kept = tuple(sorted(named))
                mass[kept] = mass.get(kept, 0.0) + p
        leading[lead] = leading.get(lead, 0.0) + p
    words = _by_effect(leading)
    outside = _outside(d, w)
    if words[UNKNOWN] >= 0.5 or not mass or sum(mass.values()) < max(words[NONE], words[UNKNOWN]):
        word = UNKNOWN if words[UNKNOWN] > words[NONE] else NONE
        return Verdict(word, (), words, outside if word == UNKNOWN else "")
    causes = _causes(d, w, mass)
    open_ = any(c.rivals for c in causes)
    return Verdict("ambiguous" if open_ else "identified", causes, words, outside)


def _by_effect(leading: Mapping[Key | str, float]) -> dict[str, float]:
    words: dict[str, float] = {}
    for key, p in leading.items():
        name = key if isinstance(key, str) else key[0]
        words[name] = words.get(name, 0.0) + p
    return words


def _outside(d: Dictionary, w: Weighed) -> str:
    """Unnamed cause that adds most, with its channel; empty if there is none."""
    own = {b: g for b, g in w.counting(0).items() if d.blocks[b].outside}
    if not own:
        return ""
    best = d.blocks[max(own, key=lambda b: own[b])]
    return f"{best.effect} of {d.scene.channels[(best.joint or 1) - 1]}"


def _causes(d: Dictionary, w: Weighed, mass: Mapping[Structure, float]) -> tuple[Cause, ...]:
    keyed: dict[frozenset[Key], float] = {}
    for s, p in mass.items():
        keys = frozenset(d.blocks[b].key for b in s)
        keyed[keys] = keyed.get(keys, 0.0) + p
    lead = max(keyed, key=lambda k: keyed[k])
    best = next(k for k in range(len(w.structures)) if _named(d, w, k) == lead)
    gaps = {b: g for b, g in w.counting(best).items() if not d.blocks[b].outside}
    total, causes = sum(gaps.values()), []
    for b, gap in sorted(gaps.items(), key=lambda item: -item[1]):
        key = d.blocks[b].key
        present = sum(p for keys, p in keyed.items() if key in keys)
        instead: dict[Key, float] = {}
        for keys, p in keyed.items():
            if key not in keys:
                for other in keys - lead:
                    instead[other] = instead.get(other, 0.0) + p
        rivals = sorted((k for k, p in instead.items() if p >= _RIVAL * present),
                        key=lambda k: -instead[k])[:_MOST_RIVALS]  # fmt: skip
        any_of = sum(p for keys, p in keyed.items() if keys & {key, *rivals})
        each = [present, *(instead[k] for k in rivals)]
        causes.append(Cause(b, key, tuple(rivals), min(any_of, 1.0), gap / total, tuple(each)))
    return tuple(causes)


def _named(d: Dictionary, w: Weighed, k: int) -> frozenset[Key]:
    return frozenset(d.blocks[b].key for b in w.counting(k) if not d.blocks[b].outside)


def upheld(
    v: Verdict,
    gap: Closure,
    seen: Sequence[Sign] = (),
    *,
    apart: bool = False,
    stated: Interval | None = None,
) -> Verdict:
    """The answer without what held-out rows refute.

    Args:
        v: answer.
        gap: measured with its causes.
        seen: signs that the residual is not ordinary noise: then nothing is `none`.
        apart: whether a link's number is not that of the joint before it.
        stated: share of the configured gap that the causes close, where all are wrong numbers.
    """
    worst = max(c["before"] for c in gap.per_channel.values())
    small = gap.calibrated.low <= LARGEST_NONE and worst <= _LARGEST_JOINT and not seen
    if v.word == NONE:
        return _doubted(v) if small else withdrawn(v, UNKNOWN)
    if v.word == UNKNOWN:
        return withdrawn(v, NONE) if gap.calibrated.high < LEAST and small else v
    least = MOST if any(s.kind == HELD for s in seen) else _LITTLE
    shown = tuple[Cause, ...]()
    if gap.closed is not None and gap.closed.low > 0.0 and gap.closed.value >= least:
        shown = _shown(gap, v.causes, apart)
    if not shown:
        by_evidence = _by_evidence(v, gap, stated) if small else None
        return by_evidence or withdrawn(v, NONE if small else UNKNOWN)
    if shown != v.causes:
        open_ = any(c.rivals for c in shown)
        v = Verdict("ambiguous" if open_ else "identified", shown, v.probabilities, v.outside)
    v = replace(v, causes=tuple(_doubted_cause(gap, c) for c in v.causes))
    rest = 0.0 if gap.with_effects is None else gap.with_effects.low
    if gap.closed is not None and gap.closed.value < MOST and rest > LARGEST_NONE:
        return Verdict(PARTIAL, v.causes, v.probabilities, v.outside)
    return v


def _by_evidence(v: Verdict, gap: Closure, stated: Interval | None) -> Verdict | None:
    """Causes that evidence names although ordinary errors together imitate them.

    Once these are fitted there is hardly a gap. No held-out row may refute the causes: they close
    some of what is left, or are wrong numbers that close the configured gap, from which these count
    (`docs/contracts.md`). They are less sure.
    """
    if not v.causes or min(c.probability for c in v.causes) < _FIRM or gap.closed is None:
        return None
    if any(member.high < 0.0 for member in gap.members.values()):
        return None
    of_configured = gap.closed.low <= 0.0
    if of_configured and (gap.closed.high < 0.0 or stated is None or stated.low <= 0.0):
        return None
    causes = tuple(replace(c, probability=min(c.probability, DOUBTFUL)) for c in v.causes)
    probability = {
        n: p if n in (NONE, UNKNOWN) else DOUBTFUL * p for n, p in v.probabilities.items()
    }
    probability[NONE] = (
        probability.get(NONE, 0.0) + sum(v.probabilities.values()) - sum(probability.values())
    )
    return Verdict(v.word, causes, probability, v.outside, True, of_configured)


def _shown(gap: Closure, causes: Sequence[Cause], apart: bool) -> tuple[Cause, ...]:
    """Causes that held-out rows show, each with a gap of its own.

    Of one joint the first is a cause and others its rivals: motions seldom tell two apart.
    """
    kept = list[Cause]()
    for c in sorted(causes, key=lambda c: -_closed(gap, c)):
        if not _closes(gap, c, further=bool(kept)):
            continue
        same = [k for k, first in enumerate(kept) if _one_place(first.key, c.key, apart)]
        if same:
            kept[same[0]] = _beside(kept[same[0]], c)
        else:
            kept.append(c)
    return tuple(kept)


def _one_place(first: Key, other: Key, apart: bool) -> bool:
    """Whether two causes concern the same joint, or the same link where links have their own
    numbers."""
    subsystems = {key[0].partition(".")[0] for key in (first, other)}
    return first[1] is not None and first[1] == other[1] and (not apart or len(subsystems) == 1)


def _beside(first: Cause, other: Cause) -> Cause:
    """A cause with another of its joint as a rival; one of them is there at least as probably."""
    known = (first.key, *first.rivals)
    more = [k for k in (other.key, *other.rivals) if k not in known]
    rivals = (*first.rivals, *more)[:_MOST_RIVALS]
    each = [*first.shares, *(min(first.shares) for _ in more)][: 1 + len(rivals)]
    probability = max(first.probability, other.probability)
    return replace(first, rivals=rivals, probability=probability, weights=tuple(each))


def _closed(gap: Closure, cause: Cause) -> float:
    member = gap.members.get(str(cause.block))
    return 0.0 if member is None else member.value


def _closes(gap: Closure, cause: Cause, *, further: bool) -> bool:
    """Whether held-out rows confirm a cause; a ``further`` one must close more."""
    member = gap.members.get(str(cause.block))
    if member is None or member.low <= 0.0:
        return False
    error = (member.high - member.low) / _NORMAL
    clear = member.value >= max(_CLEAR * error, _FURTHER * gap.calibrated.value)
    return clear or not further


def _doubted_cause(gap: Closure, cause: Cause) -> Cause:
    """A cause less probable where much of the gap, or a gap of its joint that counts, is left."""
    joint = cause.key[1]
    of_joint = [c for n, c in gap.per_channel.items() if n.lstrip("taui") == str(joint)]
    little = gap.closed is not None and gap.closed.value < _MOSTLY
    if little or (of_joint and of_joint[0].get("after", 0.0) > LARGEST_NONE):
        return replace(cause, probability=min(cause.probability, DOUBTFUL))
    return cause


def _doubted(v: Verdict) -> Verdict:
    """`none` less probable: ordinary errors may imitate a cause."""
    probability = dict(v.probabilities)
    more = max(probability.get(NONE, 0.0) - DOUBTFUL, 0.0)
    probability[NONE] = probability.get(NONE, 0.0) - more
    probability[UNKNOWN] = probability.get(UNKNOWN, 0.0) + more
    return replace(v, probabilities=probability)


def withdrawn(v: Verdict, instead: str) -> Verdict:
    """The answer given up; a little of its probability remains."""
    probability = dict(v.probabilities)
    fallen = {n for n in probability if n != instead and (instead == UNKNOWN or n != UNKNOWN)}
    if instead == UNKNOWN and v.word != NONE:
        fallen -= {NONE}
    probability[instead] = probability.get(instead, 0.0) + (1.0 - _WITHDRAWN) * sum(
        probability[n] for n in fallen
    )
    probability |= {n: _WITHDRAWN * probability[n] for n in fallen}
    return Verdict(instead, (), probability, v.outside)


def kept(causes: Sequence[Cause]) -> tuple[int, ...]:
    """Sorted block indices of the claimed causes."""
    return tuple(sorted(c.block for c in causes))
