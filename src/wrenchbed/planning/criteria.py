"""What makes a set of configurations good: observability indices O1–O5, A- and I-optimality.

Each is a function of the information matrix M = Σ JᵢᵀJᵢ (m, m) of the chosen configurations, whose
eigenvalues are the squares of the singular values σ1 ≥ … ≥ σm of the stacked Jacobian. Definitions:
Sun & Hollerbach 2008, doi 10.1109/ROBOT.2008.4543393; compared on robots in Joubair & Bonev 2013,
doi 10.1016/j.mechmachtheory.2013.07.005. O2–O5 depend on the units of the parameters; O1 does not
(a change of units multiplies it by a constant), nor does I-optimality.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable

import numpy as np

from wrenchbed.errors import PlanError

_SMALLEST = 1e-300
_SOFT = 4
_EXPONENTS = {"O2": (1, 1), "O3": (1, 0), "O4": (2, 1)}
"""Exponents (a, b) of σm^a / σ1^b by index; σ1 largest, σm smallest singular value."""


class Criterion(ABC):
    """Quality of a set of configurations with information matrix M, to be maximised.

    ``bounds``: whether the gradient bounds from above what adding a configuration changes: the
    criterion, or its square, is concave and smooth.
    """

    name: str
    bounds = True

    @abstractmethod
    def values(self, information: np.ndarray) -> np.ndarray:
        """Values (…) of the criterion for information matrices (…, m, m)."""

    @abstractmethod
    def gradient(self, information: np.ndarray) -> np.ndarray:
        """Derivative (m, m) of the criterion with respect to a non-singular information matrix."""

    def screen(self, information: np.ndarray) -> np.ndarray:
        """Matrix G (m, m) at an ``information`` matrix: configuration i, Jacobian Jᵢ, is the more
        promising, the larger trace(G JᵢᵀJᵢ) is."""
        return self.gradient(information)

    def changed(self, information: np.ndarray, blocks: np.ndarray, sign: float) -> np.ndarray:
        """Criterion (N,) of ``information`` (m, m) with each of ``blocks`` (N, k, m) alone added
        (``sign`` 1) or removed (−1)."""
        return self.values(information + sign * np.swapaxes(blocks, -1, -2) @ blocks)


class Spectral(Criterion):
    """Criterion that depends on the singular values of the Jacobian alone."""

    def values(self, information: np.ndarray) -> np.ndarray:
        return self._of(np.sqrt(np.maximum(np.linalg.eigvalsh(information), 0.0)))

    def gradient(self, information: np.ndarray) -> np.ndarray:
        return self._turned(information, self._slope)

    @staticmethod
    def _turned(information: np.ndarray, slope: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """Derivative (m, m) by the information matrix; ``slope`` is that by singular values
        (m,)."""
        squares, vectors = np.linalg.eigh(information)
        sigma = np.sqrt(np.maximum(squares, _SMALLEST))
        return np.asarray((vectors * (slope(sigma) / (2 * sigma))) @ vectors.T)

    @abstractmethod
    def _of(self, sigma: np.ndarray) -> np.ndarray:
        """Value (…) of the criterion for singular values (…, m), smallest first."""

    @abstractmethod
    def _slope(self, sigma: np.ndarray) -> np.ndarray:
        """Derivative (m,) of the criterion by each singular value (m,)."""


class O1(Spectral):
    """(σ1 σ2 … σm)^(1/m) of the singular values, without 1/√n: ellipsoid's volume; D-optimality."""

    name = "O1"

    def _of(self, sigma: np.ndarray) -> np.ndarray:
        return np.exp(np.log(np.maximum(sigma, _SMALLEST)).mean(axis=-1))

    def _slope(self, sigma: np.ndarray) -> np.ndarray:
        return self._of(sigma) / (len(sigma) * sigma)

    def changed(self, information: np.ndarray, blocks: np.ndarray, sign: float) -> np.ndarray:
        """Criterion (N,) of ``information`` (m, m) with each of ``blocks`` (N, k, m) alone added
        (``sign`` 1) or removed (−1), by the matrix determinant lemma."""
        m = len(information)
        inner = blocks @ np.linalg.inv(information) @ np.swapaxes(blocks, -1, -2)
        factor = np.linalg.det(np.eye(blocks.shape[1]) + sign * inner)
        start = np.linalg.slogdet(information)[1] / 2
        return np.exp((start + np.log(np.maximum(factor, _SMALLEST)) / 2) / m)


