"""Linear fit with unknown noise, and unknown sizes of ordinary (healthy) errors.

Readings y = F a + Σ sₕ Bₕ bₕ + C c + e: amplitudes a; ordinary errors b, c ~ N(0, 1), those of kind
h of unknown size sₕ; noise e ~ N(0, vₖ) in rows of group k. Noise and sizes maximise the marginal
likelihood (MacKay 1992, 10.1162/neco.1992.4.3.415), with a prior on sizes worth one error.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

SEEN = 1.0
"""Weight of the prior of each size, in errors of usual size: without any, a few errors that are
small by chance would make the size nothing."""
_STEPS, _SETTLED = 200, 3e-3
"""Updates of the noise at most, and relative change of a variance that ends them."""
_NOISELESS = 1e-12
"""Least noise variance over the readings' mean square: a millionth of the readings."""
_NULL, _SHARE = 1e-7, 1e-3
"""Singular value over the largest, of columns scaled to 1, below which a direction is untold, and
the part of an amplitude in such directions from which it is."""


@dataclass(frozen=True, eq=False)
class Posterior:
    """Result of `posterior`: fitted amplitudes, their covariance, which of them are determined.

    Attributes:
        free: amplitudes a (p,); 0 along directions that the rows do not determine.
        covariance: of the amplitudes (p, p).
        determined: whether the rows determine each amplitude (p,), boolean.
        noise: standard deviation of a reading of each group (G,).
        sizes: size of each kind of ordinary errors (errors of healthy robots), over the usual one.
        fitted: fitted readings (n,).
    """

    free: np.ndarray
    covariance: np.ndarray
    determined: np.ndarray
    noise: np.ndarray
    sizes: np.ndarray
    fitted: np.ndarray


def posterior(
    y: np.ndarray,
    free: np.ndarray,
    ordinary: Sequence[np.ndarray],
    known: np.ndarray,
    group: np.ndarray,
) -> Posterior:
    """Fit amplitudes, noise and sizes of ordinary errors (those of healthy robots) to readings.

    Args:
        y: readings (n,).
        free: columns F (n, p) of the free amplitudes, of any unit.
        ordinary: columns (n, m) of each kind of ordinary errors, of one usual error each.
        known: columns C (n, k) of errors of known size, of one standard deviation each.
        group: number of the noise group of each reading (n,), from 0.
    """
    way, determined = _determined(free)
    start = way @ np.linalg.lstsq(free @ way, y, rcond=None)[0]
    columns, r = np.column_stack([free @ way, *ordinary, known]), way.shape[1]
    kind = np.repeat(np.arange(len(ordinary)), [b.shape[1] for b in ordinary])
    fitted = slice(r, r + len(kind))
    rest, many = y - free @ start, len(ordinary)
    count = np.bincount(group).astype(float)
    parts = [columns[group == k] for k in range(len(count))]
    grams = np.stack([x.T @ x for x in parts])
    right = np.stack([x.T @ rest[group == k] for k, x in enumerate(parts)])
    square = np.bincount(group, rest**2)
    least = _NOISELESS * float(np.mean(y**2)) + 1e-300
    variance, size = np.maximum(square / count, least), np.ones(many)
    prior = np.concatenate([np.zeros(r), np.ones(columns.shape[1] - r)])
    for _ in range(_STEPS):
        prior[fitted] = 1.0 / size[kind]
        covariance = np.linalg.inv(np.tensordot(1.0 / variance, grams, 1) + np.diag(prior))
        mean = covariance @ (right / variance[:, None]).sum(axis=0)
        squared = square - 2.0 * right @ mean + grams @ mean @ mean
        used = np.tensordot(grams, covariance, 2) / variance
        seen = 1.0 - np.diagonal(covariance)[fitted] * prior[fitted]
        before = np.concatenate([variance, size])
        variance = np.maximum(squared / np.maximum(count - used, 1.0), least)
        size = (SEEN + np.bincount(kind, mean[fitted] ** 2, many)) / (
            SEEN + np.bincount(kind, np.clip(seen, 0.0, 1.0), many)
        )
        if np.abs(np.concatenate([variance, size]) / before - 1.0).max() < _SETTLED:
            break
    return Posterior(
        start + way @ mean[:r], way @ covariance[:r, :r] @ way.T, determined, np.sqrt(variance),
        np.sqrt(size), free @ start + columns @ mean,
    )  # fmt: skip


def _determined(free: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Directions (p, r) of amplitudes that columns (n, p) determine; whether each amplitude is."""
    norm = np.linalg.norm(free, axis=0)
    norm = np.where(norm > 0.0, norm, 1.0)
    _, scale, vt = np.linalg.svd(free / norm, full_matrices=True)
    seen = np.zeros(free.shape[1], dtype=bool)
    seen[: len(scale)] = scale > _NULL * scale.max(initial=0.0)
    return vt[seen].T / norm[:, None], (vt[~seen] ** 2).sum(axis=0) < _SHARE
