"""Random draws that many faults share."""

import numpy as np

from wrenchbed.wrench import CHANNELS


def sign(rng: np.random.Generator) -> float:
    """−1 or 1."""
    return float(rng.choice([-1.0, 1.0]))


def about(rng: np.random.Generator, value: float, spread: float = 0.2) -> float:
    """A value within a factor of exp(±2 spread) or so."""
    return float(value * np.exp(spread * np.clip(rng.standard_normal(), -2.0, 2.0)))


def direction(rng: np.random.Generator) -> np.ndarray:
    """A unit vector (3,)."""
    v = rng.standard_normal(3)
    return np.asarray(v / np.linalg.norm(v))


def touched(rng: np.random.Generator) -> np.ndarray:
    """Signed weights (6,) of channels: one, two, three of a kind or all; the largest is ±1."""
    few = int(rng.choice([1, 2, 3, 6], p=[0.45, 0.2, 0.15, 0.2]))
    chosen = np.zeros(6, dtype=bool)
    if few == 3:
        chosen[:3] = rng.uniform() < 0.5
        chosen[3:] = not chosen[0]
    else:
        chosen[rng.choice(6, few, replace=False)] = True
    weight = chosen * rng.uniform(0.4, 1.0, 6) * rng.choice([-1.0, 1.0], 6)
    return np.asarray(weight / np.abs(weight).max())


def by_channel(values: np.ndarray, stem: str) -> dict[str, float]:
    """``stem.fx`` … of what is not 0."""
    pairs = zip(CHANNELS, values.tolist(), strict=True)
    return {f"{stem}.{c}": float(v) for c, v in pairs if v != 0.0}
