"""What data can identify: rank, and null directions by parameter name."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

RANK_TOLERANCE = 1e-10
"""Singular values below this share of the largest count as zero; exact Jacobians leave 1e-15."""
_ZERO_COLUMN = 1e-13
_SMALL = 1e-6


@dataclass(frozen=True)
class Redundancy:
    """A combination of parameters that no reading depends on.

    Attributes:
        names: the parameters that change together.
        direction: change of each, in the order of ``names`` and its unit, that no reading shows.
    """

    names: tuple[str, ...]
    direction: tuple[float, ...]
    sentence: str

    def to_json(self) -> dict[str, Any]:
        """Convert to an entry of ``redundancies`` in ``fit.json`` and in a study's results."""
        names, direction = list(self.names), list(self.direction)
        return {"parameters": names, "direction": direction, "sentence": self.sentence}


class Observability:
    """What readings determine: rank, singular values and null space of their scaled Jacobian.

    Args:
        jacobian: derivatives of whitened readings by the parameters (M, N).
        names: names of these parameters.
        scale: typical size of each parameter (N,), in its unit.

    Attributes:
        rank, singular_values: of the scaled Jacobian.
        no_effect: names of the parameters that change no reading.
        scale: typical size of each of the K other parameters (K,), in its unit.
        basis: orthonormal null space of the K scaled parameters (K, D).
        symmetries: name → null direction (parameter → change), each to be confirmed by ``basis``.
    """

    def __init__(
        self, jacobian: np.ndarray, names: Sequence[str], scale: np.ndarray,
        symmetries: Mapping[str, Mapping[str, float]] | None = None,
    ) -> None:  # fmt: skip
        scaled = jacobian * scale
        norm = np.linalg.norm(scaled, axis=0)
        active = norm > _ZERO_COLUMN * max(norm.max(initial=0.0), 1e-300)
        kept = np.flatnonzero(active)
        self.names, self.scale, self.symmetries = tuple(names), scale[kept], symmetries or {}
        self.no_effect = tuple(n for n, a in zip(names, active, strict=True) if not a)
        self.rank, self.singular_values, self.basis = null_space(scaled[:, kept])

    @cached_property
    def redundancies(self) -> tuple[Redundancy, ...]:
        """Null directions as combinations of named parameters: confirmed symmetries, then sparse
        ones. Computed on first use, because it is slow."""
        names = [n for n in self.names if n not in self.no_effect]
        chosen: list[tuple[str, np.ndarray]] = []
        known = [
            (text, np.array([direction.get(n, 0.0) for n in names]) / self.scale)
            for text, direction in self.symmetries.items()
        ]
        confirmed = [
            (text, x / np.abs(x).max()) for text, x in known if x.any() and _in_span(x, self.basis)
        ]
        for text, x in (*confirmed, *(("", x) for x in _sparsest(self.basis))):
            before = np.array([taken for _, taken in chosen]).reshape(-1, len(names))
            span = np.linalg.qr(before.T)[0]
            if len(chosen) < self.basis.shape[1] and not _in_span(x, span):
                chosen.append((text, x))
        redundancies = [_redundancy(x * self.scale, names, text) for text, x in chosen]
        return tuple(sorted(redundancies, key=lambda r: len(r.names)))


def null_space(jacobian: np.ndarray) -> tuple[int, np.ndarray, np.ndarray]:
    """Rank, singular values, orthonormal null space (K, K − rank) of a scaled Jacobian (M, K)."""
    triangle = np.linalg.qr(jacobian, mode="r") if len(jacobian) > jacobian.shape[1] else jacobian
    _, s, vt = np.linalg.svd(triangle)
    rank = int((s > RANK_TOLERANCE * s[0]).sum()) if len(s) and s[0] > 0 else 0
    return rank, s, vt[rank:].T


def _in_span(x: np.ndarray, basis: np.ndarray) -> bool:
    return bool(np.linalg.norm(x - basis @ (basis.T @ x)) < _SMALL * np.linalg.norm(x))


def _sparsest(basis: np.ndarray) -> list[np.ndarray]:
    """Sparse vectors in the null space ``basis`` (K, D): for each parameter that it moves, the
    vector of least 1-norm that moves this one by 1, scaled to a largest entry of 1; the sparsest
    first.

    Minimum 1-norm as a proxy for fewest entries: Donoho 2006, doi 10.1002/cpa.20132.
    """
    from scipy.optimize import linprog  # slow to load: only when it is used

    n, k = basis.shape
    candidates = []
    cost = np.concatenate([np.zeros(k), np.ones(n)])
    above = np.block([[basis, -np.eye(n)], [-basis, -np.eye(n)]])
    for i in range(n):
        if np.abs(basis[i]).max(initial=0.0) < _SMALL:
            continue
        fixed = np.concatenate([basis[i], np.zeros(n)])[None]
        bounds = [(None, None)] * k + [(0.0, None)] * n
        answer = linprog(cost, above, np.zeros(2 * n), fixed, [1.0], bounds, method="highs")
        if answer.x is not None:
            x = basis @ answer.x[:k]
            x[np.abs(x) < _SMALL * np.abs(x).max()] = 0.0
            candidates.append(x / np.abs(x).max())
    return sorted(candidates, key=lambda x: (np.count_nonzero(x), -np.abs(x).sum()))


def _redundancy(direction: np.ndarray, names: Sequence[str], text: str) -> Redundancy:
    direction = direction / np.abs(direction).max()
    used = np.flatnonzero(np.abs(direction) > _SMALL)
    part, who = direction[used], [names[int(i)] for i in used]
    part = part * np.sign(part[0])
    return Redundancy(tuple(who), tuple(float(x) for x in part), _sentence(part, who, text))


def _sentence(part: np.ndarray, who: list[str], text: str) -> str:
    if text:
        return f"{text} changes no reading ({', '.join(who)})"
    if len(who) == 2 and abs(abs(part[0]) - abs(part[1])) < 1e-6:
        if part[0] * part[1] > 0:
            return f"{who[0]} and {who[1]} enter only as their difference {who[1]} − {who[0]}"
        return f"{who[0]} and {who[1]} enter only as their sum {who[0]} + {who[1]}"
    terms = " ".join(f"{x:+.3g}·{n}" for x, n in zip(part, who, strict=True))
    return f"{', '.join(who)} enter only together: the change {terms} alters no reading"
