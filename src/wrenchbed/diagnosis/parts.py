"""Parts of a finalist: what each adds, and what is left without it."""

from collections.abc import Collection

import numpy as np

from wrenchbed.diagnosis.finalist import Finalist
from wrenchbed.diagnosis.refit import Refitter

CLAIMABLE = 0.75
"""Gap that a cause must add, as estimated: 1 by definition, less its uncertainty."""


def _without(refitter: Refitter, f: Finalist, parts: Collection[int]) -> np.ndarray:
    """Variables (k,) of a finalist with the amplitudes of some parts set to nothing."""
    gone = f.x.copy()
    for i, (k, _, shape) in enumerate(refitter.variables(f.parts)):
        if k in parts and not shape:
            gone[i] = 0.0
    return gone


def made_by(refitter: Refitter, f: Finalist, parts: Collection[int]) -> np.ndarray:
    """What some parts add to the readings (6 R,), whitened, the others as they are."""
    gone = refitter.response(f.parts, _without(refitter, f, parts))
    return np.asarray(refitter.response(f.parts, f.x) - gone)


def share(refitter: Refitter, f: Finalist, part: int) -> float:
    """How much smaller the gap is with one part than without it, the others as they are."""
    own = made_by(refitter, f, [part])
    return refitter.d.gap(f.residual + own) - refitter.d.gap(f.residual)


def rest(refitter: Refitter, f: Finalist, large: set[int | None]) -> float:
    """Gap that the large parts of a finalist leave, beyond the noise."""
    d = refitter.d
    minor = made_by(refitter, f, [k for k in range(len(f.parts)) if k not in large])
    return d.gap(f.residual + minor) - float(d.prepared.variance.mean())
