"""Evidence of the linear model against dense matrices; priors, sizes and backgrounds by hand."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from linear_case import EFFECTS, KERNELS, Named, dictionary, named, readings
from wrenchbed.diagnosis.evidence.dictionary import Hypothesis
from wrenchbed.diagnosis.evidence.likelihood import (
    LADDER,
    BackgroundLevel,
    Moments,
    gains,
    ladder,
    over_scales,
)
from wrenchbed.diagnosis.evidence.search import Searcher
from wrenchbed.effects.base import Variant

TWO_PI = np.log(2.0 * np.pi)


def case(rows, columns, seed=0):
    """A level whose noise differs from channel to channel, and its dense K₀."""
    rng = np.random.default_rng(seed)
    E = rng.standard_normal((rows, columns))
    v0 = np.tile(rng.uniform(0.5, 2.0, 6), rows // 6)
    level = BackgroundLevel(E, v0, rng.uniform(0.5, 2.0, columns))
    return level, np.diag(v0) + (E * level.V) @ E.T, rng


SIZES = pytest.mark.parametrize(("rows", "columns"), [(24, 5), (12, 30), (12, 12)])


@SIZES
def test_a_level_is_its_dense_matrix(rows, columns):
    level, K, rng = case(rows, columns)
    inverse = np.linalg.inv(K)
    y = rng.standard_normal((rows, 3))
    assert level.tall == (rows > columns)
    assert level.log_det == pytest.approx(np.linalg.slogdet(K)[1])
    assert level.solve(y) == pytest.approx(inverse @ y)
    some = np.array([1, 4, 5])
    assert level.precision(some) == pytest.approx(inverse[np.ix_(some, some)])
    information = level.informations([np.arange(columns)[None]])[0][0]
    assert information == pytest.approx(level.E.T @ inverse @ level.E)
    both, known = np.column_stack([y, level.E[:, [4, 2]]]), np.array([-1, -1, -1, 4, 2])
    assert level.products(both) == pytest.approx(both.T @ inverse @ both)
    white = level.whitened(both, known)  # parts of columns are those of the information
    assert white.products(white) == pytest.approx(both.T @ inverse @ both)
    score, null = level.scored(y)
    assert score == pytest.approx(level.E.T @ inverse @ y)
    expected = [multivariate_normal(np.zeros(rows), K).logpdf(c) for c in y.T]
    assert null - 0.5 * rows * TWO_PI == pytest.approx(expected)


@SIZES
def test_a_level_of_some_rows_is_its_dense_matrix(rows, columns):
    level, _, rng = case(rows, columns)
    variance = level.V.copy()
    variance[[0, 3]] = 0.0, 7.0
    some = np.arange(rows) % 3 > 0
    y = rng.standard_normal((rows, 1))
    for changed, seen in ((replace(level, V=variance), slice(None)), (level.of_rows(some), some)):
        K = np.diag(changed.v0) + (changed.E * changed.V) @ changed.E.T
        assert changed.products(y[seen]) == pytest.approx(y[seen].T @ np.linalg.inv(K) @ y[seen])


@SIZES
def test_a_gain_is_what_widening_some_columns_adds(rows, columns):
    level, K, rng = case(rows, columns)
    y = rng.standard_normal((rows, 2))
    own, size, scales = np.array([[0, 3]]), np.array([[0.7, 1.3]]), np.array([0.5, 2.0, 4.0])
    blocks = level.informations([own])[0]
    score = level.scored(y)[0][own]
    told = gains(blocks, score, size, scales)
    assert told.shape == (1, 3, 2)
    for s, scale in enumerate(scales):
        wide = level.E[:, own[0]] * (scale * size[0])
        for c in range(2):
            before = multivariate_normal(np.zeros(rows), K).logpdf(y[:, c])
            after = multivariate_normal(np.zeros(rows), K + wide @ wide.T).logpdf(y[:, c])
            assert told[0, s, c] == pytest.approx(after - before)
    each = gains(blocks, score, size, scales[None])
    assert each == pytest.approx(told)


def test_backgrounds_add_the_gaps_that_they_state_and_unstated_numbers_are_not_endless():
    d = dictionary(tolerance=0.3)
    rungs = ladder(d)
    assert [r.gap for r in rungs] == [0.02, 0.08, 0.3, 1.2, 5.0, 20.0] == list(LADDER)
    assert [r.normal for r in rungs] == [True, True, True, False, False, False]
    effects = {e for e, p in d.label if p} - {d.label[k][0] for k in d.stated}
    for r in rungs[:3]:
        for e in effects:
            own = d.of_effect(e)
            added = float(r.V[own] @ d.configured_gap[own])
            assert added == pytest.approx(0.45 * r.gap / len(effects))
        for columns in d.kernels.values():
            assert r.V[columns] == pytest.approx(0.3 * r.gap / len(KERNELS))
        assert r.v0 == pytest.approx(1.0 + 0.25 * r.gap)
        assert r.V[d.stated] == pytest.approx(0.09)
    one = d.of_effect("joint.offset")
    assert rungs[-1].V[one] == pytest.approx(0.04)  # a fifth of the typical size at most
    d = dictionary(tolerance=np.inf)
    assert ladder(d)[0].V[d.stated] == pytest.approx(1e4)


@pytest.mark.parametrize(("stride", "times"), [(5, 10.0), (100, 1.0)])
def test_in_a_motion_neighbouring_rows_share_what_the_model_lacks(stride, times):
    d = dictionary(moving=True)
    d = replace(d, prepared=replace(d.prepared, stride=stride))  # rows 8 ms apart
    rung = ladder(d)[2]
    assert rung.v0 == pytest.approx(1.0 + 0.25 * 0.3 * times)


def hypothesis(d, name, typical=4.0, weight=1.0):
    (own,) = named(d, name)
    variant = Variant(name, own.variant.free, weight=weight)
    return Hypothesis(Named(name), variant, own.columns, typical)


def test_priors_are_shared_and_sizes_double():
    d = dictionary()
    count = len(EFFECTS) + 3  # and the stated numbers
    s = Searcher(d)
    assert s.prior(hypothesis(d, "cable.pull")) == pytest.approx(np.log(0.45 / count))
    assert s.prior(hypothesis(d, "base.tilt")) == pytest.approx(np.log(0.45 / count))
    more = (hypothesis(d, "cable.pull", weight=3.0),)
    wide = Searcher(replace(d, hypotheses=d.hypotheses + more))
    assert wide.prior(more[0]) == pytest.approx(np.log(0.45 / count * 0.75))
    scales = s.scales(hypothesis(d, "cable.pull", 4.0))
    assert scales == pytest.approx([0.5, 1.0, 2.0, 4.0, 8.0, 8.0, 8.0])
    assert s.scales(hypothesis(d, "cable.pull", 1e4))[0] == pytest.approx(0.06)
    assert s.scales(hypothesis(d, "cable.pull", 0.01)) == pytest.approx([10.0] * 7)
    none = np.exp(s.rung_prior(readings(d, {})))
    assert none == pytest.approx([1 / 3, 1 / 3, 1 / 3, 1e-5, 1e-5, 1e-5])
    some = np.exp(s.rung_prior(readings(d, {"base.tilt": 100.0})))  # 2 % of it is 2
    assert some == pytest.approx([1 / 3, 1 / 3, 1 / 3, 0.1, 1e-5, 1e-5])


@pytest.mark.parametrize(("typical", "rare"), [(0.01, 0.2), (0.2, 0.894427), (1.0, 1.0)])
def test_what_must_exceed_its_typical_size_is_rarer(typical, rare):
    d = dictionary()
    told = Searcher(d).prior(hypothesis(d, "cable.pull", typical))
    assert told == pytest.approx(np.log(0.45 / (len(EFFECTS) + 3) * rare), abs=1e-6)


def marginal(d, level, y, wide, sizes):
    """Logarithm of the mean likelihood over sizes of some columns, all matrices dense."""
    K = np.diag(level.v0) + (d.E * level.V) @ d.E.T
    zero = np.zeros(len(y))
    each = [multivariate_normal(zero, K + size**2 * wide @ wide.T).logpdf(y) for size in sizes]
    return logsumexp(each) - np.log(len(sizes)) + 0.5 * len(y) * np.log(2.0 * np.pi)


def test_a_single_hypothesis_has_its_marginal_likelihood_over_all_sizes():
    d = dictionary(rows=30)
    y, s = readings(d, {"base.tilt": 0.1}), Searcher(d)
    nulls, found = s.nulls(y), {(x.index, x.rung): x.log_posterior for x in s.singles(y)}
    level = s.levels[1]
    assert nulls[1] == pytest.approx(marginal(d, level, y, d.E[:, :1], [0.0]) + np.log(1 / 3))
    index, h = next((k, h) for k, h in enumerate(d.hypotheses) if h.name == "base.tilt")
    expected = marginal(d, level, y, d.E[:, h.columns], s.scales(h)) + s.prior(h) + np.log(1 / 3)
    assert found[index, 1] == pytest.approx(expected, rel=1e-6)
    assert len(found) == (len(d.hypotheses) + 2) * len(s.levels)


def test_the_unknown_shares_its_prior_among_what_it_may_depend_on():
    d = dictionary(rows=30)
    s, y = Searcher(d), readings(d, {"pose": 0.5})
    pose = -1 - s.kernels.index("pose")
    (told,) = (x for x in s.singles(y) if (x.index, x.rung) == (pose, 0))
    expected = marginal(d, s.levels[0], y, d.E[:, d.kernels["pose"]], 2.0 ** np.arange(9))
    expected += np.log(0.15 / 2) + np.log(1 / 3)
    assert told.log_posterior == pytest.approx(expected, rel=1e-6)


def test_sizes_of_two_causes_are_tried_in_turn_beside_a_known_one():
    rng, sizes = np.random.default_rng(5), np.array([0.3, 1.0, 3.0])
    design = rng.standard_normal((60, 6))
    y = design @ np.array([0.5, -0.4, 2.0, 1.5, -2.5, 0.3]) + rng.standard_normal(60)
    owner, fixed = np.array([0, 0, 1, 1, 1, 1]), np.array([0.0, 0.0, 0.0, 0.0, 0.0, 2.0])
    told = over_scales(
        Moments(design.T @ design, design.T @ y, -7.0), owner, fixed, np.tile(sizes, (2, 1))
    )

    def evidence(first, second):
        spread = np.array([first] * 2 + [second] * 3 + [2.0])
        K = np.eye(60) + (design * spread**2) @ design.T
        zero = np.zeros(60)
        return multivariate_normal(zero, K).logpdf(y) - multivariate_normal(
            zero, np.eye(60)
        ).logpdf(y)

    second = max(sizes, key=lambda size: evidence(told.scale[0], size))
    assert told.scale.tolist() == [max(sizes, key=lambda size: evidence(size, second)), second]
    each = [evidence(size, second) for size in sizes]
    assert told.total == pytest.approx(logsumexp(each) - np.log(3) - 7.0)


def test_information_that_rounding_left_negative_is_none():
    size = 1e9
    information = np.array([[size, size, 0.0], [size, size * (1.0 - 1e-6), 0.0], [0.0, 0.0, 4.0]])
    moments = Moments(information, np.array([3.0, 3.0, 2.0]), 0.0)
    told = over_scales(moments, np.array([0, 0, 1]), np.zeros(3), np.tile([1.0, 8.0], (2, 1)))
    assert np.isfinite(told.total) and told.total < 2.0
