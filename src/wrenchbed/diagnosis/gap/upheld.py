"""What held-out rows make of a verdict: they have the last word.

A claim needs that its effect closes a part of the gap on rows that no fit saw, with its interval;
`none` needs that there is hardly a gap. What they refute is withdrawn.
"""

from collections.abc import Collection
from dataclasses import replace

from wrenchbed.diagnosis.evidence.search import NONE, UNKNOWN
from wrenchbed.diagnosis.explain.contributions import CLAIMABLE
from wrenchbed.diagnosis.explain.verdict import Cause, Verdict
from wrenchbed.diagnosis.gap.closure import Closure, Interval

PARTIAL = "partial"
LARGEST_NONE = 1.0
"""Calibrated gap beyond the noise up to which there may be no cause: the contract's."""
LEAST = 0.5
"""Gap that a cause must close at least: below it small imperfections are none (the contract's)."""
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
    return gap.excess <= LARGEST_NONE and gap.calibrated.low <= LARGEST_NONE


def holds(closes: Interval | None) -> bool:
    """Whether held-out rows show that a cause closes what counts."""
    return closes is not None and closes.low > 0.0 and closes.value >= LEAST


def withdrawn(verdict: Verdict, instead: str) -> Verdict:
    """The verdict without its leading answer, of which a little probability remains."""
    share = dict(verdict.probabilities)
    leading = "|".join(verdict.causes[0].names) if verdict.causes else verdict.verdict
    named = {leading} if not verdict.causes else set(share) - {NONE, UNKNOWN}
    spare = sum((1.0 - REFUTED) * share[n] for n in named if n in share)
    share |= {n: REFUTED * share[n] for n in named if n in share}
    share[instead] = share.get(instead, 0.0) + spare
    if instead == UNKNOWN and NONE not in named:  # there is a gap
        share[UNKNOWN] += (1.0 - REFUTED) * share.get(NONE, 0.0)
        share[NONE] = REFUTED * share.get(NONE, 0.0)
    return replace(verdict, verdict=instead, causes=(), probabilities=share)


def _claims(verdict: Verdict, gap: Closure, witnessed: Collection[str]) -> Verdict:
    together = gap.closed is not None and gap.closed.low > 0.0

    def stands(c: Cause) -> bool:
        if witnessed and set(c.names) & set(witnessed):
            return True
        return together and holds(gap.members.get(c.part.name))

    kept = tuple(c for c in verdict.causes if stands(c))
    if not kept:
        return withdrawn(verdict, NONE if small(gap) else UNKNOWN)
    if len(kept) < len(verdict.causes):
        return _leading(verdict, kept)
    most = together and gap.closed is not None and gap.closed.value >= MOST
    return verdict if most else replace(verdict, verdict=PARTIAL)


def _leading(verdict: Verdict, kept: tuple[Cause, ...]) -> Verdict:
    """The verdict with some of its causes; the probability of the leading one goes with it."""
    share = dict(verdict.probabilities)
    old, new = ("|".join(c[0].names) for c in (verdict.causes, kept))
    if old != new:
        share[new] = share.get(new, 0.0) + share.pop(old, 0.0)
    return replace(verdict, causes=kept, probabilities=share)
