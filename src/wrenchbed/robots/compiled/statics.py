"""The reading at rest, compiled (`_statics.c`) where the package was built with a C compiler.

Plain numpy computes the same and stays the reference; a test holds both together. A pose has the
same bits alone and in any batch.
"""

from typing import NamedTuple

import numpy as np

_LAYOUT = 2
"""Version of the constants' layout; a library of another version is not used. A change of the order
raises it here and in ``_statics.c`` (`LAYOUT`); then run `scripts/build_kernel.py`."""

try:
    from wrenchbed.robots.compiled import _statics

    _FUNCTIONS = {
        name: getattr(_statics, name) for name in ("chain", "medrue", "medrue_slopes")
        if _statics.LAYOUT == _LAYOUT
    }  # fmt: skip
except ImportError:  # built without a compiler
    _FUNCTIONS = {}


class Packed(NamedTuple):
    """Constants of a robot for its compiled function, for one parameter vector or R (shape …):
    gravity before the first joint (…, 3) [m/s²], rotation behind the last one (…, 3, 3), and K
    numbers (…, K) in the order of ``_statics.c``."""

    gravity: np.ndarray
    last: np.ndarray
    own: np.ndarray


def available(name: str, slopes: bool = False) -> bool:
    """Whether the compiled function ``name`` of a robot is installed, or with ``slopes`` that of
    its derivatives."""
    return (f"{name}_slopes" if slopes else name) in _FUNCTIONS


def readings(name: str, q: np.ndarray, constants: bytes) -> np.ndarray:
    """Sensor readings (…, 6) [N, N·m] at rest at q (…, J), by the function ``name``; the constants
    are a `Packed`'s numbers in the order of `_statics.c`."""
    out = np.empty((*q.shape[:-1], 6))
    _FUNCTIONS[name](np.ascontiguousarray(q), q.shape[-1], constants, out)
    return out


def slopes(name: str, q: np.ndarray, constants: bytes, changes: np.ndarray) -> np.ndarray:
    """Derivatives (K, N, 6) of `readings` at q (N, J) along K changes (K, C) of the C constants."""
    out = np.empty((len(changes), len(q), 6))
    given = np.ascontiguousarray(q), q.shape[-1], constants, out, changes.tobytes()
    _FUNCTIONS[f"{name}_slopes"](*given)
    return out
