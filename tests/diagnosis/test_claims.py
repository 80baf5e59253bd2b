"""What an explanation says of its parts and of the stated numbers, with hand-computed gaps."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtr

from linear_case import dictionary, readings, refitter
from wrenchbed.diagnosis.evidence.dictionary import EffectDictionary
from wrenchbed.diagnosis.explain.claims import beside, explained, stated, wrong_numbers, zero_offset
from wrenchbed.diagnosis.explain.contributions import doubled, twins

JOINTS = ("joint.offset", "joint.backlash")


def hypotheses(d, names):
    return tuple(next(h for h in d.hypotheses if h.name == n) for n in names)


def finalist(gaps, parts=None, rung=0, **options):
    """What refits the readings of some gaps, and the structure of these parts."""
    d = dictionary(**options)
    r = refitter(d, readings(d, gaps))
    return r, r.fit(hypotheses(d, parts or tuple(gaps)), rung)


def shares(explanation):
    return {p.name: p.share for p in explanation.parts}


def test_parts_count_from_three_quarters_and_the_rest_is_left():
    r, f = finalist({"base.tilt": 3.0, "cable.pull": 1.0, "tool.loose": 0.5})
    told = explained(r, f)
    assert [p.name for p in told.parts] == ["base.tilt", "cable.pull"]
    assert shares(told) == pytest.approx({"base.tilt": 3.0, "cable.pull": 1.0}, abs=0.02)
    assert told.rest == pytest.approx(0.5, abs=0.02)
    assert [f.parts[p.index].name for p in told.parts] == ["base.tilt", "cable.pull"]
    assert [p.twins for p in told.parts] == [(), ()]


def test_parts_that_cancel_out_add_nothing():
    r, f = finalist({"base.tilt": 0.5}, JOINTS, alike={JOINTS: 0.999})
    away = replace(f, x=np.array([2.0, -2.0]), residual=r.y)
    assert explained(r, away).parts == ()


def test_small_parts_that_stand_in_for_each_other_count_together():
    """Each adds 0.6 alone; together √0.6² · 2 (1 + 0.97) = 2.36, nearly all of it one's."""
    r, f = finalist({}, JOINTS, alike={JOINTS: 0.97})
    x = np.full(2, np.sqrt(0.6 / 4.0))
    r.y = r.y + r.response(f.parts, x)
    told = explained(r, replace(f, x=x))
    assert len(told.parts) == 1
    assert told.parts[0].share == pytest.approx(1.2 * 1.97 * 0.985, rel=0.01)
    assert told.rest == pytest.approx(1.2 * 1.97 * 0.015, abs=0.01)


def test_what_stands_in_must_count_and_something_must_be_left():
    r, f = finalist({}, JOINTS, alike={JOINTS: 0.0})
    for gap, named in ((0.6, 0), (0.74, 0), (0.2, 0)):
        x = np.full(2, np.sqrt(gap / 4.0))
        r.y = f.y + r.response(f.parts, x)
        told = explained(r, replace(f, x=x))
        assert len(told.parts) == named
        assert told.rest == pytest.approx(2.0 * gap, abs=0.01)


@pytest.mark.parametrize(
    ("other", "small", "kept"),
    [
        ("sensor.gain", 0.9, False),  # 6 % of 20 is 1.2: the form of the large one may miss it
        ("sensor.gain", 1.4, True),
        ("tool.loose", 0.9, True),  # another subsystem
    ],
)
def test_a_small_part_may_be_what_the_form_of_a_larger_one_of_its_kind_misses(other, small, kept):
    effects = {"sensor.temperature": 1, other: 1}
    r, f = finalist({"sensor.temperature": 20.0, other: small}, effects=effects)
    names = [p.name for p in explained(r, f).parts]
    assert names == (["sensor.temperature", other] if kept else ["sensor.temperature"])


def test_a_cable_and_an_environment_push_alike():
    effects = {"environment.contact": 1, "cable.pull": 1}
    r, f = finalist({"environment.contact": 20.0, "cable.pull": 0.9}, effects=effects)
    assert [p.name for p in explained(r, f).parts] == ["environment.contact"]


# ---- stated numbers -----------------------------------------------------------------------------


