"""Gaps of simulators on the held-out rows of a recording, which took part in no fit."""

import numpy as np

from wrenchbed.diagnosis.prepare.noise import noise_in_motion
from wrenchbed.diagnosis.prepare.prepared import Prepared


class HeldOut:
    """Gaps of simulators on the held-out rows of a recording."""

    def __init__(self, prepared: Prepared) -> None:
        self.prepared = prepared
        self._root = np.linalg.inv(np.linalg.cholesky(prepared.covariance))
        sealed = prepared.sealed
        self.y, self.count = prepared.y[sealed], prepared.count[sealed]
        self.block = prepared.block[sealed]
        scatter = prepared.scatter
        white = np.einsum("ij,hjk,ik->h", self._root, scatter, self._root)
        self.noise = white[sealed] / 6 - 1.0
        self.channel_noise = np.einsum("hii->hi", scatter)[sealed] / prepared.sigma**2 - 1.0

    @property
    def rows(self) -> int:
        return int(self.count.sum())

    def _residual(self, reading: np.ndarray) -> np.ndarray:
        return np.asarray(self.y - reading[self.prepared.scene.held][self.prepared.sealed])

    def of(self, reading: np.ndarray) -> np.ndarray:
        """Gap of each held-out observation (S,) for scene readings (M, 6)."""
        white = self._residual(reading) @ self._root.T
        return np.asarray((white**2).mean(axis=1) + self.noise)

    def channels(self, reading: np.ndarray) -> np.ndarray:
        """Gap of each channel (6,)."""
        gaps = (self._residual(reading) / self.prepared.sigma) ** 2 + self.channel_noise
        return np.asarray((gaps * self.count[:, None]).sum(axis=0) / self.count.sum())

    def mean(self, gaps: np.ndarray) -> float:
        """Mean over rows of gaps (S,)."""
        return float((gaps * self.count).sum() / self.count.sum())

    def floor(self) -> np.ndarray:
        """Gap of noise alone (S,): rows about their mean; in motion what is faster than any gap.

        Second differences would miss most of a noise with memory.
        """
        p = self.prepared
        if p.moving:
            variance, _ = noise_in_motion(p.residual @ self._root.T, p.scene.period, p.stride)
            fresh = np.count_nonzero(p.count) / len(p.count)  # what repeats hardly scatters
            return np.full(len(self.y), float(variance.mean()) / fresh - 1.0)
        if p.averaged:
            return np.asarray(self.noise + float(p.noise.mean()))
        n = np.maximum(self.count, 2)
        repeated = (self.noise + 1.0) * n / (n - 1) - 1.0
        return np.asarray(np.where(self.count > 1, repeated, 0.0))
