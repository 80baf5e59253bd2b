"""Priors, sizes and evidence of single hypotheses, by hand."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from linear_case import EFFECTS, Named, dictionary, readings
from wrenchbed.diagnosis.evidence.dictionary import Hypothesis
from wrenchbed.diagnosis.evidence.search import Searcher
from wrenchbed.effects.base import Variant


def hypothesis(d, name, typical=4.0, weight=1.0):
    own = next(h for h in d.hypotheses if h.name == name)
    variant = Variant(name, own.variant.free, weight=weight)
    return Hypothesis(Named(name), variant, own.columns, typical)


def test_effects_share_their_prior_and_variants_that_of_an_effect():
    d = dictionary()
    count = len(EFFECTS) + 3  # and the stated numbers
    s = Searcher(d, {"base.tilt": 2.5})
    assert s.prior(hypothesis(d, "cable.pull")) == pytest.approx(np.log(0.45 / count))
    assert s.prior(hypothesis(d, "base.tilt")) == pytest.approx(np.log(0.45 / count) + 2.5)
    more = (hypothesis(d, "cable.pull", weight=3.0),)
    values = {k: getattr(d, k) for k in d.__dataclass_fields__}
    wide = Searcher(replace(d, **values | {"hypotheses": d.hypotheses + more}))
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


def test_a_single_hypothesis_has_its_marginal_likelihood_over_all_sizes():
    d = dictionary(rows=30)
    y = readings(d, {"base.tilt": 0.1})
    s = Searcher(d)
    nulls, found = s.nulls(y), {(x.index, x.rung): x.log_posterior for x in s.singles(y)}
    level = s.rungs[1].level
    K = np.diag(level.v0) + (d.E * level.V) @ d.E.T
    flat = 0.5 * len(y) * np.log(2.0 * np.pi)
    null = multivariate_normal(np.zeros(len(y)), K).logpdf(y) + flat
    assert nulls[1] == pytest.approx(null + np.log(1 / 3))
    index = next(k for k, h in enumerate(d.hypotheses) if h.name == "base.tilt")
    h = d.hypotheses[index]
    wide = d.E[:, h.columns]
    each = [
        multivariate_normal(np.zeros(len(y)), K + size**2 * wide @ wide.T).logpdf(y) + flat
        for size in s.scales(h)
    ]
    expected = np.log(np.mean(np.exp(np.array(each) - each[0]))) + each[0]
    assert found[index, 1] == pytest.approx(expected + s.prior(h) + np.log(1 / 3), rel=1e-6)
    assert len(found) == (len(d.hypotheses) + 2) * len(s.rungs)


def test_the_unknown_shares_its_prior_among_what_it_may_depend_on():
    d = dictionary(rows=30)
    s = Searcher(d)
    y = readings(d, {"pose": 0.5})
    (own,) = (x for x in s.singles(y) if x.index == -1 - s.kernels.index("pose") and x.rung == 0)
    level = s.rungs[0].level
    K = np.diag(level.v0) + (d.E * level.V) @ d.E.T
    wide = d.E[:, d.kernels["pose"]]
    sizes = 2.0 ** np.arange(9)
    flat = 0.5 * len(y) * np.log(2.0 * np.pi)
    each = [
        multivariate_normal(np.zeros(len(y)), K + size**2 * wide @ wide.T).logpdf(y) + flat
        for size in sizes
    ]
    expected = np.log(np.mean(np.exp(np.array(each) - each[0]))) + each[0]
    prior = np.log(0.15 / 2) + np.log(1 / 3)
    assert own.log_posterior == pytest.approx(expected + prior, rel=1e-6)
