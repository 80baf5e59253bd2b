"""Which hypotheses are refitted, on what the unknown depends, and how blocks are predicted."""

from types import SimpleNamespace

import numpy as np
import pytest

from linear_case import Named, dictionary, named, readings, refitter
from wrenchbed.diagnosis.evidence.likelihood import BackgroundLevel
from wrenchbed.diagnosis.evidence.search import SingleEvidence
from wrenchbed.diagnosis.explain import structures
from wrenchbed.diagnosis.explain.contributions import claimable
from wrenchbed.diagnosis.explain.finalist import Finalist
from wrenchbed.diagnosis.explain.structures import prediction_errors
from wrenchbed.effects.base import Variant


def searcher(*names):
    """Hypotheses of effects."""
    of = [(n, Named(n), Variant(n, ())) for n in names]
    each = [SimpleNamespace(name=n, effect=effect, variant=v) for n, effect, v in of]
    return SimpleNamespace(hypotheses=each)


def distinct(told, most=6, base=100.0):
    """What is kept (index, evidence) of single hypotheses (index, evidence)."""
    each = [SingleEvidence(index, 0, float(value)) for index, value in told]
    found = structures._distinct(searcher(*NAMES), each, most, base)
    return [(s.index, s.log_posterior) for s in found]


NAMES = ("a.a", "a.a", "a.a", "b.b", "b.b", "c.c", "d.d")


def test_of_each_effect_the_best_and_a_second_variant_nearly_as_good():
    told = [(0, 100), (0, 99.9), (1, 98.5), (2, 98.2), (3, 90), (4, 87.9), (-1, 500), (5, 89)]
    assert distinct(told) == [(0, 100.0), (1, 98.5), (3, 90.0), (5, 89.0)]
    assert distinct([(3, 90), (4, 88.1)], base=90.0) == [(3, 90.0), (4, 88.1)]
    # no more effects than asked for, and the first beyond
    some = [(0, 100), (3, 90), (5, 80), (6, 70)]
    assert distinct(some, most=2) == [(0, 100.0), (3, 90.0), (5, 80.0)]


@pytest.mark.parametrize(("base", "far"), [(100.0, 60.0), (150.0, 60.0), (60.0, 80.0)])
def test_what_is_far_behind_the_best_is_left_out(base, far):
    near, beyond = 100 - far + 0.5, 100 - far - 0.5
    assert distinct([(0, 100), (3, near), (5, beyond)], base=base) == [(0, 100.0), (3, near)]


def test_the_unknown_beside_an_effect_may_depend_on_something_else_than_the_unknown_alone():
    """A tilt that looks much like time: alone time explains most, beside the tilt the pose."""

    def ranked(d, gaps):
        r = refitter(d, readings(d, gaps))
        return structures.rank(r.searcher, r)

    d = dictionary(alike={("time", "base.tilt"): 0.95})
    assert ranked(d, {"base.tilt": 8.0, "pose": 3.0}).kernel == "pose"
    told = ranked(d, {"base.tilt": 8.0})
    assert told.kernel == "time" and told.mixed < told.explanations[0].log_posterior
    # beside the tilt a wander in time is the likeliest
    told = ranked(dictionary(alike={("pose", "base.tilt"): 0.999}), {"base.tilt": 8.0})
    assert (told.kernel, told.mixed > told.unknown) == ("pose", True)


def test_the_unknown_alone_weighs_kernels_and_large_backgrounds_together():
    d = dictionary()
    r = refitter(d, readings(d, {"pose": 4.0}))
    s = r.searcher
    told = structures.rank(s, r)
    kernels = [x.log_posterior for x in s.singles(r.y) if x.index < 0]
    large = s.nulls(r.y)[[not b.normal for b in s.levels]] + np.log(0.15)
    assert told.unknown == pytest.approx(np.logaddexp.reduce([*kernels, *large]))


@pytest.mark.parametrize(
    ("gaps", "extended"), [({"cable.pull": 8.0, "pose": 40.0}, False), ({"cable.pull": 8.0}, True)]
)
def test_what_an_unknown_cause_explains_far_better_is_not_extended(gaps, extended, monkeypatch):
    d = dictionary()
    r = refitter(d, readings(d, {"base.tilt": 2.0} | gaps))
    tried, fit = [], type(r).extended
    monkeypatch.setattr(type(r), "extended", lambda *a: tried.append(a) or fit(*a))
    single = r.fit(named(d, "base.tilt"), 0)
    bare = float(r.searcher.nulls(r.y).max())
    sets, *_ = structures._extended(r.searcher, r, [single], -np.inf, bare)
    assert bool(tried) == bool(sets) == extended


