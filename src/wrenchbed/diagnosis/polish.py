"""A random search over shapes that act by jumps, where slopes do not show the way."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from wrenchbed.diagnosis.dictionary import Hypothesis
from wrenchbed.diagnosis.evidence import Level

_TRIALS = 60
"""Shapes that are tried, from wide steps to narrow ones."""


class Responding(Protocol):
    """What knows the readings y (6 R,) and how structures respond."""

    y: np.ndarray

    def variables(self, parts: Sequence[Hypothesis]) -> list[tuple[int, str, bool]]: ...

    def response(self, parts: Sequence[Hypothesis], x: np.ndarray) -> np.ndarray: ...


def polished(
    refitter: Responding, level: Level, parts: Sequence[Hypothesis], x: np.ndarray
) -> np.ndarray:
    """Shapes of rough effects after a random search, amplitudes of all fitted along (k,)."""
    names = refitter.variables(parts)
    moves = np.array([shape and parts[k].effect.rough for k, _, shape in names])
    own = np.array([not shape and parts[k].effect.rough for k, _, shape in names])
    rng = np.random.default_rng(0)

    def fitted(at: np.ndarray) -> tuple[float, np.ndarray]:
        """What is left with the best amplitudes of the rough parts, and these."""
        none = np.where(own, 0.0, at)
        rest = refitter.y - refitter.response(parts, none)
        columns = []
        for i in np.flatnonzero(own):
            unit = none.copy()
            unit[i] = 1.0
            columns.append(refitter.y - rest - refitter.response(parts, unit))
        design = -np.stack(columns, axis=1)
        solved = level.solve(np.column_stack([design, rest]))
        normal = design.T @ solved[:, :-1] + 1e-3 * np.eye(design.shape[1])
        score = design.T @ solved[:, -1]
        best = np.linalg.solve(normal, score)
        found = none.copy()
        found[own] = best
        return float(rest @ solved[:, -1] - score @ best), found

    now, x = fitted(x)
    for k in range(_TRIALS):
        spread = 3.0 * 0.5 ** (5.0 * k / _TRIALS)
        trial = x + np.where(moves, spread * rng.standard_normal(len(x)), 0.0)
        then, found = fitted(trial)
        if then < now:
            now, x = then, found
    return x