class Weakest(Spectral):
    """Criterion σm^a / σ1^b of smallest and largest singular value: (a, b) is (1, 1) in O2, (1, 0)
    in O3, (2, 1) in O4. Screening weighs other small ones too: each may become smallest."""

    bounds = False

    def __init__(self, name: str, exponents: tuple[int, int]) -> None:
        self.name, self._exponents = name, exponents

    def screen(self, information: np.ndarray) -> np.ndarray:
        return self._turned(information, self._screening_slope)

    def _screening_slope(self, sigma: np.ndarray) -> np.ndarray:
        slope = self._slope(sigma)
        near = (sigma[0] / sigma) ** _SOFT
        return np.where(slope < 0, slope, slope[0] * near / near.sum())

    def _of(self, sigma: np.ndarray) -> np.ndarray:
        a, b = self._exponents
        return np.asarray(sigma[..., 0] ** a / sigma[..., -1] ** b)

    def _slope(self, sigma: np.ndarray) -> np.ndarray:
        (a, b), value, slope = self._exponents, self._of(sigma), np.zeros_like(sigma)
        slope[-1] = -b * value / sigma[-1]
        slope[0] = a * value / sigma[0]
        return slope


class O5(Spectral):
    """1 / (1/σ1 + … + 1/σm): harmonic mean of the m singular values, over m."""

    name = "O5"

    def _of(self, sigma: np.ndarray) -> np.ndarray:
        return 1 / (1 / np.maximum(sigma, _SMALLEST)).sum(axis=-1)

    def _slope(self, sigma: np.ndarray) -> np.ndarray:
        return (self._of(sigma) / sigma) ** 2


class InverseTrace(Criterion):
    """1 / trace(W M⁻¹), M the information: A-optimality if weight W is 1, else I-optimality."""

    def __init__(self, weight: np.ndarray, name: str = "I") -> None:
        self.weight, self.name = weight, name

    def values(self, information: np.ndarray) -> np.ndarray:
        inverse = np.linalg.inv(information)
        return 1 / np.einsum("...ij,ji->...", inverse, self.weight)

    def gradient(self, information: np.ndarray) -> np.ndarray:
        inverse = np.linalg.inv(information)
        inner = inverse @ self.weight @ inverse
        return inner / np.trace(self.weight @ inverse) ** 2

    def changed(self, information: np.ndarray, blocks: np.ndarray, sign: float) -> np.ndarray:
        """Criterion (N,) of ``information`` (m, m) with each of ``blocks`` (N, k, m) alone added
        (``sign`` 1) or removed (−1), by the Woodbury identity."""
        inverse = np.linalg.inv(information)
        turned = np.swapaxes(blocks, -1, -2)
        inner = np.eye(blocks.shape[1]) + sign * (blocks @ inverse @ turned)
        outer = blocks @ (inverse @ self.weight @ inverse) @ turned
        squares, axes = np.linalg.eigh(inner)
        shares = np.einsum("nki,nkl,nli->ni", axes, outer, axes)
        lost = (shares / np.maximum(squares, _SMALLEST**0.5)).sum(axis=-1)  # 0: rank would be lost
        return 1 / (np.trace(self.weight @ inverse) - sign * lost)


_CRITERIA: list[Criterion] = [O1(), *(Weakest(n, x) for n, x in _EXPONENTS.items()), O5()]
INDICES = {c.name: c for c in _CRITERIA}


def observability_indices(jacobian: np.ndarray) -> dict[str, float]:
    """Name → value of O1 … O5 of configurations' Jacobians (n, k, m); a `PlanError` if they have
    fewer rows than parameters."""
    n, k, m = jacobian.shape
    if n * k < m:
        raise PlanError(f"{n} configurations give {n * k} readings, too few for {m} parameters")
    sigma = np.linalg.svd(jacobian.reshape(-1, m), compute_uv=False)[::-1]
    result = {name: float(c._of(sigma)) for name, c in INDICES.items() if isinstance(c, Spectral)}
    result["O1"] /= np.sqrt(n)
    return result
