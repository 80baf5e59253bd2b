"""Which way an accelerometer sits: its columns compared with what the forces say it must read."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations
from typing import Any

import numpy as np

_LEAST = 0.2
"""Least correlation of each axis: 25 rows of noise reach 1/√25 by chance."""
_LATEST_S, _STEP_S = 0.025, 2e-4
"""Largest delay of the search and its step [s]."""
_WORTH = 0.05
"""A delay must raise the sum of the three correlations by so much: noise alone prefers some delay
by a little, and a clock without one shall stay as it is."""
_IN_G = 4.0
"""Readings that are this much smaller than the forces say are in g and not in m/s²."""


@dataclass(frozen=True)
class Axes:
    """Orientation of an accelerometer on the sensor.

    Attributes:
        column: number of the column for each axis of the sensor.
        sign: of each.
        unit: of all.
        late: by how much its clock is late [s].
        score: sum of the three correlations.
    """

    column: tuple[int, ...]
    sign: tuple[int, ...]
    unit: str
    score: float
    late: float = 0.0

    def columns(self, names: Sequence[str]) -> dict[str, dict[str, Any]]:
        """Entries ax, ay, az of a column map."""
        entries = {}
        for axis, column, sign in zip("xyz", self.column, self.sign, strict=True):
            turn = {"sign": -1} if sign < 0 else {}
            entries[f"a{axis}"] = {"column": names[column], "unit": self.unit} | turn
        return entries


def match_axes(wanted: np.ndarray, read: np.ndarray) -> Axes | None:
    """The axes of an accelerometer; None if it does not follow the forces.

    Args:
        wanted: −force/mass in sensor axes (N, 3) [m/s²], whatever its zero.
        read: columns of the accelerometer (N, 3).
    """
    wanted, read = wanted - wanted.mean(axis=0), read - read.mean(axis=0)
    power, own = (wanted**2).sum(axis=0), (read**2).sum(axis=0)
    alike = wanted.T @ read / np.maximum(np.sqrt(np.outer(power, own)), 1e-12)
    order = max(
        permutations(range(3)), key=lambda p: sum(abs(alike[i, j]) for i, j in enumerate(p))
    )
    values = [alike[i, j] for i, j in enumerate(order)]
    if min(map(abs, values)) < _LEAST:
        return None
    ratio = np.sqrt(power.sum() / max(float(own.sum()), 1e-12))
    unit = "g" if ratio > _IN_G else "m/s²"
    return Axes(order, tuple(1 if v > 0 else -1 for v in values), unit, float(np.abs(values).sum()))


def match_on_clocks(
    t: np.ndarray, wanted: np.ndarray, own: np.ndarray, read: np.ndarray
) -> Axes | None:
    """`match_axes` of two clocks [s], the accelerometer's perhaps late.

    Args:
        t: of the forces (N,).
        wanted: −force/mass (N, 3) [m/s²].
        own: of the accelerometer (M,).
        read: its columns (M, 3).
    """
    inside = (t > own[0] + _LATEST_S) & (t < own[-1] - _LATEST_S)
    t, wanted = t[inside], wanted[inside]
    if len(t) < 10:
        return None

    def at(late: float) -> Axes | None:
        moved = np.stack([np.interp(t + late, own, r) for r in read.T], axis=1)
        return match_axes(wanted, moved)

    plain = at(0.0)
    steps = np.arange(-_LATEST_S, _LATEST_S + _STEP_S / 2, _STEP_S)
    matches = [(axes.score, late, axes) for late in steps if (axes := at(float(late))) is not None]
    if not matches:
        return plain
    score, late, axes = max(matches, key=lambda f: f[0])
    if plain is not None and score < plain.score + _WORTH:
        return plain
    return Axes(axes.column, axes.sign, axes.unit, score, float(late))
