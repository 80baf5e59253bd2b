"""The reading at rest, compiled (`_statics.c`) where the package was built with a C compiler.

Plain numpy computes the same and stays the reference; a test holds both together. A pose has the
same bits alone and in any batch.
"""

from typing import NamedTuple

import numpy as np

_LAYOUT = 2
"""Version of the constants' layout, by definition: a library built from another version is not
used."""

try:
    from wrenchbed.robots.compiled import _statics

    _FUNCTIONS = {
        name: getattr(_statics, name) for name in ("chain", "medrue", "medrue_slopes")
        if _statics.LAYOUT == _LAYOUT
    }  # fmt: skip
except ImportError:  # built without a compiler
    _FUNCTIONS = {}


class Packed(NamedTuple):
    """A robot's numbers at rest, for one parameter vector or R of them (leading axis …): gravity in
    axes before the first joint (…, 3) [m/s²], rotation behind the last joint (…, 3, 3), and K
    further numbers of the robot's function (…, K)."""

    gravity: np.ndarray
    last: np.ndarray
    own: np.ndarray


def available(name: str, slopes: bool = False) -> bool:
    """Whether a function, or (``slopes``) its derivatives, are compiled in this installation."""
    return (f"{name}_slopes" if slopes else name) in _FUNCTIONS


def readings(name: str, q: np.ndarray, constants: bytes) -> np.ndarray:
    """Readings (…, 6) [N, N·m] at joint values (…, J); constants in the order of `_statics.c`."""
    out = np.empty((*q.shape[:-1], 6))
    _FUNCTIONS[name](np.ascontiguousarray(q), q.shape[-1], constants, out)
    return out


def slopes(name: str, q: np.ndarray, constants: bytes, changes: np.ndarray) -> np.ndarray:
    """Changes (K, N, 6) of `readings` at (N, J) as the constants change by (K, C)."""
    out = np.empty((len(changes), len(q), 6))
    given = np.ascontiguousarray(q), q.shape[-1], constants, out, changes.tobytes()
    _FUNCTIONS[f"{name}_slopes"](*given)
    return out