@pytest.mark.parametrize("rung", [0, 2])
def test_errors_of_stated_numbers_are_estimated_without_their_tolerance(rung):
    r, f = finalist({"tool.mass": 2.0, "base.tilt": 3.0}, ("base.tilt",), rung, tolerance=0.05)
    told = stated(r, f)
    v0 = r.searcher.rungs[f.rung].level.v0[0]
    precision = 4.0 * len(r.y) / v0 + 1.0 / 30.0**2
    expected = np.zeros(10)
    expected[6] = np.sqrt(2.0 / 4.0)
    assert told.mean == pytest.approx(expected, abs=1e-3)
    assert np.diagonal(told.covariance) == pytest.approx(np.full(10, 1.0 / precision), rel=1e-6)
    assert beside(r, f) == pytest.approx(expected, abs=1e-3)


def test_what_a_small_part_holds_of_a_stated_number_is_given_back():
    """0.2 of a jump whose column has 0.6 of a bias's: 0.12 of a bias, unless it is named."""
    effects = {"sensor.jump": 1}
    alike = {("sensor.bias", "sensor.jump"): 0.6}
    r, f = finalist({"sensor.jump": 0.16}, effects=effects, alike=alike)
    small, large = replace(f, x=np.array([0.2])), replace(f, x=np.array([2.0]))
    assert stated(r, small).mean[0] == pytest.approx(0.12, abs=0.02)
    assert stated(r, large).mean[0] == pytest.approx(0.0, abs=0.02)
    assert stated(r, small).mean[1:] == pytest.approx(np.zeros(9), abs=1e-3)


@pytest.mark.parametrize(
    ("error", "tolerance", "named"),
    [
        (0.45, 0.48, False),
        (1.5, 0.3, True),
        (0.6, 0.1, True),
        (0.4, 0.1, False),  # surely wrong, but it adds a gap of 0.64
        (9.0, np.inf, False),  # nothing is stated
    ],
)
def test_a_stated_number_is_wrong_when_it_is_far_off_and_counts(error, tolerance, named):
    r, f = finalist({"tool.mass": 4.0 * error**2}, ("base.tilt",), tolerance=tolerance)
    found = wrong_numbers(r, f)
    assert [p.name for p in found] == (["tool.mass"] if named else [])
    if named:
        assert found[0].share == pytest.approx(4.0 * error**2, rel=0.01)
        assert found[0].probability > 0.95
        assert found[0].index is None


@pytest.mark.parametrize(
    ("name", "tolerance", "error", "imperfections"),
    [
        ("tool.mass", 0.45, 0.53, 0.0),
        ("sensor.bias", 0.4, 0.6, 0.4 / np.sqrt(24.0)),  # 0.4 σ: a bias column is 2 √6 σ a row
    ],
)
def test_how_surely_a_number_is_wrong_is_by_its_odds(name, tolerance, error, imperfections):
    """0.15 times the density of a slip of the pen, five tolerances wide, against that within."""
    r, f = finalist({name: 4.0 * error**2}, ("base.tilt",), tolerance=tolerance)
    k = [e for e, _ in r.d.label].index(name)
    told = stated(r, f)
    assert told.mean[k] == pytest.approx(error, abs=1e-3)
    std = np.hypot(np.sqrt(told.covariance[k, k]), imperfections)
    off = told.mean[[e == name for e, _ in r.d.label[:10]]]
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
    [("sensor.drift", 1, True), ("tool.loose", 1, False), ("sensor.crosstalk", 9, True),
     ("sensor.crosstalk", 8, False)],
)  # fmt: skip
def test_the_zero_of_a_drift_is_a_convention(name, columns, moves):
    effects = {name: columns}
    r, f = finalist({}, (name,), effects=effects, alike={("sensor.bias", name): 0.6})
    x = np.zeros(columns)
    x[0] = 0.5
    at = replace(f, x=x)
    zero = zero_offset(r, at)
    if not moves:
        assert zero == pytest.approx(np.zeros(10))
        return
    signal = r.response(f.parts, x).reshape(-1, 6)
    expected = np.zeros(10)
    expected[0] = 0.6 * 0.5
    if name == "sensor.drift":  # its range, beside a bias of 2 √6 in each row of a channel
        expected[:6] += np.ptp(signal, axis=0) / np.sqrt(24.0)
    assert zero == pytest.approx(expected, abs=1e-9)


