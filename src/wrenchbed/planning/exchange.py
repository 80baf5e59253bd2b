"""Pose selection by exchange: Mitchell's DETMAX for any criterion, with screening by gradient.

Mitchell 1974, doi 10.1080/00401706.1974.10489175: an excursion adds d configurations, each the
best, and drops the d whose loss costs least (or the other way round); it is kept if the set became
better.

A scan of the whole pool costs one product with the gradient: the packed JᵢᵀJᵢ (N, m(m+1)/2) times
one vector. For some criteria that is an upper bound of the change, so that only the
few configurations whose bound exceeds the best exact value so far are evaluated, by rank-k
formulas; for the others the most promising `2 * _AT_ONCE`.
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
        sure = self.criterion.bounds
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
