"""Parts of a finalist: what each adds, and what is left without it."""

from collections.abc import Collection

import numpy as np

from wrenchbed.diagnosis.finalist import Finalist
from wrenchbed.diagnosis.refit import Refitter

CLAIMABLE = 0.75
"""Gap that a cause must add, as estimated: 1 by definition, less its uncertainty."""


def without(refitter: Refitter, f: Finalist, parts: Collection[int]) -> np.ndarray:
    """Variables (k,) of a finalist with the amplitudes of some parts set to nothing."""
    gone = f.x.copy()
    for i, (k, _, shape) in enumerate(refitter.variables(f.parts)):
        if k in parts and not shape:
            gone[i] = 0.0
    return gone


def share(refitter: Refitter, f: Finalist, part: int) -> float:
    """How much smaller the gap is with one part than without it, the others as they are."""
    gone = without(refitter, f, [part])
    own = refitter.response(f.parts, f.x) - refitter.response(f.parts, gone)
    return refitter.d.gap(f.residual + own) - refitter.d.gap(f.residual)


def rest(refitter: Refitter, f: Finalist, large: set[int | None]) -> float:
    """Gap that the large parts of a finalist leave, beyond the noise."""
    d = refitter.d
    gone = without(refitter, f, [k for k in range(len(f.parts)) if k not in large])
    minor = refitter.response(f.parts, f.x) - refitter.response(f.parts, gone)
    return d.gap(f.residual + minor) - float(d.prepared.variance.mean())


def alone(refitter: Refitter, f: Finalist, part: int) -> np.ndarray:
    """What one part adds to the readings (6 R,), whitened, the others as they are."""
    made = refitter.response(f.parts, f.x)
    return np.asarray(made - refitter.response(f.parts, without(refitter, f, [part])))
