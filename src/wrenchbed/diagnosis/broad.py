"""Broad hypotheses take the signal of special ones: the special ones get their chance beside them.

A crosstalk of all channels can be a turned sensor and five gains as well, at the price of thirty
numbers. Alone it fits better than any of them as soon as small imperfections matter too; beside
one of them it need only be small, and the evidence of both together tells which is right.
"""

from collections.abc import Sequence

import numpy as np

from wrenchbed.diagnosis.dictionary import STATED, Hypothesis
from wrenchbed.diagnosis.finalist import Finalist
from wrenchbed.diagnosis.refit import Refitter
from wrenchbed.diagnosis.search import Single

BROAD = 6
"""Columns from which a hypothesis counts as broad."""
SPECIAL = 5
"""How many special ones are tried beside it; a wrong mass is one of them, a bias is not."""


def beside(refitter: Refitter, f: Finalist, singles: Sequence[Single]) -> list[Finalist]:
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
