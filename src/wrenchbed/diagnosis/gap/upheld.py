"""What held-out rows make of a verdict: they have the last word.

A claim needs that its effect closes a part of the gap on rows that no fit saw, with its interval;
`none` needs that there is hardly a gap. What they refute is withdrawn.
"""

from collections.abc import Collection, Iterable
from dataclasses import replace

from wrenchbed.diagnosis.evidence.search import NONE, UNKNOWN
from wrenchbed.diagnosis.explain.contributions import CLAIMABLE
from wrenchbed.diagnosis.explain.verdict import Cause, Verdict, named
from wrenchbed.diagnosis.gap.closure import Closure, Interval

PARTIAL = "partial"
LARGEST_NONE = 1.0
"""Calibrated gap beyond the noise up to which there may be no cause: the contract's."""
LEAST = 0.5
"""Gap that a cause must close at least: below it small imperfections are none (the contract's)."""
DOUBTFUL = 0.5
"""Largest probability of a cause beside a sure one whose interval holds 0: few poses show it."""
MOST = 0.5
"""Share of the gap from which causes explain most of it."""
REFUTED = 0.05
"""Share of a withdrawn answer's probability that it keeps; estimate."""


def upheld(verdict: Verdict, gap: Closure, witnessed: Collection[str] = ()) -> Verdict:
    """The verdict without what held-out rows refute.

    Where some of its causes remain, the gap must be measured again with these alone.

    Args:
        verdict: with its causes.
        gap: measured with all of these causes.
        witnessed: effects that another sensor than the wrench's measured.
    """
    if verdict.causes:
        return _claims(verdict, gap, witnessed)
    if verdict.verdict == NONE and not small(gap):
        return withdrawn(verdict, UNKNOWN)
    hardly = gap.calibrated.high - max(gap.floor, 0.0) < CLAIMABLE and small(gap)
    if verdict.verdict == UNKNOWN and hardly:
        return withdrawn(verdict, NONE)
    return verdict


def small(gap: Closure) -> bool:
    """Whether the gap is so small that there may be no cause.

    This holds for the mean gap of single channels, as the analysis weighs it, since imperfections
    do not share the correlation of the noise, and for the lower end of the gap's interval.
    """
    floor = max(gap.floor, 0.0)
    return max(gap.channels, gap.calibrated.low) - floor <= LARGEST_NONE


def closes(member: Interval | None) -> bool:
    """Whether a cause closes at least `LEAST` of the gap on held-out rows."""
    return member is not None and member.value >= LEAST


def surely(member: Interval | None) -> bool:
    """Whether a cause closes at least `LEAST` and its interval lies above zero."""
    return member is not None and closes(member) and member.low > 0.0


def withdrawn(verdict: Verdict, instead: str) -> Verdict:
    """The verdict without its answer, of which a little probability remains.

    Where causes give way to `unknown` there is a gap, so that `none` falls with them; where an
    unknown gap gives way to `none`, so do all causes of one.
    """
    probability = {NONE: 0.0, UNKNOWN: 0.0} | dict(verdict.probabilities)
    fallen = {NONE} if verdict.verdict == NONE else set(probability) - {instead}
    if verdict.causes and instead == NONE:
        fallen -= {UNKNOWN}
    probability[instead] += (1.0 - REFUTED) * sum(probability[n] for n in fallen)
    probability |= {n: REFUTED * probability[n] for n in fallen}
    return replace(verdict, verdict=instead, causes=(), probabilities=probability)


def _claims(verdict: Verdict, gap: Closure, witnessed: Collection[str]) -> Verdict:
    together = gap.closed is not None and gap.closed.low > 0.0

    def sure(c: Cause) -> bool:
        seen = bool(set(c.names) & set(witnessed))
        shown = together or c.part.index is None  # a fit takes a wrong number, so none closes it
        return seen or (shown and surely(gap.members.get(c.part.name)))

    def stands(c: Cause) -> bool:
        return sure(c) or (together and closes(gap.members.get(c.part.name)))

    def by_gap(causes: Iterable[Cause]) -> list[Cause]:
        back = {n: max(m.value, 0.0) for n, m in gap.members.items()}
        return sorted(causes, key=lambda c: -back.get(c.part.name, 0.0))

    certain = tuple(c for c in verdict.causes if sure(c))
    if not certain:
        return withdrawn(verdict, NONE if small(gap) else UNKNOWN)
    doubtful = (c for c in verdict.causes if c not in certain and stands(c))
    capped = (replace(c, probability=min(c.probability, DOUBTFUL)) for c in doubtful)
    held = only(verdict, (*by_gap(certain), *by_gap(capped)))
    most = together and gap.closed is not None and gap.closed.value >= MOST
    if most:  # of a gap that is explained, held-out rows say more than a witness
        shown = tuple(c for c in held.causes if _above_zero(gap.members.get(c.part.name)))
        held = only(verdict, shown) if shown and shown[0] in certain else held
    lost = len(held.causes) < len(verdict.causes)
    return held if most or lost else replace(held, verdict=PARTIAL)


def _above_zero(member: Interval | None) -> bool:
    return member is not None and (member.low > 0.0 or closes(member))


def only(verdict: Verdict, kept: tuple[Cause, ...]) -> Verdict:
    """The verdict with some of its causes, the probability of the leading one with the first.

    That one leads with no more than the probability that it is there; the rest is unknown.
    """
    probability = dict(verdict.probabilities)
    old, new = ("|".join(c[0].names) for c in (verdict.causes, kept))
    if old != new:
        together = probability.get(new, 0.0) + probability.pop(old, 0.0)
        probability[new] = min(together, kept[0].probability)
        probability[UNKNOWN] = probability.get(UNKNOWN, 0.0) + together - probability[new]
    return replace(verdict, verdict=named(kept), causes=kept, probabilities=probability)
