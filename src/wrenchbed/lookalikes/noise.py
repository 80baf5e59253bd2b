"""Noise of rows: heavy tails, memory, correlation between channels and a slow wander."""

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from wrenchbed.lookalikes.design import Design
from wrenchbed.lookalikes.memory import slow_noise

WANDER = 0.3
"""Largest rms of the wander between holds in noises of one row: a gap below 0.1."""


@dataclass(frozen=True, eq=False)
class Law:
    """How one robot's rows scatter, in units of ``noise_std``.

    Attributes:
        level: per channel (6,), about 1.
        tails: share of rows that are Student-t with ``freedom`` degrees of freedom.
        freedom: 4 to 8.
        memory: share of the variance that is AR(1) with coefficient ``keep``.
        keep: 0 to 0.6.
        mixing: (6, 6) root of the correlation between channels.
        wander: rms of the wander per channel (6,).
    """

    level: np.ndarray
    tails: float
    freedom: float
    memory: float
    keep: float
    mixing: np.ndarray
    wander: np.ndarray


def law(rng: np.random.Generator) -> Law:
    """A random law."""
    lean = 0.25 * rng.standard_normal((6, 6))
    root = np.eye(6) + lean
    root = root / np.linalg.norm(root, axis=1, keepdims=True)
    return Law(
        level=rng.uniform(0.95, 1.05, 6),
        tails=rng.uniform(0.0, 0.7),
        freedom=rng.uniform(4.0, 8.0),
        memory=rng.uniform(0.0, 0.6),
        keep=rng.uniform(0.0, 0.6),
        mixing=root,
        wander=rng.uniform(0.0, WANDER) * rng.uniform(0.6, 1.0, 6),
    )


def rows(design: Design, law: Law, rng: np.random.Generator, samples: int) -> np.ndarray:
    """Noise (H, samples, 6) [N, N·m], without the wander; in motion one run of all rows."""
    count = len(design)
    shape = (1, count, 6) if design.moving else (count, samples, 6)
    white = rng.standard_normal(shape)
    heavy = rng.uniform(size=shape[:2]) < law.tails
    spread = np.sqrt((law.freedom - 2.0) / rng.chisquare(law.freedom, shape[:2]))
    white *= np.where(heavy, spread, 1.0)[..., None]
    kicks = rng.standard_normal(shape) * np.sqrt(1.0 - law.keep**2)
    start = law.keep * rng.standard_normal((shape[0], 1, 6))
    slow = lfilter([1.0], [1.0, -law.keep], kicks, axis=1, zi=start)[0]
    unit = np.sqrt(1.0 - law.memory) * white + np.sqrt(law.memory) * slow
    mixed = unit @ law.mixing.T * (law.level * design.noise_std)
    return mixed.reshape(count, -1, 6)


def of_means(design: Design, law: Law, rng: np.random.Generator, samples: int) -> np.ndarray:
    """Noise of the means of ``samples`` rows (H, 6), without the wander."""
    n, a = samples, law.keep
    together = (1.0 + a) / (1.0 - a) - 2.0 * a * (1.0 - a**n) / (n * (1.0 - a) ** 2)
    variance = ((1.0 - law.memory) + law.memory * together) / n
    unit = rng.standard_normal((len(design), 6)) @ law.mixing.T
    return np.asarray(np.sqrt(variance) * unit * law.level * design.noise_std)


def wander(design: Design, law: Law, rng: np.random.Generator) -> np.ndarray:
    """1/f wander (N, 6) [N, N·m] over the run."""
    return slow_noise(rng, len(design), 6) * law.wander * design.noise_std
