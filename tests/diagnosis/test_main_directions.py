"""Large eigenvalues found from a graded factor, against numpy's singular values of everything."""

import numpy as np
import pytest

from wrenchbed.diagnosis.evidence import main_directions
from wrenchbed.diagnosis.evidence.main_directions import FEW, above

SIZES = (7, FEW, FEW + 1, 2 * FEW)
LEAST = (1e-3, 0.1)
each_size = pytest.mark.parametrize("size", SIZES)
each_least = pytest.mark.parametrize("least", LEAST)


def smooth(size: int, rng: np.random.Generator) -> np.ndarray:
    """Covariance of a smooth function at random places."""
    at = np.sort(rng.uniform(0.0, 1.0, size))
    return 100.0 * np.exp(-((at[:, None] - at) ** 2) / 0.02)


def wandering(size: int, rng: np.random.Generator) -> np.ndarray:
    """Covariance of an Ornstein–Uhlenbeck process: its spectrum falls slowly."""
    at = np.sort(rng.uniform(0.0, 1.0, size))
    return np.exp(-np.abs(at[:, None] - at) / 0.3)


def of_rank(rank: int):
    def drawn(size: int, rng: np.random.Generator) -> np.ndarray:
        factor = rng.standard_normal((size, min(rank, size)))
        factor *= np.logspace(0.0, -3.0, factor.shape[1])
        return factor @ factor.T

    return drawn


def geometric(size: int, rng: np.random.Generator) -> np.ndarray:
    turn, _ = np.linalg.qr(rng.standard_normal((size, size)))
    return (turn * 50.0 * 10.0 ** (-np.arange(size) / 8.0)) @ turn.T


def alike(size: int, rng: np.random.Generator) -> np.ndarray:
    """Five equal eigenvalues, and nothing else."""
    turn, _ = np.linalg.qr(rng.standard_normal((size, 5)))
    return 3.0 * turn @ turn.T


KINDS = {"smooth": smooth, "wandering": wandering, "rank 1": of_rank(1), "rank 30": of_rank(30),
         "rank 150": of_rank(150), "geometric": geometric, "alike": alike}  # fmt: skip
each_kind = pytest.mark.parametrize("kind", KINDS)


def drawn(kind: str, size: int) -> np.ndarray:
    matrix = KINDS[kind](size, np.random.default_rng(size))
    return 0.5 * (matrix + matrix.T)


def share(values: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """What `likelihood` makes of them: V diag(λ/(1 + λ)) Vᵀ."""
    return (vectors * (values / (1.0 + values))) @ vectors.T


def large(matrix: np.ndarray, least: float) -> tuple[np.ndarray, np.ndarray]:
    """The same by numpy's singular values."""
    ways, values, _ = np.linalg.svd(matrix)
    return values[values > least], ways[:, values > least]


@pytest.mark.sampled
@each_kind
@each_size
@each_least
def test_they_are_numpys(kind, size, least):
    matrix = drawn(kind, size)
    before = matrix.copy()
    values, vectors = above(matrix, least)
    wanted, ways = large(matrix, least)
    assert np.array_equal(matrix, before)
    assert vectors.shape == (size, len(wanted))
    assert np.abs(np.sort(values)[::-1] - wanted).max() < 1e-6 * wanted.max()
    assert np.abs(vectors.T @ vectors - np.eye(len(values))).max() < 1e-13 * size
    # what is left out anyway is a share of up to least/(1 + least)
    assert np.abs(share(values, vectors) - share(wanted, ways)).max() < 2e-4 * least


@each_size
def test_of_small_eigenvalues_there_are_none(size):
    values, vectors = above(1e-4 * np.eye(size), 1e-3)
    assert values.shape == (0,) and vectors.shape == (size, 0)


def test_few_rows_are_reduced_as_a_whole_and_many_by_the_factor(monkeypatch):
    asked = []
    plain = main_directions._of_factor
    monkeypatch.setattr(
        main_directions, "_of_factor", lambda *a: asked.append(len(a[0])) or plain(*a)
    )
    for size in SIZES:
        above(drawn("smooth", size), 1e-3)
        above(drawn("wandering", size), 1e-3)  # most of its eigenvalues are large
    assert asked == [FEW + 1, 2 * FEW]
