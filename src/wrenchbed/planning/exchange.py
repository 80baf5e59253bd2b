"""Pose selection by exchange: Mitchell's DETMAX for any criterion, with screening by gradient.

Mitchell 1974, doi 10.1080/00401706.1974.10489175: an excursion adds d configurations, each the
best, and drops the d whose loss costs least (or the other way round); it is kept if the set became
better.

A scan of the whole pool costs one product with the gradient: the packed JᵢᵀJᵢ (N, m(m+1)/2) times
one vector. For a concave, smooth criterion that is an upper bound of the change, so that only the
few configurations whose bound exceeds the best exact value so far are evaluated, by rank-k
formulas; for the others the most promising `2 * _AT_ONCE`.

How good could any choice be? A continuous design spreads weights wᵢ, Σwᵢ = 1, over the whole pool.
For a criterion Φ that is concave and homogeneous of degree 1 in M, every set S of n different
configurations obeys Φ(M_S) ≤ ⟨∇Φ(M), M_S⟩ ≤ the sum of the n largest ⟨∇Φ(M), JᵢᵀJᵢ⟩, at any M; at
the best continuous design the bound is tight up to rounding to whole configurations (equivalence
theorem: Kiefer & Wolfowitz 1960, doi 10.4153/CJM-1960-030-4; Pukelsheim, Optimal Design of
Experiments, 2006, ch. 7).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from wrenchbed.errors import PlanError
from wrenchbed.planning.criteria import Criterion

_AT_ONCE = 64
_MOST = 1024
_BETTER = 1e-9
_DEPTH = 3
_SINGULAR = 1e15
_ROUNDS = 60
_STEPS = 150
_NEW = 60
_DROP = 1e-7
_GAP = 1e-3
"""Distance of a continuous design from the upper bound, relative, at which `certify` stops."""


class Pool:
    """N candidates: blocks (N, k, m), Jacobians of k readings by m parameters, over noise and per
    scale of a parameter."""

    def __init__(self, blocks: np.ndarray) -> None:
        self.blocks = np.ascontiguousarray(blocks, dtype=float)
        m = blocks.shape[-1]
        self._upper = np.triu_indices(m)
        self._twice = np.where(self._upper[0] == self._upper[1], 1.0, 2.0)
        self._packed = np.empty((len(blocks), len(self._twice)), dtype=np.float32)
        for start in range(0, len(blocks), 4096):
            some = self.blocks[start : start + 4096]
            full = np.swapaxes(some, -1, -2) @ some
            self._packed[start : start + 4096] = full[:, *self._upper]

    def __len__(self) -> int:
        return len(self.blocks)

    def information(self, chosen: Sequence[int] | np.ndarray) -> np.ndarray:
        """Information matrix M (m, m), the sum of JᵢᵀJᵢ over the chosen configurations."""
        rows = self.blocks[np.asarray(chosen, dtype=int)].reshape(-1, self.blocks.shape[-1])
        return rows.T @ rows

    def slopes(self, gradient: np.ndarray) -> np.ndarray:
        """Traces (N,) of gradient · JᵢᵀJᵢ of all configurations, in single precision."""
        size = np.abs(gradient).max()
        vector = (gradient[self._upper] * self._twice / size).astype(np.float32)
        return (self._packed @ vector).astype(float) * size


@dataclass(frozen=True, eq=False)
class Selection:
    """Result of `exchange`: chosen indices (n,), the criterion, its values after each exchange."""

    chosen: np.ndarray
    value: float
    history: tuple[float, ...]


def exchange(
    pool: Pool,
    criterion: Criterion,
    n: int,
    *,
    start: Sequence[int] | np.ndarray | None = None,
    prior: np.ndarray | None = None,
    seed: int = 0,
    tell: Callable[[float], None] = lambda _: None,
) -> Selection:
    """Choose n configurations that no exchange of up to `_DEPTH` of them improves (DETMAX).

    Args:
        start: indices to begin with; random if None.
        prior: information (m, m) before any measurement.
        tell: called with the criterion after each exchange.

    Raises:
        PlanError: n is not between what the parameters need and the pool's size, or no random
            start has full rank.
    """
    _, k, m = pool.blocks.shape
    if not 1 <= n <= len(pool) or (prior is None and n * k < m):
        raise PlanError(
            f"{n} configurations of {len(pool)}: {m} parameters need at least {-(-m // k)}"
        )
    base = np.zeros((m, m)) if prior is None else prior
    begin = _random_start(pool, n, base, seed) if start is None else [int(i) for i in start]
    search = _Search(pool, criterion, base)
    best, value = begin, search.value(begin)
    history = [value]
    depth = 1
    while depth <= min(_DEPTH, n):
        for add_first in (True, False):
            if add_first and n + depth > len(pool):
                continue
            trial = search.excursion(best, depth, add_first)
            new = search.value(trial)
            if new > value * (1 + _BETTER):
                best, value, depth = trial, new, 0
                history.append(value)
                tell(value)
                break
        depth += 1
    return Selection(np.array(sorted(best)), value, tuple(history))


def _random_start(pool: Pool, n: int, base: np.ndarray, seed: int) -> list[int]:
    rng = np.random.default_rng(seed)
    for _ in range(100):
        some = rng.choice(len(pool), n, replace=False)
        if np.linalg.cond(pool.information(some) + base) < _SINGULAR:
            return [int(i) for i in some]
    raise PlanError(
        f"{n} random configurations never have full rank: choose more, from a larger pool, or "
        "leave out parameters that cannot be told apart"
    )


@dataclass(frozen=True, eq=False)
class _Search:
    pool: Pool
    criterion: Criterion
    base: np.ndarray

    def value(self, chosen: list[int]) -> float:
        return float(self.criterion.values(self.pool.information(chosen) + self.base))

    def excursion(self, chosen: list[int], depth: int, add_first: bool) -> list[int]:
        steps = [True] * depth + [False] * depth
        trial = list(chosen)
        information = self.pool.information(trial) + self.base
        for add in steps if add_first else reversed(steps):
            if add:
                i = self._best_to_add(information, trial)
            else:
                without = self.criterion.changed(information, self.pool.blocks[trial], -1.0)
                i = trial[int(np.argmax(without))]
            rows = self.pool.blocks[i]
            information = information + (1.0 if add else -1.0) * rows.T @ rows
            if not add and np.linalg.cond(information) > _SINGULAR:
                return list(chosen)
            trial = [*trial, i] if add else [j for j in trial if j != i]
        return trial

    def _best_to_add(self, information: np.ndarray, chosen: list[int]) -> int:
        slope = self.pool.slopes(self.criterion.screen(information))
        slope[chosen] = -np.inf
        now = float(self.criterion.values(information))
        sure = self.criterion.smooth and self.criterion.power is not None
        most = min(_MOST if sure else 2 * _AT_ONCE, len(slope))
        order = np.argpartition(-slope, most - 1)[:most]
        order = order[np.argsort(-slope[order])]
        best, where = -np.inf, int(order[0])
        for first in range(0, len(order), _AT_ONCE):
            some = order[first : first + _AT_ONCE]
            if sure and first and now + slope[some[0]] <= best:
                break
            exact = self.criterion.changed(information, self.pool.blocks[some], 1.0)
            exact[np.isneginf(slope[some])] = -np.inf
            top = int(np.argmax(exact))
            if exact[top] > best:
                best, where = float(exact[top]), int(some[top])
        return where


@dataclass(frozen=True, eq=False)
class Certificate:
    """The best continuous design found, and the upper bound on any choice that it proves.

    Attributes:
        support: indices of the configurations with weight (K,).
        weight: (K,), sums to 1.
        bound: no n different configurations of the pool have a larger criterion.
    """

    support: np.ndarray
    weight: np.ndarray
    bound: float


def certify(pool: Pool, criterion: Criterion, n: int, start: np.ndarray) -> Certificate:
    """Bound the criterion over all choices of n different configurations.

    ``start``: indices of a set with full rank. Multiplicative weights (Silvey, Titterington &
    Torsney 1978, doi 10.1080/03610927808827719) on a growing set of candidates. A `PlanError` if
    the criterion is not concave, so that nothing can be certified this way.
    """
    power = criterion.power
    if power is None:
        raise PlanError(f"{criterion.name} is not concave: its optimum cannot be certified")

    def slopes(blocks: np.ndarray, weight: np.ndarray, of: np.ndarray) -> tuple[float, np.ndarray]:
        """Criterion^``power`` of ``blocks`` (K, k, m) with weights (K,), and its derivatives (M,)
        by the weights of other blocks ``of`` (M, k, m)."""
        rows = (blocks * np.sqrt(weight)[:, None, None]).reshape(-1, blocks.shape[-1])
        value = float(criterion.values(rows.T @ rows))
        gradient = power * value ** (power - 1.0) * criterion.gradient(rows.T @ rows)
        return value**power, ((of @ gradient) * of).sum(axis=(1, 2))

    support = np.asarray(start, dtype=int)
    best: Certificate | None = None
    weight = np.full(len(support), 1.0 / len(support))
    exponent = 1.0 if criterion.name == "O1" else 0.5
    for _ in range(_ROUNDS):
        blocks = pool.blocks[support]
        for _ in range(_STEPS):
            value, slope = slopes(blocks, weight, blocks)
            weight = _capped(weight * (slope / value) ** exponent, 1.0 / n)
        keep = weight > _DROP
        support, weight = support[keep], _capped(weight[keep], 1.0 / n)
        value, slope = slopes(pool.blocks[support], weight, pool.blocks)
        top = float(np.sort(slope)[-n:].sum())
        if best is None or top ** (1.0 / power) < best.bound:
            best = Certificate(support, weight, top ** (1.0 / power))
        if top / n / value - 1.0 < _GAP:
            break
        fresh = np.setdiff1d(np.argsort(-slope)[:_NEW], support)
        support = np.concatenate([support, fresh])
        weight = np.concatenate([weight * 0.9, np.full(len(fresh), 0.1 / max(len(fresh), 1))])
        weight = _capped(weight, 1.0 / n)
    assert best is not None
    return best


def heaviest(certificate: Certificate, n: int) -> np.ndarray:
    """Indices (≤ n,) of the n configurations of largest weight, or of all if there are fewer."""
    return certificate.support[np.argsort(-certificate.weight)[:n]]


def _capped(weight: np.ndarray, cap: float) -> np.ndarray:
    """Weights (K,) scaled to the sum 1, each at most ``cap``."""
    full = np.zeros(len(weight), dtype=bool)
    while True:
        rest = (1.0 - cap * full.sum()) / max(weight[~full].sum(), 1e-300)
        scaled = np.where(full, cap, weight * rest)
        over = ~full & (scaled > cap * (1 + 1e-12))
        if not over.any():
            return scaled
        full |= over
