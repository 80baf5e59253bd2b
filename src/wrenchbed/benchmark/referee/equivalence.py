"""Which effects one robot's data cannot distinguish: how well each can imitate a signature."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import lsq_linear

from wrenchbed.benchmark.referee import signatures
from wrenchbed.benchmark.referee.catalogue import STATED
from wrenchbed.benchmark.referee.forward_dynamics import Ride
from wrenchbed.benchmark.referee.scenario import RefereeSetting

SAME = 0.1
"""An effect that imitates another up to this gap cannot be distinguished from it: an estimate;
minor imperfections together may leave four times as much."""
LARGEST = 8.0
"""Largest size, in multiples of typical, of an effect that imitates another: an estimate."""
_NEAREST = 4
"""Variants that are fitted with bounds."""


@dataclass(frozen=True, eq=False)
class Usual:
    """The part of a difference that every fit removes: bias, mass and CoG.

    Attributes:
        noise: of a row (6,).
        basis: orthonormal columns (6 n, 10) in noises of a row.
    """

    noise: np.ndarray
    basis: np.ndarray

    @classmethod
    def of(cls, setting: RefereeSetting) -> "Usual":
        """Of a robot."""
        white = _white(signatures.nuisance(setting), setting.noise)
        return cls(setting.noise, np.linalg.qr(white / np.linalg.norm(white, axis=0))[0])

    def white(self, signal: np.ndarray, configured: bool) -> np.ndarray:
        """A difference (n, 6) in noises of a row (6 n,), after the fit unless ``configured``."""
        x = (signal / self.noise).ravel()
        return np.asarray(x if configured else x - self.basis @ (self.basis.T @ x))

    def gap(self, signal: np.ndarray, configured: bool) -> float:
        """Mean square of a difference (n, 6) in noises of a row."""
        x = self.white(signal, configured)
        return float(x @ x) / len(x)


class Block(NamedTuple):
    """A variant of an effect: orthonormal q (6 n, k), and r (k, c) with columns = q r."""

    q: np.ndarray
    r: np.ndarray

    def residual(self, x: np.ndarray, bounded: bool) -> float:
        """Squared residual of x (6 n,) after the best imitation.

        Args:
            bounded: with sizes that a robot may have.
        """
        projection = self.q.T @ x
        free = float(x @ x) - float(projection @ projection)
        if not bounded:
            return free
        best = lsq_linear(self.r, projection, (-LARGEST, LARGEST)).x
        return free + float(np.sum((self.r @ best - projection) ** 2))


@dataclass(frozen=True, eq=False)
class Bench:
    """Signatures of the library on one robot.

    Attributes:
        usual: what every fit takes out.
        alone, beside: variants by effect, as they are and after the usual fit.
    """

    usual: Usual
    alone: Mapping[str, list[Block]]
    beside: Mapping[str, list[Block]]

    def imitated(
        self, signature: np.ndarray, configured: bool, bounded: bool = True
    ) -> dict[str, float]:
        """Gap that remains of a signature (n, 6) when each effect imitates it as well as it can.

        Args:
            bounded: with sizes that a robot may have, where any sizes imitate it.
        """
        x = self.usual.white(signature, configured)
        remaining = {}
        for name, variants in (self.alone if configured else self.beside).items():
            free = [b.residual(x, bounded=False) for b in variants]
            near = sorted(range(len(variants)), key=lambda k: free[k])[:_NEAREST]
            least = free[near[0]]
            if bounded and least <= SAME * len(x):
                least = min(variants[k].residual(x, bounded=True) for k in near)
            remaining[name] = max(0.0, least) / len(x)
        return remaining

    def alike(self, name: str, signature: np.ndarray) -> list[str]:
        """Other effects that this data cannot distinguish from one with a signature (n, 6)."""
        remaining = self.imitated(signature, name in STATED)
        near = [k for k, gap in remaining.items() if k != name and gap <= SAME]
        return sorted(near, key=lambda k: remaining[k])

    def shows(self, data: np.ndarray, signature: np.ndarray, configured: bool) -> bool:
        """Whether data contain a signature: subtracting it removes at least half of its square.

        Args:
            data: measured minus stated, and minus all other known faults (n, 6).
        """
        x, s = self.usual.white(data, configured), self.usual.white(signature, configured)
        fall = float(x @ x) - float((x - s) @ (x - s))
        return fall >= 0.5 * float(s @ s)


def bench(
    setting: RefereeSetting,
    ride: Ride,
    usual: Usual,
    blocks: Callable[[RefereeSetting, Ride], signatures.Blocks] = signatures.blocks,
) -> Bench:
    """Signatures of every effect for one robot."""
    alone, beside = {}, {}
    for name, variants in blocks(setting, ride).items():
        white = [_white(b, setting.noise) for b in variants]
        alone[name] = [_block(w) for w in white]
        beside[name] = [_block(w - usual.basis @ (usual.basis.T @ w)) for w in white]
    return Bench(usual, alone, beside)


def _white(block: np.ndarray, noise: np.ndarray) -> np.ndarray:
    return np.asarray((block / noise[:, None]).reshape(-1, block.shape[-1]))


def _block(columns: np.ndarray) -> Block:
    u, s, vt = np.linalg.svd(columns, full_matrices=False)
    kept = s > max(1e-6 * float(s[0]), 1e-9)
    return Block(u[:, kept], s[kept, None] * vt[kept])