def test_what_is_claimable_is_what_counts_and_is_no_stated_number():
    d = dictionary()
    r = refitter(d, readings(d, {"base.tilt": 0.8, "cable.pull": 0.7, "tool.mass": 9.0}))
    f = r.fit(named(d, "tool.mass", "cable.pull", "base.tilt"), 0)
    assert claimable(r, f) == [2]


def test_nothing_has_the_evidence_of_normal_backgrounds_and_its_prior():
    d = dictionary()
    r = refitter(d, readings(d, {"base.tilt": 0.2}))
    told = r.nothing()
    nulls = r.searcher.nulls(r.y)
    assert told.log_posterior == pytest.approx(np.logaddexp.reduce(nulls[:3]) + np.log(0.35))
    assert told.rung == int(np.argmax(nulls[:3]))
    assert (told.parts, len(told.x)) == ((), 0)
    assert (told.residual == r.y).all()


def test_one_more_effect_has_prior_odds_of_two_ninths():
    """The linear evidence of a second effect beside a first, on all levels of its background and
    smaller ones of healthy robots, is that of dense normal densities."""
    d = dictionary()
    r = refitter(d, readings(d, {"base.tilt": 2.0, "cable.pull": 1.0}))
    tilt, pull = named(d, "base.tilt", "cable.pull")
    f = r.fit((tilt,), 2)
    index = d.hypotheses.index(pull)
    added = [s for s in r.added(f) if s.index == index]
    assert [s.rung for s in added] == [f.rung, *range(f.rung)] and f.rung > 0
    beside = f.design * f.spread

    def density(rung, *more):
        x = np.column_stack([beside, *more])
        level = r.searcher.levels[rung]
        covariance = np.diag(level.v0) + (level.E * level.V) @ level.E.T + x @ x.T
        square = f.y @ np.linalg.solve(covariance, f.y) + np.linalg.slogdet(covariance)[1]
        return r.rung_prior[rung] - 0.5 * square

    each = [
        density(s.rung, z * d.E[:, pull.columns]) for s in added for z in r.searcher.scales(pull)
    ]
    gained = np.logaddexp.reduce(each) - np.log(len(r.searcher.scales(pull)))
    gained -= np.logaddexp.reduce([density(s.rung) for s in added])
    total = np.logaddexp.reduce([s.log_posterior for s in added]) - f.log_posterior
    assert total == pytest.approx(gained + r.searcher.prior(pull) + np.log(0.1 / 0.45), rel=1e-6)
    assert not any(x.index == d.hypotheses.index(tilt) for x in r.added(f))


def test_a_blamed_number_is_set_free():
    d = dictionary(tolerance=0.05)
    r = refitter(d, readings(d, {"tool.mass": 36.0}))
    (mass,) = named(d, "tool.mass")
    f = r.fit((mass,), 0)
    assert len(f.x) == 0 and f.design.shape[1] == 1
    level = r.level((mass,), 1)
    rung = r.searcher.levels[1]
    assert level.V[6] == pytest.approx(rung.V[6] + 30.0**2)
    assert np.delete(level.V, 6) == pytest.approx(np.delete(rung.V, 6))
    assert r.level((mass,), 1) is level
    assert r.level((), 1) is rung


@pytest.mark.parametrize("columns", [5, 60], ids=["many rows", "many columns"])
def test_each_block_is_predicted_from_all_others(columns):
    rng = np.random.default_rng(columns)
    rows = 24
    E = rng.standard_normal((rows, columns))
    level = BackgroundLevel(
        E, np.tile(rng.uniform(0.5, 2.0, 6), rows // 6), rng.uniform(0.1, 1.0, columns)
    )
    design, spread = rng.standard_normal((rows, 3)), np.array([1.0, 0.5, 2.0])
    y = rng.standard_normal(rows)
    f = Finalist((), 0, np.zeros(3), np.eye(3), y, y, design, spread, 0.0)
    block = np.array([0, 0, 1, 2])
    K = np.diag(level.v0) + (E * level.V) @ E.T + (design * spread**2) @ design.T
    errors = np.empty(rows)
    for b in range(3):
        own = np.repeat(block, 6) == b
        gain = K[np.ix_(own, ~own)] @ np.linalg.inv(K[np.ix_(~own, ~own)])
        mean = gain @ y[~own]
        errors[own] = y[own] - mean
    assert prediction_errors(level, f, block) == pytest.approx(errors, rel=1e-6)
