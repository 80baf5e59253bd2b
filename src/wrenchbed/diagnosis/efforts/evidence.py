"""Evidence of structures: a Gaussian model in closed form, with every effect a little present.

y = X a + white noise, a ~ N(0, D). A structure gives the columns of its causes wide priors; all
others keep their small ones. Woodbury's identity makes each structure a problem of its own columns
only (MacKay 2003, "Information Theory, Inference, and Learning Algorithms", Chapter 28).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from wrenchbed.diagnosis.efforts.dictionary import Dictionary

AMPLITUDE = 6.0
"""Rms that a named cause adds a priori, in noises of a row: twice what just counts; estimate."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """The Gaussian model of weighted blocks of time.

    Attributes:
        d: the columns.
        weight: of each block (B,).
        misfit: factor on the noise variance of each joint that structures leave (J,), at least 1.
    """

    d: Dictionary
    weight: np.ndarray
    misfit: float = 1.0

    @cached_property
    def products(self) -> tuple[np.ndarray, np.ndarray]:
        """Weighted products XᵀX (P, P) and Xᵀy (P,) of columns X and torque residual y."""
        gram = np.tensordot(self.weight, self.d.gram, axes=1) / self.misfit
        return gram, self.weight @ self.d.right / self.misfit

    @cached_property
    def background(self) -> tuple[np.ndarray, np.ndarray]:
        """Covariance (P, P) and mean (P,) of all amplitudes where no cause is free."""
        gram, right = self.products
        std = self.d.std
        scaled = gram * np.outer(std, std) + np.eye(len(std))
        inverse = np.linalg.inv(scaled)
        covariance = 0.5 * (inverse + inverse.T) * np.outer(std, std)
        return covariance, covariance @ right

    def freed(self, blocks: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
        """Indices of the columns (K,) that some causes set free, and the loss of their prior
        precision (K,)."""
        at = np.unique(np.concatenate([self.d.at[b] for b in blocks]))
        wide = np.maximum(AMPLITUDE / np.maximum(self.d.size[at], 1e-12), self.d.std[at])
        return at, self.d.std[at] ** -2.0 - wide**-2.0

    def log(self, blocks: Sequence[int]) -> float:
        """Log evidence of a structure (indices of blocks) over that of the background alone."""
        if not blocks:
            return 0.0
        at, less = self.freed(blocks)
        covariance, mean = self.background
        c, m = covariance[np.ix_(at, at)], mean[at]
        inner = np.eye(len(at)) - c * less
        sign, size = np.linalg.slogdet(inner)
        if sign <= 0.0:
            return -np.inf
        wide = np.maximum(AMPLITUDE / np.maximum(self.d.size[at], 1e-12), self.d.std[at])
        prior = float(np.log(self.d.std[at] / wide).sum())
        return prior - 0.5 * float(size) + 0.5 * float((m * less) @ np.linalg.solve(inner, m))

    def amplitudes(self, blocks: Sequence[int]) -> np.ndarray:
        """Posterior mean (P,) of all amplitudes under a structure."""
        covariance, mean = self.background
        if not blocks:
            return mean
        at, less = self.freed(blocks)
        inner = np.eye(len(at)) - covariance[np.ix_(at, at)] * less
        gain = less[:, None] * np.linalg.inv(inner)
        return np.asarray(mean + covariance[:, at] @ (gain @ mean[at]))

    def covariance(self, blocks: Sequence[int]) -> np.ndarray:
        """Covariance (K, K) of the amplitudes that are free, in the order of `freed`."""
        at, less = self.freed(blocks)
        c = self.background[0][np.ix_(at, at)]
        return np.asarray(np.linalg.solve(np.eye(len(at)) - c * less, c))


def whole(d: Dictionary, misfit: float = 1.0) -> Evidence:
    """Evidence from all rows of a dictionary."""
    return Evidence(d, np.ones(len(d.gram)), misfit)


def left_square(d: Dictionary, x: np.ndarray, blocks: np.ndarray | None = None) -> float:
    """Sum of squares of the whitened residual beside amplitudes (P,), over some blocks of time;
    over all if None."""
    use = np.arange(len(d.gram)) if blocks is None else blocks
    gram, right = d.gram[use].sum(axis=0), d.right[use].sum(axis=0)
    return float(d.square[use].sum() - 2.0 * x @ right + x @ gram @ x)
