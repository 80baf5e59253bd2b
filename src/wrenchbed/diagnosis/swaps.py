"""Rivals: what else could stand in the place of each part of the best explanation."""

from collections.abc import Sequence

import numpy as np

from wrenchbed.diagnosis.dictionary import STATED
from wrenchbed.diagnosis.finalist import Finalist
from wrenchbed.diagnosis.refit import Refitter
from wrenchbed.diagnosis.search import Single

NEAR = 12.0
"""A rival is refitted if its linear evidence is so near that of the part it replaces (natural
logarithm)."""
MOST = 3
"""Rivals refitted for each part."""


def swapped(
    refitter: Refitter, f: Finalist, parts: Sequence[int], singles: Sequence[Single]
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
        more: Sequence[Single] = singles
        base = None
        if rest:
            keep = [i for i, (p, _, _) in enumerate(refitter.variables(f.parts)) if p != k]
            base = refitter.at(rest, f.rung, f.x[keep], f.spread[keep])
            more = refitter.added(base)
        for s in _near(refitter, more, f, k):
            h = refitter.searcher.hypotheses[s.index]
            found.append(refitter.fit((h,), s.rung) if base is None else refitter.extended(base, h))
    return found


def _near(refitter: Refitter, more: Sequence[Single], f: Finalist, part: int) -> list[Single]:
    """The best variant of each other effect, if it comes near the part itself."""
    hypotheses, own = refitter.searcher.hypotheses, f.parts[part].name
    best: dict[str, Single] = {}
    for s in more:
        if s.index >= 0:
            name = hypotheses[s.index].name
            if name not in best or s.log_posterior > best[name].log_posterior:
                best[name] = s
    mark = best[own].log_posterior if own in best else -np.inf
    others = [s for n, s in best.items() if n not in f.names and n not in STATED]
    others = [s for s in others if s.log_posterior > mark - NEAR]
    return sorted(others, key=lambda s: -s.log_posterior)[:MOST]
