"""What held-out rows make of a verdict: they have the last word.

A claim needs that its effect closes a part of the gap on rows that no fit saw, with its interval;
`none` needs that there is hardly a gap. What they refute is withdrawn.
"""

from collections.abc import Collection
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
    if verdict.verdict == UNKNOWN and gap.calibrated.high - max(gap.floor, 0.0) < CLAIMABLE:
        return withdrawn(verdict, NONE)
    return verdict


def small(gap: Closure) -> bool:
    """Whether there is hardly a gap, so that there may be no cause."""
    return gap.excess <= LARGEST_NONE


def closes(member: Interval | None) -> bool:
    """Whether a cause closes what counts on held-out rows."""
    return member is not None and member.value >= LEAST


def surely(member: Interval | None) -> bool:
    """Whether it does, and its interval agrees."""
    return member is not None and closes(member) and member.low > 0.0


def withdrawn(verdict: Verdict, instead: str) -> Verdict:
    """The verdict without its leading answer, of which a little probability remains."""
    share = dict(verdict.probabilities)
    leading = "|".join(verdict.causes[0].names) if verdict.causes else verdict.verdict
    refuted = {leading} if not verdict.causes else set(share) - {NONE, UNKNOWN}
    spare = sum((1.0 - REFUTED) * share[n] for n in refuted if n in share)
    share |= {n: REFUTED * share[n] for n in refuted if n in share}
    share[instead] = share.get(instead, 0.0) + spare
    if instead == UNKNOWN and NONE not in refuted:  # there is a gap
        share[UNKNOWN] += (1.0 - REFUTED) * share.get(NONE, 0.0)
        share[NONE] = REFUTED * share.get(NONE, 0.0)
    return replace(verdict, verdict=instead, causes=(), probabilities=share)


def _claims(verdict: Verdict, gap: Closure, witnessed: Collection[str]) -> Verdict:
    together = gap.closed is not None and gap.closed.low > 0.0

    def sure(c: Cause) -> bool:
        seen = bool(set(c.names) & set(witnessed))
        return seen or (together and surely(gap.members.get(c.part.name)))

    def stands(c: Cause) -> bool:
        return sure(c) or (together and closes(gap.members.get(c.part.name)))

    certain = tuple(c for c in verdict.causes if sure(c))
    if not certain:
        return withdrawn(verdict, NONE if small(gap) else UNKNOWN)
    doubtful = (c for c in verdict.causes if c not in certain and stands(c))
    capped = (replace(c, probability=min(c.probability, DOUBTFUL)) for c in doubtful)
    held = _leading(verdict, (*certain, *capped))
    most = together and gap.closed is not None and gap.closed.value >= MOST
    lost = len(held.causes) < len(verdict.causes)
    return held if most or lost else replace(held, verdict=PARTIAL)


def _leading(verdict: Verdict, kept: tuple[Cause, ...]) -> Verdict:
    """The verdict with some of its causes, the probability of the leading one with the first.

    Without a cause that had rivals it is no longer ambiguous.
    """
    share = dict(verdict.probabilities)
    old, new = ("|".join(c[0].names) for c in (verdict.causes, kept))
    if old != new:
        share[new] = share.get(new, 0.0) + share.pop(old, 0.0)
    return replace(verdict, verdict=named(kept), causes=kept, probabilities=share)
