"""Evidence of hypotheses: exact marginal likelihoods of a linear Gaussian model.

y = E c + e with c ~ N(0, V), e ~ N(0, v₀ I). The background, small imperfections of all effects at
once, is in V; a hypothesis widens V for its own columns. So only evidence beyond imperfections and
the tolerances of stated numbers counts (M-open view: Bernardo & Smith 1994, ch. 6).

A ladder of background levels (rungs) covers what gap many small imperfections may add together.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from wrenchbed.diagnosis.evidence.dictionary import EffectDictionary
from wrenchbed.diagnosis.prepare.prepared import Prepared

LARGE = 1e4
"""Prior variance, in typical sizes squared, of a number that nobody states."""
LADDER = (0.02, 0.08, 0.3, 1.2, 5.0, 20.0)
"""Gap of each background level: what all small imperfections add together. Up to `NORMAL` any robot
may have it; more is a gap without a cause, or an effect whose formula fits only nearly."""
NORMAL = 0.5
"""Largest gap [noise variances] of a background that every robot may have, half the noise."""
SHARES = {"effects": 0.45, "kernels": 0.3, "rows": 0.25}
"""Shares of a background's gap: of effects of the library, smooth functions, single rows."""
MOST = 0.2
"""Largest prior standard deviation of an imperfection, in typical sizes of its effect."""
CORRELATION_S = 0.4
"""Correlation time [s] of errors in motion that the model does not have."""
WITHIN = 1.0
"""Prior standard deviation of a stated number, over its tolerance."""


