"""Priors, sizes and evidence of single hypotheses, by hand."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from linear_case import EFFECTS, Named, dictionary, named, readings
from wrenchbed.diagnosis.evidence.dictionary import Hypothesis
from wrenchbed.diagnosis.evidence.search import Searcher
from wrenchbed.effects.base import Variant


def hypothesis(d, name, typical=4.0, weight=1.0):
    (own,) = named(d, name)
    variant = Variant(name, own.variant.free, weight=weight)
    return Hypothesis(Named(name), variant, own.columns, typical)


def test_effects_share_their_prior_and_variants_that_of_an_effect():
    d = dictionary()
    count = len(EFFECTS) + 3  # and the stated numbers
    s = Searcher(d)
    assert s.prior(hypothesis(d, "cable.pull")) == pytest.approx(np.log(0.45 / count))
    assert s.prior(hypothesis(d, "base.tilt")) == pytest.approx(np.log(0.45 / count))
    more = (hypothesis(d, "cable.pull", weight=3.0),)
    wide = Searcher(replace(d, hypotheses=d.hypotheses + more))
    assert wide.prior(more[0]) == pytest.approx(np.log(0.45 / count * 0.75))


@pytest.mark.parametrize(("typical", "rare"), [(0.01, 0.2), (0.2, 0.894427), (1.0, 1.0)])
def test_what_must_exceed_its_typical_size_is_rarer(typical, rare):
    d = dictionary()
    told = Searcher(d).prior(hypothesis(d, "cable.pull", typical))
    assert told == pytest.approx(np.log(0.45 / (len(EFFECTS) + 3) * rare), abs=1e-6)


def test_sizes_double_from_the_one_that_adds_a_gap_of_one():
    d = dictionary()
    s = Searcher(d)
    assert s.scales(hypothesis(d, "cable.pull", 4.0)) == pytest.approx(
        [0.5, 1.0, 2.0, 4.0, 8.0, 8.0, 8.0]
    )
    assert s.scales(hypothesis(d, "cable.pull", 1e4))[0] == pytest.approx(0.06)
    assert s.scales(hypothesis(d, "cable.pull", 0.01)) == pytest.approx([10.0] * 7)


def test_large_backgrounds_are_believed_only_beside_a_gap_that_dwarfs_them():
    d = dictionary()
    s = Searcher(d)
    none = np.exp(s.rung_prior(readings(d, {})))
    assert none == pytest.approx([1 / 3, 1 / 3, 1 / 3, 1e-5, 1e-5, 1e-5])
    some = np.exp(s.rung_prior(readings(d, {"base.tilt": 100.0})))  # 2 % of it is 2
    assert some == pytest.approx([1 / 3, 1 / 3, 1 / 3, 0.1, 1e-5, 1e-5])


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
    level = s.rungs[1].level
    assert nulls[1] == pytest.approx(marginal(d, level, y, d.E[:, :1], [0.0]) + np.log(1 / 3))
    index, h = next((k, h) for k, h in enumerate(d.hypotheses) if h.name == "base.tilt")
    expected = marginal(d, level, y, d.E[:, h.columns], s.scales(h)) + s.prior(h) + np.log(1 / 3)
    assert found[index, 1] == pytest.approx(expected, rel=1e-6)
    assert len(found) == (len(d.hypotheses) + 2) * len(s.rungs)


def test_the_unknown_shares_its_prior_among_what_it_may_depend_on():
    d = dictionary(rows=30)
    s, y = Searcher(d), readings(d, {"pose": 0.5})
    pose = -1 - s.kernels.index("pose")
    (told,) = (x for x in s.singles(y) if (x.index, x.rung) == (pose, 0))
    expected = marginal(d, s.rungs[0].level, y, d.E[:, d.kernels["pose"]], 2.0 ** np.arange(9))
    assert told.log_posterior == pytest.approx(
        expected + np.log(0.15 / 2) + np.log(1 / 3), rel=1e-6
    )
