"""A random search over shapes that act by jumps, where slopes do not show the way."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from wrenchbed.diagnosis.dictionary import Hypothesis
from wrenchbed.diagnosis.evidence import Level

_TRIALS = 160
"""Shapes that are tried, from wide steps to narrow ones."""


class Responding(Protocol):
    """What knows the readings y (6 R,) and how structures respond."""

    y: np.ndarray

    def variables(self, parts: Sequence[Hypothesis]) -> list[tuple[int, str, bool]]: ...

    def response(self, parts: Sequence[Hypothesis], x: np.ndarray) -> np.ndarray: ...


def polished(
    refitter: Responding, level: Level, parts: Sequence[Hypothesis], x: np.ndarray
) -> np.ndarray:
    """Shapes of the last part after a random search, its amplitudes fitted along (k,)."""
    names, last = refitter.variables(parts), len(parts) - 1
    moves = np.array([shape and k == last for k, _, shape in names])
    own = np.array([not shape and k == last for k, _, shape in names])
    rng = np.random.default_rng(0)

    others = np.where(own, 0.0, x)
    rest = refitter.y - refitter.response(parts, others)  # parts hardly meddle with each other
    solved_rest = level.solve(rest[:, None])[:, 0]
    first = len(x) - int((own | moves).sum())

    def fitted(at: np.ndarray) -> tuple[float, np.ndarray]:
        """What is left with the best amplitudes of the part, and these."""
        columns = []
        for i in np.flatnonzero(own):
            unit = np.where(own, 0.0, at)
            unit[i] = 1.0
            columns.append(refitter.response(parts[last:], unit[first:]))
        design = np.stack(columns, axis=1)
        solved = level.solve(design)
        normal = design.T @ solved + 1e-3 * np.eye(design.shape[1])
        score = design.T @ solved_rest
        best = np.linalg.solve(normal, score)
        found = at.copy()
        found[own] = best
        return float(rest @ solved_rest - score @ best), found

    now, x = fitted(x)
    for k in range(_TRIALS):
        spread = 3.0 * 0.5 ** (5.0 * k / _TRIALS)
        trial = x + np.where(moves, spread * rng.standard_normal(len(x)), 0.0)
        then, found = fitted(trial)
        if then < now:
            now, x = then, found
    return x
