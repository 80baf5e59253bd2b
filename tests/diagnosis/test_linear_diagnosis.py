"""The core of the diagnosis on a linear robot whose gaps are known: what is named, and what not."""

import pytest

from linear_case import dictionary, readings, refitter
from wrenchbed.diagnosis.decision.decide import leading
from wrenchbed.diagnosis.decision.options import facts_of
from wrenchbed.diagnosis.explain.structures import rank


def diagnosed(gaps, **options):
    d = dictionary(**options)
    r = refitter(d, readings(d, gaps))
    ranking = rank(r.searcher, r)
    return ranking, leading(facts_of(ranking, None, None))


def causes(verdict):
    return [c.names for c in verdict.causes]


@pytest.mark.parametrize("effect", ["base.tilt", "joint.offset", "timing.delay", "tool.loose"])
def test_one_effect_is_named_with_the_gap_that_it_adds(effect):
    ranking, verdict = diagnosed({effect: 3.0})
    assert (verdict.word, causes(verdict)) == ("identified", [(effect,)])
    assert verdict.causes[0].probability > 0.99
    assert verdict.causes[0].part.share == pytest.approx(3.0, abs=0.02)
    assert verdict.explanation.rest == pytest.approx(0.0, abs=0.02)
    assert ranking.gap == pytest.approx(3.0)


@pytest.mark.parametrize(("gap", "verdict"), [(0.5, "none"), (0.7, "none"), (0.85, "identified")])
def test_an_effect_counts_from_three_quarters_of_a_gap(gap, verdict):
    ranking, found = diagnosed({"base.tilt": gap})
    assert found.word == verdict
    assert causes(found) == ([("base.tilt",)] if gap > 0.75 else [])
    assert ranking.explanations[0].finalist.names == ("base.tilt",)  # seen it is all the same


@pytest.mark.parametrize(
    "gaps",
    [
        {"base.tilt": 3.0, "cable.pull": 2.0},
        {"tool.loose": 2.5, "joint.offset": 1.5, "link.length": 1.2},
    ],
    ids=["two", "three"],
)
def test_several_effects_are_named_together_largest_first(gaps):
    _, verdict = diagnosed(gaps)
    assert verdict.word == "identified"
    assert causes(verdict) == [(n,) for n in gaps]
    assert [c.part.share for c in verdict.causes] == pytest.approx([*gaps.values()], abs=0.05)
    assert min(c.probability for c in verdict.causes) > 0.99


FOUR = {"base.tilt": 3.0, "cable.pull": 2.0, "joint.offset": 1.5, "tool.loose": 1.2}


def test_four_effects_at_once_are_more_than_is_named():
    ranking, verdict = diagnosed(FOUR)
    assert verdict.word == "unknown"
    assert max(len(e.parts) for e in ranking.explanations) == 3
    small = FOUR | {"tool.loose": 0.3}  # stands beside three without being named
    ranking, verdict = diagnosed(small)
    assert causes(verdict) == [("base.tilt",), ("cable.pull",), ("joint.offset",)]
    assert set(ranking.explanations[0].finalist.names) == set(small)
    ranking, _ = diagnosed(small | {"link.length": 0.3})
    assert max(len(e.finalist.names) for e in ranking.explanations) == 4


def test_effects_that_look_the_same_are_rivals_and_those_that_do_not_are_none():
    pair = ("joint.offset", "sensor.temperature")
    _, same = diagnosed({"joint.offset": 3.0}, alike={pair: 0.9999})
    assert same.word == "ambiguous"
    assert [set(c) for c in causes(same)] == [set(pair)]
    _, other = diagnosed({"joint.offset": 3.0}, alike={pair: 0.9})
    assert (other.word, causes(other)) == ("identified", [("joint.offset",)])


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


def test_a_wrong_mass_is_named_beside_an_effect():
    _, verdict = diagnosed({"tool.mass": 8.0, "base.tilt": 3.0})
    assert causes(verdict) == [("tool.mass",), ("base.tilt",)]
    assert verdict.causes[1].part.share == pytest.approx(3.0, abs=0.02)
    assert verdict.causes[0].part.share == pytest.approx(8.0, abs=0.8)


def test_every_explanation_is_better_than_negligible_and_one_says_nothing():
    ranking, _ = diagnosed({"base.tilt": 0.5})
    told = [e.log_posterior for e in ranking.explanations]
    assert told == sorted(told, reverse=True)
    assert told[-1] > told[0] - 30.0
    ranking, verdict = diagnosed({})
    assert any(not e.finalist.names for e in ranking.explanations)
    assert (verdict.word, verdict.causes) == ("none", ())  # noise alone is no gap
    assert verdict.probabilities["none"] > 0.99
    assert ranking.gap == pytest.approx(0.0, abs=1e-9)