class OfProducts:
    """Gaussian background, E c + noise with c ~ N(0, V), given by V (n,) and G = Eᵀ v₀⁻¹ E (n, n)
    alone, noise variance v₀. For many rows, and where readings themselves are not kept."""

    V: np.ndarray
    gram: np.ndarray

    @cached_property
    def _on(self) -> np.ndarray:
        """Indices (b,) of the columns with a positive background variance."""
        return np.flatnonzero(self.V > 0.0)

    @cached_property
    def _root(self) -> np.ndarray:
        """Standard deviations (b,) of the coefficients of the columns in use (`_on`)."""
        return np.sqrt(self.V[self._on])

    def _beside(self) -> np.ndarray:
        """Product G D (n, b) of the Gram matrix G = Eᵀ v₀⁻¹ E with D = V½ of the columns `_on`."""
        result = np.take(self.gram, self._on, axis=1)
        result *= self._root
        return result

    @cached_property
    def _factor(self) -> tuple[np.ndarray, bool]:
        """Cholesky factor of I + D G D, with the Gram matrix G = Eᵀ v₀⁻¹ E and D = V½."""
        inner = self._beside()[self._on]
        inner *= self._root[:, None]
        return factored(inner)

    def held(self, u: np.ndarray) -> np.ndarray:
        """Posterior mean of the background's coefficients (n, k) for u = Eᵀ v₀⁻¹ y (n, k): D (I + D
        G D)⁻¹ D u with D = V½."""
        root, result = self._root[:, None], np.zeros_like(u)
        solved = cho_solve(self._factor, root * u[self._on], check_finite=False)
        result[self._on] = root * solved
        return result

    @cached_property
    def half(self) -> np.ndarray:
        """H (b, n): HᵀH is the part of the Gram matrix G (n, n) that the background explains."""
        return solved(self._factor[0], self._beside().T)

    def over_noise(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Scores w = Eᵀ K₀⁻¹ y (n, c) and log evidence (c,), above that of noise alone, of c
        recordings' readings y, given as u = Eᵀ v₀⁻¹ y (n, c)."""
        kept = self.held(u)
        gain = 0.5 * (u * kept).sum(axis=0) - np.log(np.diagonal(self._factor[0])).sum()
        return np.asarray(u - self.gram @ kept), np.asarray(gain)

    def informations(self, sets: Iterable[np.ndarray]) -> list[np.ndarray]:
        """Information matrices P = Eᵀ K₀⁻¹ E (b, k, k) of each group of sets (b, k) of columns,
        with the covariance K₀ of noise and background."""
        own = (self.gram[c[:, :, None], c[:, None, :]] - squares(self.half, c) for c in sets)
        return [np.asarray(p) for p in own]


@dataclass(frozen=True, eq=False)
class Products(OfProducts):
    """Background given by the Gram matrix G (n, n) of n columns and prior variances V (n,)."""

    gram: np.ndarray
    V: np.ndarray


def factored(inner: np.ndarray) -> tuple[np.ndarray, bool]:
    """Lower factor of I + M as `cho_factor` returns it; the symmetric M (n, n) is overwritten."""
    inner.flat[:: len(inner) + 1] += 1.0
    return cho_factor(inner.T, lower=True, overwrite_a=True, check_finite=False)


def solved(factor: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Product L⁻¹ x (n, k) with a lower factor L (n, n); x (n, k) may be overwritten."""
    half = solve_triangular(factor, x, lower=True, overwrite_b=True, check_finite=False)
    return np.asarray(half)


@dataclass(frozen=True, eq=False)
class BackgroundLevel(OfProducts):
    """Background of one level, with covariance K₀ = v₀ I + E V Eᵀ and diagonal V (n,).

    Attributes:
        E: columns (C R, n) of C measured columns at R rows.
        v0: noise variance of each value (C R,).
        V: variance of each column's coefficient (n,).
        weighed: makes Eᵀ v₀⁻¹ E (n, n) from a v₀ (C R,) that is the same in all rows of a measured
            column; computed from E if None.
        channels: number C of values of each row; 1 if some values of a row may be left out.
        gap: gap that all small imperfections add together.
    """

    E: np.ndarray
    v0: np.ndarray
    V: np.ndarray
    weighed: Callable[[np.ndarray], np.ndarray] | None = None
    channels: int = 1
    gap: float = 0.0

    @property
    def normal(self) -> bool:
        """Whether a healthy robot may have imperfections of this size."""
        return self.gap <= NORMAL

    def of_rows(self, rows: np.ndarray) -> "BackgroundLevel":
        """Copy with only the values that the mask ``rows`` (C R,) selects."""
        return replace(self, E=self.E[rows], v0=self.v0[rows], weighed=None, channels=1)

    @property
    def tall(self) -> bool:
        """Whether there are more rows than columns."""
        return len(self.v0) > len(self.V)

    @cached_property
    def gram(self) -> np.ndarray:  # type: ignore[override]
        """Gram matrix G = Eᵀ v₀⁻¹ E (n, n), weighted by the noise."""
        if self.weighed is None:
            return np.asarray(self.E.T @ (self.E / self.v0[:, None]))
        return self.weighed(self.v0)

    @cached_property
    def _factor(self) -> tuple[np.ndarray, bool]:
        if self.tall:
            return super()._factor
        scaled = (self.E[:, self._on] * self._root) / np.sqrt(self.v0)[:, None]
        return factored(scaled @ scaled.T)

    @cached_property
    def log_det(self) -> float:
        """Log determinant log |K₀| of the covariance of noise and background."""
        diagonal = np.diagonal(self._factor[0])
        return float(2 * np.log(diagonal).sum() + np.log(self.v0).sum())

    def _along(self, x: np.ndarray) -> np.ndarray:
        """Eᵀ x (n, k) for x (C R, k); a column costs nothing in channels where it is zero."""
        E = self.E.reshape(-1, self.channels, self.E.shape[1])
        x = x.T.reshape(x.shape[1], len(E), self.channels)
        result = np.zeros((len(x), E.shape[2]))
        for c, shown in enumerate((x != 0.0).any(axis=1).T):
            if shown.any():  # BLAS takes two to five times as long for Eᵀ x as for xᵀ E
                result[shown] += x[shown, :, c] @ E[:, c]
        return result.T

    def solve(self, x: np.ndarray) -> np.ndarray:
        """Product K₀⁻¹ x for x (C R, k), with the covariance K₀ of noise and background."""
        root = np.sqrt(self.v0)[:, None]
        z = x / root
        if self.tall:
            weighed = self._along(z / root)
            return np.asarray((z - (self.held(weighed).T @ self.E.T).T / root) / root)
        return np.asarray(cho_solve(self._factor, z, check_finite=False) / root)

    def whitened(self, x: np.ndarray, column: np.ndarray | None = None) -> "Whitened":
        """Factors of x (C R, k) from which products x'ᵀ K₀⁻¹ x follow; half the work of `solve`.
        ``column``: index (k,) of each in E, where it is one, else −1."""
        root, factor = np.sqrt(self.v0)[:, None], self._factor[0]
        z, known = x / root, np.zeros(x.shape[1], dtype=bool)
        if column is not None and "half" in vars(self):  # only where it was needed for all columns
            known = column >= 0
        new = z[:, ~known]
        if self.tall:
            new = self._root[:, None] * self._along(new / root)[self._on]
        half = np.empty((len(factor), len(known)))
        half[:, ~known] = solved(factor, new)
        if column is not None and known.any():
            half[:, known] = self.half[:, column[known]]
        return Whitened(z, half) if self.tall else Whitened(half, half[:0])

    def products(self, x: np.ndarray) -> np.ndarray:
        """Product xᵀ K₀⁻¹ x (k, k) for x (C R, k), covariance K₀ of noise and background."""
        white = self.whitened(x)
        return white.products(white)

    def precision(self, rows: np.ndarray) -> np.ndarray:
        """Block (k, k), at values of k indices ``rows``, of the precision K₀⁻¹ of the readings."""
        root = np.sqrt(self.v0[rows])
        if self.tall:
            scaled = (self.E[rows][:, self._on] * self._root) / root[:, None]
            half = solved(self._factor[0], scaled.T)
            return np.asarray((np.eye(len(rows)) - half.T @ half) / np.outer(root, root))
        half = solved(self._factor[0], np.eye(len(self.v0))[:, rows])
        return np.asarray(half.T @ half / np.outer(root, root))

    @cached_property
    def half(self) -> np.ndarray:
        """H (r, n): the information of all columns is HᵀH, or G − HᵀH if `tall`."""
        if self.tall:
            return super().half
        return solved(self._factor[0], (self.E.T / np.sqrt(self.v0)).T)

    def informations(self, sets: Iterable[np.ndarray]) -> list[np.ndarray]:
        return super().informations(sets) if self.tall else [squares(self.half, c) for c in sets]

    def scored(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Scores w = Eᵀ K₀⁻¹ y (n, c) by the background's n columns E, and log N(y; 0, K₀) (c,) by
        its covariance K₀, without the constant in 2π, of c recordings' readings y (C R, c)."""
        if self.tall:
            z = y / self.v0[:, None]
            score, gain = self.over_noise(self.E.T @ z)
            return score, gain - 0.5 * ((y * z).sum(axis=0) + np.log(self.v0).sum())
        away = self.solve(y)
        return self.E.T @ away, np.asarray(-0.5 * ((y * away).sum(axis=0) + self.log_det))


class Whitened(NamedTuple):
    """Factors of k columns x for products x'ᵀ K₀⁻¹ x, K₀ the covariance of noise and background.

    Attributes:
        rows: columns at m values, over the noise's standard deviation (m, k).
        taken: part that the r columns of the background explain (r, k).
    """

    rows: np.ndarray
    taken: np.ndarray

    def products(self, other: "Whitened") -> np.ndarray:
        """Products (k, k') xᵀ K₀⁻¹ x' of these columns x with those, x', of another object."""
        return np.asarray(self.rows.T @ other.rows - self.taken.T @ other.taken)

    def put(self, columns: Sequence[int], other: "Whitened") -> None:
        """Replace the columns of these indices, in place, by those of ``other``, in its order."""
        self.rows[:, columns] = other.rows
        self.taken[:, columns] = other.taken

    @classmethod
    def of_all(cls, each: "Iterable[Whitened]") -> "Whitened":
        """Factors of columns over the stacked rows of several independent readings."""
        rows, taken = zip(*each, strict=True)
        return cls(np.concatenate(rows), np.concatenate(taken))


def log_sum(logs: np.ndarray) -> np.ndarray:
    """log Σ exp of logs (…, n) over the last axis (…); scipy's takes ten times as long."""
    top = logs.max(axis=-1)
    return np.asarray(top + np.log(np.exp(logs - top[..., None]).sum(axis=-1)))


def squares(half: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Blocks (b, k, k) of HᵀH for sets of columns (b, k) of H (m, n)."""
    some = half.T[columns]
    return np.asarray(some @ np.swapaxes(some, 1, 2))


def gains(
    information: np.ndarray, score: np.ndarray, size: np.ndarray, scales: np.ndarray
) -> np.ndarray:
    """Gain in log evidence when a hypothesis widens its columns' prior: b hypotheses of k columns.

    Args:
        information: P = Eᵀ K₀⁻¹ E of each hypothesis' columns E (b, k, k), K₀ without it.
        score: w = Eᵀ K₀⁻¹ y (b, k, C) for C cases of readings y.
        size: relative prior standard deviations (b, k).
        scales: factors on ``size`` to try (s,) or (b, s).

    Returns:
        (b, s, C): −½ log|I + D½ P D½| + ½ uᵀ(I + D½ P D½)⁻¹u, prior variances D, u = D½ w.
    """
    p = information * size[:, :, None] * size[:, None, :]
    u = score * size[:, :, None]  # (b, k, C)
    square = np.broadcast_to(np.square(scales), (len(p), np.shape(scales)[-1]))
    if p.shape[1] == 1:
        values = p[:, 0]
    else:
        values, vectors = np.linalg.eigh(p)
        u = np.swapaxes(vectors, -1, -2) @ u
    ratio = 1.0 + square[:, :, None] * np.maximum(values, 0.0)[:, None, :]  # (b, s, k)
    fit = np.einsum("bsk,bkc->bsc", square[:, :, None] / ratio, u**2)
    return np.asarray(0.5 * (fit - np.log(ratio).sum(axis=-1)[:, :, None]))


class Moments(NamedTuple):
    """Information (k, k), score (k,) of k columns, and log evidence ``null`` (log probability of
    the readings) without any cause. Moments of independent readings add up."""

    information: np.ndarray
    score: np.ndarray
    null: float

    @classmethod
    def of(cls, level: BackgroundLevel, white: Whitened) -> "Moments":
        """Moments of k columns and, last, of readings, which are whitened on a background level."""
        every = white.products(white)
        return cls(every[:-1, :-1], every[:-1, -1], -0.5 * float(every[-1, -1] + level.log_det))

    def raised(self, by: float) -> "Moments":
        """Copy whose log evidence ``null`` is raised by a log prior."""
        return self._replace(null=self.null + by)

    def __add__(self, other: "Moments") -> "Moments":  # type: ignore[override]
        return Moments(
            self.information + other.information, self.score + other.score, self.null + other.null
        )


class ScaledEvidence(NamedTuple):
    """Log evidence of a set of p causes, the best scale of each (p,), and information (k, k)."""

    total: float
    scale: np.ndarray
    information: np.ndarray


def over_scales(
    moments: Moments, owner: np.ndarray, fixed: np.ndarray, ladder: np.ndarray
) -> ScaledEvidence:
    """Log evidence on one background level, averaged over the scales of one cause after another.

    Of k columns: ``moments``, ``owner``, the index of the cause of each (k,), and ``fixed``, prior
    standard deviations where they are known (k,), else 0; ``ladder``: those to try of each of p
    causes (p, s).
    """
    information, score, start = moments
    best, total = np.median(ladder, axis=1), -np.inf
    for k in [*range(len(ladder)), *range(len(ladder) - 1)]:
        of_cause = (owner == k) & (fixed == 0)
        size = np.where(fixed > 0, fixed, best[owner])[~of_cause]
        values, vectors = np.linalg.eigh(
            information[np.ix_(~of_cause, ~of_cause)] * np.outer(size, size)
        )
        ratio = 1.0 + np.maximum(values, 0.0)  # rounding may leave information negative
        root = (vectors * size[:, None]).T / np.sqrt(ratio)[:, None]
        half, known = root @ information[np.ix_(~of_cause, of_cause)], root @ score[~of_cause]
        block = information[np.ix_(of_cause, of_cause)] - half.T @ half
        w = score[of_cause] - half.T @ known
        gain = gains(block[None], w[None, :, None], np.ones((1, len(w))), ladder[k])[0, :, 0]
        gain += 0.5 * float(known @ known - np.log(ratio).sum())
        best[k] = ladder[k][int(gain.argmax())]
        total = float(log_sum(gain) - np.log(len(gain)))
    return ScaledEvidence(start + total, best, information)


def ladder(d: EffectDictionary) -> tuple[BackgroundLevel, ...]:
    """Levels of the background of small imperfections, smallest gap first."""
    weighed = d.weighed_by if len(d.E) > len(d.label) else None
    noise = (row_variance(d.prepared, SHARES["rows"] * gap) for gap in LADDER)
    return tuple(
        BackgroundLevel(d.E, v0, _variance(d, gap), weighed, d.channels, gap)
        for v0, gap in zip(noise, LADDER, strict=True)
    )


def _variance(d: EffectDictionary, gap: float) -> np.ndarray:
    """Prior variance (n,) of n columns' coefficients on the background level that adds ``gap``.

    The gap is of the wrench: in further channels a background adds `NORMAL` at most.
    """
    variance, normal = np.zeros(len(d.label)), min(gap, NORMAL)
    leading, further = d.gap_of_channel[0], d.gap_of_channel[1:].sum(axis=0)
    for columns in d.imperfect.values():
        share = SHARES["effects"] / (len(d.imperfect) * len(columns))
        of_wrench = share * gap / np.maximum(leading[columns], 1e-12)
        of_others = share * normal / np.maximum(further[columns], 1e-12)
        variance[columns] = np.minimum(MOST**2, np.minimum(of_wrench, of_others))
    for columns in d.kernels.values():
        of_column = np.where(further[columns] > leading[columns], normal, gap)
        variance[columns] = SHARES["kernels"] * of_column / len(d.kernels)
    variance[d.nuisance], variance[d.imperfections] = LARGE, 1.0
    variance[d.stated] = np.minimum((WITHIN * d.tolerance) ** 2, LARGE)
    return variance


def row_variance(prepared: Prepared, gap: float) -> np.ndarray:
    """Variance (C R,) of each value of the fit: its noise, and ``gap`` for errors of single rows.

    The noise of further channels already holds what nothing explains.
    """
    if prepared.moving:
        gap *= max(1.0, CORRELATION_S / (prepared.scene.period * prepared.stride))
    more = np.zeros_like(prepared.variance)
    more[prepared.families[0]] = gap
    return np.tile(prepared.variance + more, len(prepared.block_rows))
