"""Observability indices, and exchange against brute force and first principles."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import wrenchbed as wb
from wrenchbed.errors import PlanError
from wrenchbed.planning.criteria import INDICES, InverseTrace, observability_indices
from wrenchbed.planning.exchange import Pool, exchange

M = 4


def blocks(n: int, seed: int, m: int = M) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(n, 2, m)) * np.geomspace(1.0, 0.3, m)


def weight(seed: int) -> np.ndarray:
    half = np.random.default_rng(seed).normal(size=(M, M))
    return half @ half.T


CRITERIA = {**INDICES, "A": InverseTrace(np.eye(M), "A"), "I": InverseTrace(weight(0))}
each_criterion = pytest.mark.parametrize("criterion", CRITERIA.values(), ids=CRITERIA.keys())


def test_the_indices_are_those_of_their_definitions():
    jacobian = blocks(5, 1)
    s = np.linalg.svd(jacobian.reshape(-1, M), compute_uv=False)
    found = observability_indices(jacobian)
    assert found["O1"] == pytest.approx(np.prod(s) ** (1 / M) / np.sqrt(5))
    assert found["O2"] == pytest.approx(s[-1] / s[0])
    assert found["O3"] == pytest.approx(s[-1])
    assert found["O4"] == pytest.approx(s[-1] ** 2 / s[0])
    assert found["O5"] == pytest.approx(1 / np.sum(1 / s))


@each_criterion
@given(seed=st.integers(0, 1000))
@settings(max_examples=20, deadline=None)
def test_the_gradient_is_the_derivative(criterion, seed):
    information = Pool(blocks(6, seed)).information(np.arange(6))
    step = weight(seed + 1) * 1e-6
    difference = criterion.values(information + step) - criterion.values(information - step)
    slope = 2 * np.trace(criterion.gradient(information) @ step)
    assert difference == pytest.approx(slope, rel=1e-4, abs=1e-12)


@each_criterion
@given(seed=st.integers(0, 1000), sign=st.sampled_from([1.0, -1.0]))
@settings(max_examples=20, deadline=None)
def test_rank_k_changes_equal_recomputation(criterion, seed, sign):
    pool = Pool(blocks(8, seed))
    information = pool.information(np.arange(8))
    fast = criterion.changed(information, pool.blocks[:4], sign)
    slow = [criterion.values(information + sign * b.T @ b) for b in pool.blocks[:4]]
    assert fast == pytest.approx(np.array(slow), rel=1e-8)


@each_criterion
def test_exchange_finds_what_brute_force_finds_without_repeats(criterion):
    missed = 0
    for seed in range(6):
        pool, n = Pool(blocks(10, seed)), (4, 8, 9, 10)[seed % 4]
        best = max(float(criterion.values(pool.information(s))) for s in combinations(range(10), n))
        chosen = [exchange(pool, criterion, n, seed=k) for k in range(3)]
        assert all(len(set(c.chosen.tolist())) == n for c in chosen)
        value = max(c.value for c in chosen)
        assert value <= best * (1 + 1e-9)
        missed += value < best * (1 - 1e-9)
    assert missed <= 1


def test_impossible_choices_are_refused():
    pool = Pool(blocks(20, 0))
    with pytest.raises(PlanError, match="1 configurations give 2 readings, too few for 4"):
        observability_indices(blocks(1, 0))
    with pytest.raises(PlanError, match="4 parameters need at least 2"):
        exchange(pool, INDICES["O1"], 1)
    with pytest.raises(PlanError, match="21 configurations of 20"):
        exchange(pool, INDICES["O1"], 21)
    blind = blocks(20, 0)
    blind[..., 3] = blind[..., 2]
    with pytest.raises(PlanError, match="never have full rank"):
        exchange(Pool(blind), INDICES["O1"], 5)


def test_a_prior_allows_fewer_measurements_than_parameters():
    done = exchange(Pool(blocks(50, 0)), CRITERIA["A"], 1, prior=np.eye(M))
    single = [CRITERIA["A"].values(np.eye(M) + b.T @ b) for b in blocks(50, 0)]
    assert done.chosen.tolist() == [int(np.argmax(single))]


@pytest.mark.parametrize("robot", ["ur5", "medrue"])
def test_informative_poses_beat_random_ones(robot):
    arm = wb.load("robots", robot)
    plan = wb.informative(arm, 30, "O1", 1500, seed=0)
    assert len(plan) == 30
    assert not arm.infeasible(plan.q, arm.parameters.nominal)
    assert np.array_equal(plan.q, wb.informative(arm, 30, "O1", 1500, seed=0).q)
    random = [_o1(arm, wb.poses(arm, 30, seed).q) for seed in range(10)]
    assert _o1(arm, plan.q) > max(random)


def _o1(arm, q: np.ndarray) -> float:
    model = wb.Model.of(arm)
    columns = model.parameters.select(arm.free)
    scale = model.parameters.tolerance[list(columns)]
    std = wb.load("sensors", arm.sensor).noise.row_std
    jacobian = model.jacobian(q, model.parameters.nominal, columns) / std[:, None] * scale
    return observability_indices(jacobian)["O1"]
