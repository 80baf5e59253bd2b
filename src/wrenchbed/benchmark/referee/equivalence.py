"""Which effects one robot's data cannot tell apart, and what an oracle could say of it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import lsq_linear

from wrenchbed.benchmark.referee import signatures
from wrenchbed.benchmark.referee.catalogue import STATED
from wrenchbed.benchmark.referee.ride import Ride
from wrenchbed.benchmark.referee.setting import RefereeSetting

SAME = 0.1
"""An effect that imitates another up to this gap cannot be told from it: minor imperfections
together may leave four times as much."""
LARGEST = 8.0
"""Largest size, in multiples of typical, of an effect that imitates another."""
_NEAREST = 4


@dataclass(frozen=True, eq=False)
class Usual:
    """What every fit takes out of a difference: bias, mass and CoG.

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

    def leaves(self, x: np.ndarray, whole: float, bounded: bool) -> float:
        """Square of what the best imitation leaves of x (6 n,), with sizes a robot may have."""
        seen = self.q.T @ x
        free = whole - float(seen @ seen)
        if not bounded:
            return free
        best = lsq_linear(self.r, seen, (-LARGEST, LARGEST)).x
        return free + float(np.sum((self.r @ best - seen) ** 2))


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
        """Gap that each effect leaves of a signature (n, 6) when it imitates it as well as it can.

        Args:
            bounded: with sizes that a robot may have, where any sizes imitate it.
        """
        x = self.usual.white(signature, configured)
        whole, every = float(x @ x), self.alone if configured else self.beside
        found = {}
        for name, own in every.items():
            free = [b.leaves(x, whole, bounded=False) for b in own]
            near = sorted(range(len(own)), key=lambda k: free[k])[:_NEAREST]
            least = free[near[0]]
            if bounded and least <= SAME * len(x):
                least = min(own[k].leaves(x, whole, bounded=True) for k in near)
            found[name] = max(0.0, least) / len(x)
        return found

    def alike(self, name: str, signature: np.ndarray) -> list[str]:
        """Other effects that this data cannot tell from one with a signature (n, 6)."""
        found = self.imitated(signature, name in STATED)
        near = [k for k, left in found.items() if k != name and left <= SAME]
        return sorted(near, key=lambda k: found[k])

    def shows(self, seen: np.ndarray, signature: np.ndarray, configured: bool) -> bool:
        """Whether data holds an exact signature: it takes away half of what it should, or more.

        Args:
            seen: measured less stated, and less what else is known to be there (n, 6).
        """
        x, s = self.usual.white(seen, configured), self.usual.white(signature, configured)
        fall = float(x @ x) - float((x - s) @ (x - s))
        return fall >= 0.5 * float(s @ s)


def bench(setting: RefereeSetting, ride: Ride, usual: Usual) -> Bench:
    """Signatures of every effect for one robot."""
    alone, beside = {}, {}
    for name, own in signatures.blocks(setting, ride).items():
        white = [_white(b, setting.noise) for b in own]
        alone[name] = [_block(w) for w in white]
        beside[name] = [_block(w - usual.basis @ (usual.basis.T @ w)) for w in white]
    return Bench(usual, alone, beside)


def _white(block: np.ndarray, noise: np.ndarray) -> np.ndarray:
    return np.asarray((block / noise[:, None]).reshape(-1, block.shape[-1]))


def _block(columns: np.ndarray) -> Block:
    u, s, vt = np.linalg.svd(columns, full_matrices=False)
    kept = s > max(1e-6 * float(s[0]), 1e-9)
    return Block(u[:, kept], s[kept, None] * vt[kept])