def test_the_sensors_own_weight_is_bounded_while_stated_numbers_are_exact():
    d = dictionary(effects={"tool.self_weight": 1, "base.tilt": 1}, tolerance=0.3)
    r = refitter(d, readings(d, {}))
    f = r.fit(hypotheses(d, ("base.tilt",)), 0)
    beside(r, f)
    (level,) = r.exact.values()
    own = d.of_effect("tool.self_weight")
    assert level.V[own] == pytest.approx(0.1**2)  # half of a fifth of its typical size
    assert level.V[d.stated] == pytest.approx(np.zeros(10))
    tight = dictionary(effects={"tool.self_weight": 1, "base.tilt": 1}, tolerance=0.1)
    size = np.where(np.arange(len(tight.size)) == 6, 3.0, 1.0)
    values = {k: getattr(tight, k) for k in tight.__dataclass_fields__} | {"size": size}
    r = refitter(EffectDictionary(**values), readings(tight, {}))
    beside(r, r.fit(hypotheses(tight, ("base.tilt",)), 0))
    (level,) = r.exact.values()
    assert level.V[own] == pytest.approx(min(0.1, 0.5 * 0.1 * 3.0) ** 2)


# ---- twins --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("correlation", "gap", "found"),
    [(0.995, 3.0, True), (0.985, 3.0, False), (0.995, 20.0, False), (0.9985, 20.0, True)],
)
def test_a_twin_leaves_a_fiftieth_or_a_tenth_of_a_gap(correlation, gap, found):
    """A share 1 − ρ² is left: 1 % and 3 % of 3; of 20 a tenth of a gap is half a percent."""
    pair = ("cable.pull", "sensor.temperature")
    effects = {"cable.pull": 1, "sensor.temperature": 1, "base.tilt": 2}
    r, f = finalist({"cable.pull": gap}, effects=effects, alike={pair: correlation})
    told = explained(r, f)
    assert told.parts[0].twins == (("sensor.temperature",) if found else ())
    assert twins(r, f, 0, gap, {0}) == told.parts[0].twins


def test_a_twin_has_as_many_numbers():
    pair = ("cable.pull", "base.tilt")
    for columns, found in ((2, ("base.tilt",)), (3, ())):
        effects = {"cable.pull": 2, "base.tilt": columns}
        r, f = finalist({"cable.pull": 3.0}, effects=effects, alike={pair: 0.999})
        assert twins(r, f, 0, 3.0, {0}) == found


def test_a_part_that_is_named_itself_is_no_twin():
    pair = ("cable.pull", "sensor.temperature")
    effects = {"cable.pull": 1, "sensor.temperature": 1}
    r, f = finalist({"cable.pull": 3.0}, pair, effects=effects, alike={pair: 0.999})
    x = np.array([0.8, 0.01])
    assert twins(r, replace(f, x=x), 0, 3.0, {0, 1}) == ()
    assert twins(r, replace(f, x=x), 0, 3.0, {0}) == ("sensor.temperature",)


@pytest.mark.parametrize(
    ("pair", "correlation", "found"),
    [
        (("joint.offset", "joint.backlash"), 0.9, ("joint.backlash",)),
        (("joint.offset", "joint.backlash"), -0.9, ("joint.backlash",)),
        (("joint.offset", "joint.backlash"), 0.8, ()),
        (("tool.mass_error", "tool.loose"), 0.9, ()),  # no joint, no link
        (("joint.offset", "link.length"), 0.9, ("link.length",)),  # the same number of a place
    ],
)
def test_a_small_part_of_the_same_joint_that_reads_alike_is_a_twin(pair, correlation, found):
    effects = dict.fromkeys(pair, 1)
    r, f = finalist({pair[0]: 3.0}, pair, effects=effects, alike={pair: correlation})
    at = replace(f, x=np.array([0.8, 0.1]))
    assert twins(r, at, 0, 3.0, {0}) == found
    assert twins(r, at, 0, 3.0, {0, 1}) == ()


@pytest.mark.parametrize(("correlation", "twice"), [(0.995, True), (0.985, False)])
def test_a_part_that_makes_what_another_makes_is_doubled(correlation, twice):
    pair = ("cable.pull", "sensor.temperature")
    effects = {"cable.pull": 1, "sensor.temperature": 1, "tool.loose": 1}
    names = (*pair, "tool.loose")
    r, f = finalist({"cable.pull": 3.0}, names, effects=effects, alike={pair: correlation})
    some = hypotheses(r.d, ("cable.pull", "tool.loose", "sensor.temperature"))
    both = replace(f, parts=some, x=np.array([0.8, 0.5, -0.3]))
    assert doubled(r, both) is twice
    assert not doubled(r, replace(f, x=np.array([0.8, 0.3, 0.5])))  # only the last is asked
