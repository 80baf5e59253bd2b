"""How good could any choice be? A certified bound from the best continuous design.

A continuous design spreads weights wᵢ, Σwᵢ = 1, over the whole pool. For a criterion Φ that is
concave and homogeneous of degree 1 in M, every set S of n different configurations obeys
Φ(M_S) ≤ ⟨∇Φ(M), M_S⟩ ≤ the sum of the n largest ⟨∇Φ(M), JᵢᵀJᵢ⟩, at any M; at the best continuous
design the bound is tight up to rounding to whole configurations (equivalence theorem: Kiefer &
Wolfowitz 1960, doi 10.4153/CJM-1960-030-4; Pukelsheim, Optimal Design of Experiments, 2006, ch. 7).
"""

from dataclasses import dataclass

import numpy as np

from wrenchbed.errors import PlanError
from wrenchbed.planning.criteria import Criterion
from wrenchbed.planning.exchange import Pool

_ROUNDS = 60
_STEPS = 150
_NEW = 60
_DROP = 1e-7


@dataclass(frozen=True, eq=False)
class Certificate:
    """The best continuous design found, and what it proves.

    Attributes:
        support: configurations with weight (K,).
        weight: (K,), sums to 1.
        bound: no n different configurations of the pool have a larger criterion.
    """

    support: np.ndarray
    weight: np.ndarray
    bound: float


def certify(
    pool: Pool, criterion: Criterion, n: int, start: np.ndarray, *, gap: float = 1e-3
) -> Certificate:
    """Bound the criterion over all choices of n different configurations.

    Multiplicative weights (Silvey, Titterington & Torsney 1978, doi 10.1080/03610927808827719) on
    a growing set of candidates; the whole pool is scanned once a round.

    Args:
        start: configurations to begin with, of full rank.
        gap: stop when the continuous design is this close to the best.

    Raises:
        PlanError: the criterion is not concave, so nothing can be certified this way.
    """
    if criterion.power is None:
        raise PlanError(f"{criterion.name} is not concave: its optimum cannot be certified")
    support = np.asarray(start, dtype=int)
    weight = np.full(len(support), 1.0 / len(support))
    best: Certificate | None = None
    for _ in range(_ROUNDS):
        weight = _improve(pool, criterion, support, weight, 1.0 / n)
        keep = weight > _DROP
        support, weight = support[keep], _capped(weight[keep], 1.0 / n)
        rows = pool.blocks[support] * np.sqrt(weight)[:, None, None]
        information = np.einsum("nki,nkj->ij", rows, rows)
        value, gradient = _homogeneous(criterion, information)
        slope = _slopes(pool, gradient)
        top = float(np.sort(slope)[-n:].sum())
        short = top / n / value - 1
        bound = top ** (1 / criterion.power)
        if best is None or bound < best.bound:
            best = Certificate(support, weight, bound)
        if short < gap:
            break
        fresh = np.setdiff1d(np.argsort(-slope)[:_NEW], support)
        support = np.concatenate([support, fresh])
        weight = np.concatenate([weight * 0.9, np.full(len(fresh), 0.1 / max(len(fresh), 1))])
        weight = _capped(weight, 1.0 / n)
    assert best is not None
    return best


def rounded(certificate: Certificate, n: int) -> np.ndarray:
    """The n configurations of largest weight (fewer if the support is smaller)."""
    return certificate.support[np.argsort(-certificate.weight)[:n]]


def _improve(
    pool: Pool, criterion: Criterion, support: np.ndarray, weight: np.ndarray, cap: float
) -> np.ndarray:
    blocks = pool.blocks[support]
    rows = blocks.reshape(-1, blocks.shape[-1])
    share = 1.0 if criterion.name == "O1" else 0.5
    for _ in range(_STEPS):
        information = (rows * np.repeat(weight, blocks.shape[1])[:, None]).T @ rows
        value, gradient = _homogeneous(criterion, information)
        slope = ((rows @ gradient) * rows).sum(axis=1).reshape(len(support), -1).sum(axis=1)
        weight = _capped(weight * (slope / value) ** share, cap)
    return weight


def _capped(weight: np.ndarray, cap: float) -> np.ndarray:
    """Weights scaled to sum 1 with none above the cap."""
    full = np.zeros(len(weight), dtype=bool)
    while True:
        left = 1.0 - cap * full.sum()
        scaled = np.where(full, cap, weight * left / max(weight[~full].sum(), 1e-300))
        over = ~full & (scaled > cap * (1 + 1e-12))
        if not over.any():
            return scaled
        full |= over


def _homogeneous(criterion: Criterion, information: np.ndarray) -> tuple[float, np.ndarray]:
    """The criterion to its power, and the gradient of that."""
    value = float(criterion.values(information))
    power = criterion.power or 1.0
    return value**power, power * value ** (power - 1) * criterion.gradient(information)


def _slopes(pool: Pool, gradient: np.ndarray) -> np.ndarray:
    """trace(gradient · JᵢᵀJᵢ) (N,) in double precision: a bound must hold."""
    m = pool.blocks.shape[-1]
    result = np.empty(len(pool))
    for start in range(0, len(pool), 4096):
        rows = pool.blocks[start : start + 4096].reshape(-1, m)
        each = ((rows @ gradient) * rows).sum(axis=1)
        result[start : start + 4096] = each.reshape(-1, pool.blocks.shape[1]).sum(axis=1)
    return result
