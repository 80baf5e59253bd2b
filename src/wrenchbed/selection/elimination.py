"""The paper's choice of what to identify: drop columns one at a time by condition number.

Joubair et al. 2016, doi 10.3390/s16060798, Section 4.1, after Joubair & Bonev 2014, doi
10.1007/s00170-014-6448-9. While the Jacobian is rank-deficient its condition number is σ1 over
rounding error, so which column goes first is chance, and depends on units.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrenchbed.observability import null_space

_ZERO = 1e-13


@dataclass(frozen=True)
class Elimination:
    """Parameters dropped: those without effect, then the others in the order of their going."""

    no_effect: tuple[str, ...]
    dropped: tuple[str, ...]
    kept: tuple[str, ...]


def eliminate(jacobian: np.ndarray, names: Sequence[str]) -> Elimination:
    """The paper's procedure on a Jacobian (M, K): steps 1–4 of its Section 4.1."""
    norm = np.linalg.norm(jacobian, axis=0)
    active = norm > _ZERO * norm.max()
    columns = [int(i) for i in np.flatnonzero(active)]
    triangle = np.asarray(np.linalg.qr(jacobian[:, columns], mode="r"))
    rank = null_space(triangle / np.linalg.norm(triangle, axis=0))[0]
    dropped: list[str] = []
    left = list(range(len(columns)))
    while len(left) > rank:
        best, worst = np.inf, left[0]
        for i in left:
            rest = [j for j in left if j != i]
            scaled = triangle[:, rest] / np.linalg.norm(triangle[:, rest], axis=0)
            if null_space(scaled)[0] < rank:
                continue
            condition = float(np.linalg.cond(triangle[:, rest]))
            if condition < best:
                best, worst = condition, i
        left.remove(worst)
        dropped.append(names[columns[worst]])
    return Elimination(
        tuple(n for n, a in zip(names, active, strict=True) if not a),
        tuple(dropped),
        tuple(names[columns[i]] for i in left),
    )
