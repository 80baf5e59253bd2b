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
    power = criterion.power
    if power is None:
        raise PlanError(f"{criterion.name} is not concave: its optimum cannot be certified")

    def slopes(blocks: np.ndarray, weight: np.ndarray, of: np.ndarray) -> tuple[float, np.ndarray]:
        """The criterion to its power of weighted blocks, and its slopes (M,) by blocks ``of``."""
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
        if top / n / value - 1.0 < gap:
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


def _capped(weight: np.ndarray, cap: float) -> np.ndarray:
    """Weights scaled to sum 1 with none above the cap."""
    full = np.zeros(len(weight), dtype=bool)
    while True:
        rest = (1.0 - cap * full.sum()) / max(weight[~full].sum(), 1e-300)
        scaled = np.where(full, cap, weight * rest)
        over = ~full & (scaled > cap * (1 + 1e-12))
        if not over.any():
            return scaled
        full |= over
