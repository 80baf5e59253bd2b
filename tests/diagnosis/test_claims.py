"""What is named of a linear robot whose gaps are known, and what is said of its stated numbers."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtr

from linear_case import Design, dictionary, named, noise, readings, refitter
from wrenchbed.diagnosis.decision.decide import leading
from wrenchbed.diagnosis.decision.facts import facts_of
from wrenchbed.diagnosis.explain.claims import (
    explained,
    stated,
    stated_errors_beside,
    wrong_numbers,
    zero_offset,
)
from wrenchbed.diagnosis.explain.contributions import doubled, imitators, twins
from wrenchbed.diagnosis.explain.structures import rank


def diagnosed(gaps, **options):
    d = dictionary(**options)
    r = refitter(d, readings(d, gaps))
    ranking = rank(r.searcher, r)
    return ranking, leading(facts_of(ranking, None, None))


def causes(verdict):
    return [c.names for c in verdict.causes]


FOUR = {"base.tilt": 3.0, "cable.pull": 2.0, "joint.offset": 1.5, "tool.loose": 1.2}


def test_effects_that_look_the_same_are_rivals_and_those_that_do_not_are_none():
    pair = ("joint.offset", "sensor.temperature")
    _, same = diagnosed({"joint.offset": 3.0}, alike={pair: 0.9999})
    assert same.word == "ambiguous"
    assert [set(c) for c in causes(same)] == [set(pair)]
    ranking, other = diagnosed({"joint.offset": 3.0}, alike={pair: 0.9})
    told = [e.log_posterior for e in ranking.explanations]
    assert told == sorted(told, reverse=True) and told[-1] > told[0] - 30.0
    assert (other.word, causes(other)) == ("identified", [("joint.offset",)])


def test_an_effect_that_only_moves_a_stated_number_is_that_number():
    """A part that is loose to one side reads as a wrong centre of gravity and adds nothing else."""
    d = dictionary(alike={("tool.cog", "tool.loose"): 0.99999})
    r = refitter(d, readings(d, {"tool.cog": 300.0}))
    told = explained(r, r.fit(named(d, "tool.loose"), 0))
    assert [p.name for p in told.parts] == ["tool.cog"] and not told.finalist.effects


def test_a_cause_that_only_correlated_noise_makes_large_is_named(monkeypatch):
    """Channels whose noise is one signal: their differences count, as in the published gap."""
    _, independent = diagnosed({"base.tilt": 0.6})
    assert independent.word == "none"
    monkeypatch.setattr(Design.leading, "covariance", np.full((6, 6), 0.9) + 0.1 * np.eye(6))
    _, correlated = diagnosed({"base.tilt": 0.6})
    assert causes(correlated) == [("base.tilt",)]


@pytest.mark.parametrize(
    ("gaps", "kernel"),
    [({"time": 8.0}, "time"), ({"pose": 8.0}, "pose"), ({"base.tilt": 3.0, "pose": 6.0}, "pose")],
)
def test_what_no_effect_makes_is_unknown_and_depends_on_what_it_depends(gaps, kernel):
    ranking, verdict = diagnosed(gaps)
    assert (verdict.word, verdict.causes, ranking.kernel) == ("unknown", (), kernel)
    assert ranking.gap == pytest.approx(sum(gaps.values()), rel=0.01)
    if "base.tilt" in gaps:  # something unknown beside an effect is seen
        assert ranking.mixed > ranking.unknown
        assert verdict.explanation.rest == pytest.approx(6.0, abs=0.4)


def test_a_wrong_mass_is_named_beside_an_effect_and_four_effects_are_too_many():
    _, verdict = diagnosed({"tool.mass": 8.0, "base.tilt": 3.0})
    assert causes(verdict) == [("tool.mass",), ("base.tilt",)]
    assert verdict.causes[1].part.share == pytest.approx(3.0, abs=0.02)
    assert verdict.causes[0].part.share == pytest.approx(8.0, abs=0.8)
    ranking, verdict = diagnosed(FOUR)
    assert verdict.word == "unknown"
    assert max(len(e.parts) for e in ranking.explanations) == 3
    small = FOUR | {"tool.loose": 0.3}  # stands beside three without being named
    ranking, verdict = diagnosed(small)
    assert causes(verdict) == [("base.tilt",), ("cable.pull",), ("joint.offset",)]
    assert set(ranking.explanations[0].finalist.names) == set(small)
    ranking, _ = diagnosed(small | {"link.length": 0.3})
    assert max(len(e.finalist.names) for e in ranking.explanations) == 4


JOINTS = ("joint.offset", "joint.backlash")
PAIR = ("cable.pull", "sensor.temperature")


def finalist(gaps, parts=None, rung=0, **options):
    """What refits the readings of some gaps, and the structure of these parts."""
    d = dictionary(**options)
    r = refitter(d, readings(d, gaps))
    return r, r.fit(named(d, *(parts or gaps)), rung)


def names(explanation):
    return [p.name for p in explanation.parts]


def test_parts_count_from_three_quarters_unless_they_cancel_out():
    r, f = finalist({"base.tilt": 3.0, "cable.pull": 1.0, "tool.loose": 0.5})
    told = explained(r, f)
    assert names(told) == ["base.tilt", "cable.pull"]
    assert [p.share for p in told.parts] == pytest.approx([3.0, 1.0], abs=0.02)
    assert told.rest == pytest.approx(0.5, abs=0.02)
    assert [f.parts[p.index].name for p in told.parts] == names(told)
    assert [p.twins for p in told.parts] == [(), ()]
    r, f = finalist({"base.tilt": 0.5}, JOINTS, alike={JOINTS: 0.999})
    assert explained(r, replace(f, x=np.array([2.0, -2.0]), residual=r.y)).parts == ()


@pytest.mark.parametrize(
    ("gap", "alike", "parts", "rest"),
    [
        (0.6, 0.97, [1.2 * 1.97 * 0.985], 1.2 * 1.97 * 0.015),  # together √0.6² · 2 (1 + 0.97)
        (0.6, 0.0, [], 0.0),  # explained, though neither counts
        (0.2, 0.0, [], 0.0),
    ],
)
def test_small_parts_count_together_where_they_stand_in_for_each_other(gap, alike, parts, rest):
    r, f = finalist({}, JOINTS, alike={JOINTS: alike})
    x = np.full(2, np.sqrt(gap / 4.0))
    r.y = r.y + r.response(f.parts, x)
    told = explained(r, replace(f, x=x))
    assert [p.share for p in told.parts] == pytest.approx(parts, rel=0.01)
    assert told.rest == pytest.approx(rest, abs=0.01)


@pytest.mark.parametrize(
    ("large", "other", "small", "kept"),
    [
        ("sensor.temperature", "sensor.gain", 0.9, False),  # 6 % of 20: a form may miss it
        ("sensor.temperature", "sensor.gain", 1.4, True),
        ("sensor.temperature", "tool.loose", 0.9, True),  # another subsystem
        ("environment.contact", "cable.pull", 0.9, False),  # both push
    ],
)
def test_a_small_part_may_be_what_the_form_of_a_larger_one_of_its_kind_misses(
    large, other, small, kept
):
    r, f = finalist({large: 20.0, other: small}, effects={large: 1, other: 1})
    assert names(explained(r, f)) == ([large, other] if kept else [large])


def test_another_cause_makes_the_readings_beside_a_stated_number_that_they_move():
    """What a cable pulls always, a heavier tool on a tilted base weighs."""
    d = dictionary(effects={"cable.pull": 1, "base.tilt": 1})
    name = [e for e, _ in d.label]
    mass, cable, tilt = map(name.index, ("tool.mass", "cable.pull", "base.tilt"))
    d.E[:, cable] = 0.6 * d.E[:, tilt] + 0.8 * d.E[:, mass]
    d = replace(d)  # what it computed of its columns, again
    r = refitter(d, noise(d) + 2.0 * d.E[:, cable])
    assert imitators(r, r.fit(named(d, "cable.pull"), 0), 0) == ("base.tilt",)


@pytest.mark.parametrize("rung", [0, 2])
def test_errors_of_stated_numbers_are_estimated_without_their_tolerance(rung):
    r, f = finalist({"tool.mass": 2.0, "base.tilt": 3.0}, ("base.tilt",), rung, tolerance=0.05)
    told = stated(r, f)
    v0 = r.searcher.levels[f.rung].v0[0]
    precision = 4.0 * len(r.y) / v0 + 1.0 / 30.0**2
    expected = np.sqrt(2.0 / 4.0) * np.eye(10)[6]
    assert told.mean == pytest.approx(expected, abs=1e-3)
    assert np.diagonal(told.covariance)[6:] == pytest.approx(np.full(4, 1.0 / precision), rel=1e-6)
    assert stated_errors_beside(r, f) == pytest.approx(expected, abs=1e-3)


def test_the_uncertainty_of_a_zero_holds_what_is_constant_in_imperfections():
    """A drift begins at 0: of a gap of 0.1, as every robot may have, the zero takes three quarters.

    What is left is that of a robot with less.
    """
    drift = "sensor.drift"
    d = dictionary(effects={drift: 1}, alike={("sensor.bias", drift): np.sqrt(0.75)})
    column = [e for e, _ in d.label].index(drift)
    r = refitter(d, noise(d) + np.sqrt(0.1 / 4.0) * d.E[:, column])
    nothing = r.nothing()
    told = stated(r, nothing)
    assert nothing.rung == 0
    assert abs(told.mean[0]) < 1.645 * told.std[0]  # without a fault it is 0


@pytest.mark.parametrize(
    ("error", "tolerance", "wrong"),
    [
        (0.45, 0.48, False),
        (1.5, 0.3, True),
        (0.6, 0.1, True),
        (0.4, 0.1, False),  # surely wrong, but it adds a gap of 0.64
        (9.0, np.inf, False),  # nothing is stated
    ],
)
def test_a_stated_number_is_wrong_when_it_is_far_off_and_counts(error, tolerance, wrong):
    r, f = finalist({"tool.mass": 4.0 * error**2}, ("base.tilt",), tolerance=tolerance)
    found = wrong_numbers(r, f)
    assert [p.name for p in found] == (["tool.mass"] if wrong else [])
    for p in found:
        assert p.share == pytest.approx(4.0 * error**2, rel=0.01)
        assert p.probability > 0.95 and p.index is None


@pytest.mark.parametrize(
    ("name", "tolerance", "error"), [("tool.mass", 0.45, 0.53), ("sensor.bias", 0.4, 0.48)]
)
def test_how_surely_a_number_is_wrong_is_by_its_odds(name, tolerance, error):
    """0.15 times the density of a slip of the pen, five tolerances wide, against that within."""
    r, f = finalist({name: 4.0 * error**2}, ("base.tilt",), tolerance=tolerance)
    label = [e for e, _ in r.d.label[:10]]
    told, k = stated(r, f), label.index(name)
    assert told.mean[k] == pytest.approx(error, abs=1e-3)
    std = np.sqrt(told.covariance[k, k])
    off = told.mean[[e == name for e in label]]
    inside = ndtr((tolerance - off) / std) - ndtr((-tolerance - off) / std)
    width = np.hypot(std, 5.0 * tolerance)
    wrong = 1.0 / (np.pi * width * (1.0 + (off / width) ** 2))
    odds = 0.15 * wrong / (inside / (2.0 * tolerance))
    sure = 1.0 - np.prod(1.0 / (1.0 + odds))  # that one of them is wrong
    (found,) = wrong_numbers(r, f)
    assert found.name == name
    assert 0.5 < sure < 0.99
    assert found.probability == pytest.approx(sure, abs=2e-3)


@pytest.mark.parametrize(
    ("name", "columns", "moves"),
    [
        ("sensor.drift", 1, True),
        ("tool.slide", 1, True),
        ("tool.loose", 1, False),
        ("sensor.crosstalk", 9, True),
        ("sensor.crosstalk", 8, False),
    ],
)
def test_the_zero_of_a_drift_is_a_convention(name, columns, moves):
    r, f = finalist({}, (name,), effects={name: columns}, alike={("sensor.bias", name): 0.6})
    x = 0.5 * np.eye(columns)[0]
    expected = np.zeros(10)
    if moves:
        expected[0] = 0.6 * 0.5
    if name == "sensor.drift":  # its range, beside a bias of 2 √6 in each row of a channel
        signal = r.response(f.parts, x).reshape(-1, 6)
        expected[:6] += np.ptp(signal, axis=0) / np.sqrt(24.0)
    assert zero_offset(r, replace(f, x=x)) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(
    ("tolerance", "mass_size", "bound"),
    [(0.3, 1.0, 0.1), (0.1, 3.0, min(0.1, 0.5 * 0.1 * 3.0))],  # half of a fifth of its size
)
def test_the_sensors_own_weight_is_bounded_while_stated_numbers_are_exact(
    tolerance, mass_size, bound
):
    d = dictionary(effects={"tool.self_weight": 1, "base.tilt": 1}, tolerance=tolerance)
    size = np.where(np.arange(len(d.size)) == 6, mass_size, 1.0)
    r = refitter(replace(d, size=size), readings(d, {}))
    stated_errors_beside(r, r.fit(named(d, "base.tilt"), 0))
    (level,) = r.exact.values()
    assert level.V[d.of_effect("tool.self_weight")] == pytest.approx(bound**2)
    assert level.V[d.stated] == pytest.approx(np.zeros(10))


@pytest.mark.parametrize(
    ("correlation", "gap", "found"),
    [(0.995, 3.0, True), (0.985, 3.0, False), (0.995, 20.0, False), (0.9985, 20.0, True)],
)
def test_a_twin_leaves_a_fiftieth_or_a_tenth_of_a_gap(correlation, gap, found):
    """A share 1 − ρ² is left: 1 % and 3 % of 3; of 20 a tenth of a gap is half a percent."""
    effects = dict.fromkeys(PAIR, 1) | {"base.tilt": 2}
    r, f = finalist({"cable.pull": gap}, effects=effects, alike={PAIR: correlation})
    told = explained(r, f).parts[0].twins
    assert told == twins(r, f, 0, gap, {0}) == (("sensor.temperature",) if found else ())


@pytest.mark.parametrize(("columns", "found"), [(2, ("base.tilt",)), (3, ())])
def test_a_twin_has_as_many_numbers(columns, found):
    effects = {"cable.pull": 2, "base.tilt": columns}
    r, f = finalist(
        {"cable.pull": 3.0}, effects=effects, alike={("cable.pull", "base.tilt"): 0.999}
    )
    assert twins(r, f, 0, 3.0, {0}) == found


@pytest.mark.parametrize(("correlation", "twice"), [(0.995, True), (0.985, False)])
def test_a_part_that_makes_what_another_makes_is_doubled(correlation, twice):
    every = (*PAIR, "tool.loose")
    effects = dict.fromkeys(every, 1)
    r, f = finalist({"cable.pull": 3.0}, every, effects=effects, alike={PAIR: correlation})
    some = named(r.d, "cable.pull", "tool.loose", "sensor.temperature")
    both = replace(f, parts=some, x=np.array([0.8, 0.5, -0.3]))
    assert doubled(r, both) is twice
    assert not doubled(r, replace(f, x=np.array([0.8, 0.3, 0.5])))  # only the last is asked
