"""The decision's rules on verdicts, gaps and explanations made by hand."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from linear_case import Named
from wrenchbed.diagnosis.decision.decide import (
    DOUBTFUL,
    WITHDRAWN,
    conclude,
    decide,
    held_out,
    leading,
    partial,
    probable,
    reliable,
    size,
    small,
    surely,
)
from wrenchbed.diagnosis.decision.facts import Decision, Facts, facts_of
from wrenchbed.diagnosis.explain.claims import Explanation, allowed, complete
from wrenchbed.diagnosis.explain.structures import Ranking
from wrenchbed.diagnosis.explain.verdict import Cause, Option, Part, Verdict
from wrenchbed.diagnosis.gap.gap_bootstrap import Closure, Interval

TILT, PULL, GAIN, OFFSET = "base.tilt", "cable.pull", "sensor.gain", "joint.offset"


def explanation(weight, *named, rest=0.0, shares=None, twins=(), probability=1.0, form=0.06):
    """An explanation of some weight; the first effect that is named adds most."""
    shares = shares or [3.0 - 0.1 * k for k in range(len(named))]
    effects = tuple(SimpleNamespace(name=n, effect=Named(n, form)) for n in named)
    finalist = SimpleNamespace(parts=effects, names=named, log_posterior=float(np.log(weight)))
    parts = tuple(
        Part(n, s, probability, k, twins if k == 0 else ())
        for k, (n, s) in enumerate(zip(named, shares, strict=True))
    )
    return Explanation(finalist, parts, rest)


def decided(*explanations, unknown=1e-9, mixed=1e-12, gap=4.0, without=()):
    ranked = tuple(sorted(explanations, key=lambda e: -e.log_posterior))
    ranking = Ranking(ranked, float(np.log(unknown)), float(np.log(mixed)), "time", gap)
    return leading(facts_of(ranking, None, None), without)


def names(verdict):
    return [c.names for c in verdict.causes]


def test_what_an_explanation_may_leave_is_imperfections_and_what_its_forms_miss():
    told = explanation(1.0, TILT, PULL, shares=[2.0, 3.0], form=0.1)
    assert allowed(told) == pytest.approx(0.55 + 0.2 + 0.3)
    stated = Explanation(told.finalist, (*told.parts, Part("tool.mass", 9.0)), 1.04)
    assert allowed(stated) == pytest.approx(1.05)
    assert complete(stated)
    assert not complete(Explanation(told.finalist, told.parts, 1.06))
    overlapping = Explanation(told.finalist, told.parts, 1.5, closed=2.0 * (2.0 + 3.0))
    assert allowed(overlapping) == pytest.approx(0.55 + 2.0 * (0.2 + 0.3))


def test_probabilities_are_weights_and_rivals_share_a_class():
    told = [explanation(0.6, TILT), explanation(0.2, PULL), explanation(0.15)]
    verdict = decided(*told, unknown=0.05)
    assert (verdict.word, names(verdict)) == ("ambiguous", [(TILT, PULL)])
    assert verdict.causes[0].probability == pytest.approx(0.8)
    assert verdict.explanation is told[0]
    expected = {f"{TILT}|{PULL}": 0.8, "none": 0.15, "unknown": 0.05}
    assert dict(verdict.probabilities) == pytest.approx(expected)


@pytest.mark.parametrize(("fraction", "rivals"), [(0.03, True), (0.015, False)])
def test_a_rival_has_a_fiftieth_of_its_class_with_odds_halved_in_logarithm(fraction, rivals):
    odds = (fraction / (1.0 - fraction)) ** 2
    found = decided(explanation(1.0, TILT), explanation(odds, PULL), unknown=1e-6)
    assert found.word == ("ambiguous" if rivals else "identified")
    assert names(found) == [(TILT, PULL) if rivals else (TILT,)]
    shares = (1.0 - fraction, fraction) if rivals else (1.0,)
    assert found.causes[0].shares == pytest.approx(shares, rel=1e-3)
    if not rivals:  # what is no rival keeps its own probability
        assert found.probabilities[PULL] == pytest.approx(odds, rel=1e-2)


def test_every_part_that_counts_is_a_cause_with_rivals_of_its_own():
    first = explanation(0.7, TILT, PULL, GAIN)
    in_the_place_of_the_pull = explanation(0.2, TILT, OFFSET, GAIN)
    verdict = decided(first, in_the_place_of_the_pull, explanation(0.1, TILT, PULL))
    assert names(verdict) == [(TILT,), (PULL, OFFSET), (GAIN,)]
    assert [c.probability for c in verdict.causes] == pytest.approx([1.0, 1.0, 0.9])
    assert verdict.word == "ambiguous"
    alone = decided(first)
    assert (alone.word, names(alone)) == ("identified", [(TILT,), (PULL,), (GAIN,)])


def test_a_rival_of_two_causes_stands_in_one_class():
    options = [
        explanation(0.4, GAIN, OFFSET),
        explanation(0.3, PULL, OFFSET),
        explanation(0.3, GAIN, PULL),
    ]
    assert names(decided(*options)) == [(GAIN, PULL), (OFFSET,)]


def test_an_explanation_that_says_more_or_a_twin_is_a_rival_by_its_evidence_alone():
    verdict = decided(explanation(0.6, TILT), explanation(0.4, PULL, GAIN))
    assert names(verdict) == [(TILT,)]
    assert verdict.probabilities[PULL] == pytest.approx(0.4)
    both = decided(explanation(0.4, TILT), explanation(0.3, TILT, GAIN), explanation(0.3))
    assert both.probabilities[TILT] == pytest.approx(0.7)
    verdict = decided(explanation(1.0, TILT, PULL, twins=(GAIN, PULL)))
    assert (verdict.word, names(verdict)) == ("ambiguous", [(TILT, GAIN), (PULL,)])
    options = [explanation(0.6, TILT), explanation(0.4, PULL)]
    assert names(decided(*options, without={"rivals"})) == [(TILT,)]


@pytest.mark.parametrize(
    ("pair", "verdict"),
    [
        (("mount.rotation", "joint.offset"), "identified"),
        (("sensor.crosstalk", "mount.rotation"), "identified"),
        (("joint.offset", "sensor.crosstalk"), "ambiguous"),
    ],
)
def test_only_what_no_data_could_tell_apart_is_identified_with_a_rival(pair, verdict):
    found = decided(explanation(0.6, pair[0]), explanation(0.4, pair[1]))
    assert (found.word, names(found)) == (verdict, [pair])


@pytest.mark.parametrize(("gap", "verdict"), [(0.7, "none"), (0.8, "unknown")])
def test_a_small_gap_is_nothing_unknown(gap, verdict):
    found = decided(explanation(0.1), unknown=0.9, gap=gap)
    assert found.word == verdict
    assert found.probabilities["unknown"] == pytest.approx(0.0 if gap < 0.75 else 0.9)
    claimed = decided(explanation(0.3), explanation(0.1, TILT), unknown=0.6, gap=gap)
    assert claimed.word == verdict and not claimed.causes


def test_what_leaves_too_much_competes_with_something_unknown():
    left = explanation(1.0, TILT, rest=9.0)
    likely = np.exp(3.0) / (1.0 + np.exp(3.0))
    found = decided(left)
    assert found.probabilities["unknown"] == pytest.approx(likely, rel=1e-6)
    assert (found.word, found.causes, found.explanation) == ("unknown", (), left)
    beside = decided(left, mixed=100.0)
    assert beside.probabilities["unknown"] == pytest.approx(100.0 / 101.0, rel=1e-6)
    assert decided(explanation(1.0, TILT)).word == "identified"


@pytest.mark.parametrize(("rivals", "verdict"), [(4, "ambiguous"), (5, "unknown")])
def test_more_than_four_rivals_are_no_answer(rivals, verdict):
    told = [explanation(0.5, TILT), *(explanation(0.05, f"a.{k}") for k in range(rivals))]
    assert decided(*told).word == verdict
    for weight in (0.01, 5.0):  # of none
        odds = decided(explanation(weight), *told).probabilities
        assert max(len(key.split("|")) for key in odds) == 5
        assert sum(odds.values()) == pytest.approx(1.0)


def test_a_cause_beside_the_first_that_has_more_rivals_is_none():
    told = [explanation(0.1, TILT, f"a.{k}") for k in range(6)]
    assert names(decided(*told[:5])) == [(TILT,), tuple(f"a.{k}" for k in range(5))]
    assert names(decided(*told)) == [(TILT,)]


def test_the_most_probable_of_none_unknown_and_claims_is_the_verdict():
    none = decided(explanation(0.5), explanation(0.4, TILT), unknown=0.1)
    assert (none.word, none.causes, none.explanation.parts) == ("none", (), ())
    unknown = decided(explanation(0.1), explanation(0.4, TILT), unknown=0.5)
    assert (unknown.word, unknown.causes) == ("unknown", ())
    assert unknown.explanation.names == {TILT}
    claim = decided(explanation(0.3), explanation(0.4, TILT), unknown=0.3)
    assert (claim.word, names(claim)) == ("identified", [(TILT,)])
    number = decided(explanation(0.9, "tool.mass", probability=0.6), explanation(0.1))
    assert number.causes[0].probability == pytest.approx(0.54)  # as sure as its part


@pytest.mark.parametrize(
    ("verdict", "before", "right", "after"),
    [
        ("none", (0.1, 0.8, 0.1), 0.5, (0.1, 0.4, 0.5)),
        ("unknown", (0.1, 0.1, 0.8), 0.5, (0.3, 0.3, 0.4)),
        ("unknown", (0.0, 0.0, 1.0), 0.7, (0.0, 0.3, 0.7)),
        ("identified", (0.9, 0.04, 0.06), 0.95, (0.855, 0.04, 0.105)),
        ("unknown of a claim", (0.9, 0.04, 0.06), 0.3, (0.27, 0.04, 0.69)),
    ],
)
def test_doubt_goes_to_unknown_and_about_unknown_to_all_others(verdict, before, right, after):
    given = {k: p for k, p in zip((TILT, "none", "unknown"), before, strict=True) if p}
    claims = verdict not in ("none", "unknown")
    causes = (Cause(((TILT, None),), 1.0, Part(TILT, 2.0)),) if claims else ()
    facts = SimpleNamespace(right=lambda *_: right, seen=())
    said = Verdict("identified" if claims else verdict, causes, None, given)
    told = reliable(facts, said, gap())
    assert told.word == verdict.partition(" ")[0]
    assert [c.probability for c in told.causes] == pytest.approx([right] * (right > 0.5) * claims)
    want = dict(zip((TILT, "none", "unknown"), after, strict=True))
    assert {TILT: 0.0} | dict(told.probabilities) == pytest.approx(want)


GAIN_OR_MASS = "sensor.gain|tool.mass"
CLASSES = (TILT, GAIN_OR_MASS, PULL, "joint.offset|joint.backlash")


def about(value, half=0.1):
    return Interval(value, value - half, value + half)


LARGE, FEW = about(6.0), Interval(1.0, -1.0, 3.0)
"""A gap, and what a cause closes that few poses show."""


def gap(
    members=None, closed=None, calibrated=LARGE, floor=0.0, channels=None, in_all=None, left=None,
    further=None,
):  # fmt: skip
    """Gaps on held-out rows, as far as a verdict depends on them."""
    of = [members or {}, further or {}]
    each, other = (
        {k: v if isinstance(v, Interval) else about(v) for k, v in d.items()} for d in of
    )
    closed, in_all = (about(x) if isinstance(x, float) else x for x in (closed, in_all))
    mean = calibrated.value if channels is None else channels
    return Closure(
        mean, calibrated, left, floor, closed, None, 100, 4, {"fx": {"before": mean}}, each, {},
        in_all, other,
    )  # fmt: skip


def keys_of(names):
    return tuple((n, None) for n in names)


def upheld(verdict, measured, ordinary_fitted=False, seen=()):
    """The verdict after the rules of held-out rows."""
    facts = SimpleNamespace(
        measure=lambda _: measured, ordinary_fitted=ordinary_fitted, own_rest=False, seen=seen
    )
    for rule in (held_out, size, partial):
        verdict = rule(facts, verdict, measured)
    return verdict


def claimed(*names, verdict="identified", lead=0.9, **others):
    """A verdict with these causes, each a name or a class "a|b"; the first leads."""
    of = [tuple(n.split("|")) for n in names]
    causes = tuple(Cause(keys_of(n), lead, Part(n[0], 2.0, index=k)) for k, n in enumerate(of))
    rest = {"none": 0.0, "unknown": 1.0 - lead} | others
    return Verdict(verdict, causes, None, {names[0]: lead} | rest)


def test_a_cause_whose_size_may_be_zero_is_not_claimed():
    facts, both = SimpleNamespace(least=0.0), claimed("tool.mass", "tool.cog")
    measured = replace(gap(), untold={("tool.cog", None)})
    assert [c.names for c in probable(facts, both, measured).causes] == [("tool.mass",)]
    assert probable(facts, claimed("tool.cog"), measured).word == "unknown"
    assert probable(facts, both, gap()) == both


def without(verdict, none):
    return Verdict(verdict, (), None, {"none": none, "unknown": 1.0 - none})


def leads(verdict):
    return [c.names[0] for c in verdict.causes]


@pytest.mark.parametrize(
    ("members", "closed", "kept", "verdict"),
    [
        ({TILT: 5.0}, 0.9, [TILT], "identified"),
        ({TILT: 5.0}, 0.5, [TILT], "identified"),
        ({TILT: 5.0}, 0.49, [TILT], "partial"),
        ({TILT: Interval(2.0, 0.0, 4.0)}, 0.9, [], "unknown"),
        ({}, 0.9, [], "unknown"),
        ({TILT: 5.0}, None, [], "unknown"),
    ],
)
def test_a_claim_stays_if_held_out_rows_show_it(members, closed, kept, verdict):
    claim = claimed(TILT)
    told = upheld(claim, gap(members, closed))
    assert (told.word, leads(told)) == (verdict, kept)
    if kept:
        assert (told.causes, told.probabilities) == (claim.causes, claim.probabilities)
    else:
        assert told.probabilities[TILT] == pytest.approx(WITHDRAWN * 0.9)
        assert told.probabilities["unknown"] == pytest.approx(0.1 + (1.0 - WITHDRAWN) * 0.9)


def test_what_values_show_needs_no_held_out_row():
    measured = gap({TILT: FEW}, Interval(0.6, -0.5, 1.0))
    told = upheld(claimed(TILT), measured, seen=(TILT,))
    assert (told.word, leads(told)) == ("identified", [TILT])
    assert upheld(claimed(TILT), measured, seen=(GAIN,)).word == "unknown"


@pytest.mark.parametrize(
    ("left", "kept"), [(4.2, [TILT]), (3.8, [TILT, GAIN]), (1.0, [TILT, GAIN])]
)
def test_a_cause_far_smaller_than_what_stays_unexplained_is_not_claimed(left, kept):
    """It closes 0.6: a seventh or a sixth of the rest, or beside a rest that hardly counts."""
    measured = gap({TILT: 9.0, GAIN: 1.0}, 0.6, calibrated=about(10.0), left=about(left))
    assert leads(upheld(claimed(TILT, GAIN), measured)) == kept


def test_what_other_channels_uphold_keeps_its_probability_and_no_cause_beside_it_does():
    facts = SimpleNamespace(right=lambda *_: 0.8, seen=())
    told = reliable(facts, claimed(TILT, GAIN), gap({GAIN: 3.0}, 0.5, further={TILT: 6.0}))
    assert [c.probability for c in told.causes] == pytest.approx([0.9, 0.8 * 0.9])


@pytest.mark.parametrize(("apart", "second"), [(False, 1.0), (True, 0.4)])
def test_a_cause_in_a_device_of_its_own_is_as_sure_as_it_would_be_alone(apart, second):
    sure = {TILT: 1.0, GAIN: 0.4}
    facts = SimpleNamespace(right=lambda v, _: sure[v.causes[0].part.name], seen=())
    measured = replace(gap({TILT: 9.0, GAIN: 3.0}, 0.9), apart=apart)
    told = reliable(facts, claimed(TILT, GAIN), measured)
    assert [c.probability for c in told.causes] == pytest.approx([0.9, second * 0.9])


def test_a_claim_with_hardly_a_gap_or_few_poses_is_none_or_doubtful():
    assert surely(Interval(0.5, 0.01, 2.0)) and surely(about(3.0))
    assert not surely(Interval(0.5, 0.0, 2.0)) and not surely(Interval(0.49, 0.4, 0.6))
    assert not surely(None)
    told = upheld(claimed(TILT), gap({TILT: -0.2}, 0.1, calibrated=about(0.8)))
    assert (told.word, told.causes) == ("none", ())
    assert told.probabilities["none"] == pytest.approx((1.0 - WITHDRAWN) * 0.9)
    assert told.probabilities["unknown"] == pytest.approx(0.1)
    told = upheld(claimed(TILT, GAIN), gap({TILT: 4.0, GAIN: FEW}, 0.7))
    assert [c.probability for c in told.causes] == [0.9, DOUBTFUL]
    rare = upheld(claimed(TILT, GAIN, lead=0.3), gap({TILT: 4.0, GAIN: FEW}, 0.7))
    assert [c.probability for c in rare.causes] == [0.3, 0.3]
    swapped = upheld(claimed(GAIN, TILT), gap({TILT: 4.0, GAIN: FEW}, 0.7))
    assert leads(swapped) == [TILT, GAIN] and swapped.probabilities[TILT] == pytest.approx(0.9)
    assert upheld(claimed(GAIN), gap({GAIN: FEW}, 0.7)).word == "unknown"


def test_only_what_is_refuted_goes_and_the_next_one_leads_with_its_rivals():
    told = upheld(claimed(TILT, GAIN), gap({TILT: 4.0, GAIN: Interval(0.4, -1.0, 3.0)}, 0.7))
    assert told.word == "identified" and leads(told) == [TILT]
    assert told.probabilities == claimed(TILT, GAIN).probabilities
    # each stands in for the other: without one nothing is lost, and both close nothing
    both = upheld(claimed(TILT, GAIN), gap({TILT: 5.0, GAIN: 5.0}, Interval(0.2, -0.1, 0.4)))
    assert (both.word, both.causes) == ("unknown", ())
    verdict = claimed(TILT, GAIN_OR_MASS, verdict="ambiguous", **{GAIN: 0.0})
    told = upheld(verdict, gap({TILT: 0.1, GAIN: 4.0}, 0.7))
    assert told.word == "ambiguous" and leads(told) == [GAIN]
    assert TILT not in told.probabilities
    assert told.probabilities[GAIN_OR_MASS] == pytest.approx(0.9)
    other = upheld(claimed(TILT, GAIN_OR_MASS, verdict="ambiguous"), gap({TILT: 4, GAIN: 0.1}, 0.7))
    assert other.word == "identified" and leads(other) == [TILT]


def test_what_other_channels_show_or_only_a_number_explains_closes_no_gap():
    told = upheld(claimed(TILT), gap({TILT: 2.0}, -0.2, in_all=0.6))
    assert told.word == "partial" and leads(told) == [TILT]
    assert upheld(claimed(TILT), gap({TILT: 2.0}, -0.2, in_all=-0.2)).word == "unknown"
    assert upheld(claimed(GAIN), gap({GAIN: -0.3}, -0.2, in_all=0.6)).word == "unknown"
    both = upheld(claimed(GAIN, TILT), gap({GAIN: FEW, TILT: 2.0}, -0.2, in_all=0.6))
    assert leads(both) == [TILT]
    # Any fit of mass takes a wrong mass, so the calibrated gap does not show it.
    mass = claimed("tool.mass")
    mass = replace(mass, causes=(replace(mass.causes[0], part=Part("tool.mass", 9.0)),))
    nothing = Interval(-0.1, -0.3, 0.1)
    assert leads(upheld(mass, gap({"tool.mass": 9.0}, nothing))) == ["tool.mass"]
    assert leads(upheld(claimed(TILT), gap({TILT: 9.0}, nothing))) == []
    assert leads(upheld(mass, gap({"tool.mass": about(9.0, 9.5)}, 0.1))) == []


SOME, NEUTRAL = Interval(0.1, 0.05, 0.2), Interval(0.0, -0.1, 0.1)


@pytest.mark.parametrize(
    ("closed", "member", "probability", "stands"),
    [
        (SOME, 0.4, 0.9, True),
        (Interval(0.9, 0.8, 0.95), 0.0, 0.9, True),
        (NEUTRAL, 0.4, 0.9, False),
        (SOME, -0.4, 0.9, False),
        (SOME, 0.4, 0.7, False),
    ],
)
def test_a_cause_that_ordinary_errors_imitate_stands_by_firm_evidence_unless_rows_refute_it(
    closed, member, probability, stands
):
    """Once all stated values are fitted within their spread there is hardly a gap."""
    measured = gap({TILT: about(member)}, closed, calibrated=about(0.1))
    said = upheld(claimed(TILT, lead=probability), measured, ordinary_fitted=True)
    assert bool(said.causes) == stands
    assert said.word == ("none" if not stands else "partial" if closed is SOME else "identified")
    assert not upheld(claimed(TILT, lead=probability), measured).causes


@pytest.mark.parametrize(
    ("said", "none", "calibrated", "floor", "becomes"),
    [
        ("none", 0.97, about(3.0), 0.0, "unknown"),
        ("none", 0.97, about(0.9), 0.0, "none"),
        ("none", 0.97, about(9.0), 8.5, "none"),  # loud noise is no gap
        ("none", 0.97, Interval(1.3, 0.8, 2.0), 0.0, "unknown"),
        ("unknown", 0.2, Interval(0.2, 0.1, 0.3), 0.0, "none"),
        ("unknown", 0.2, Interval(0.6, 0.3, 1.4), 0.0, "unknown"),
    ],
)
def test_none_needs_a_small_gap_and_unknown_a_gap(said, none, calibrated, floor, becomes):
    verdict = without(said, none)
    told = upheld(verdict, gap(calibrated=calibrated, floor=floor))
    assert told.word == becomes
    if said == becomes:
        assert told is verdict
    else:
        expected = WITHDRAWN * verdict.probabilities[said]
        assert told.probabilities[said] == pytest.approx(expected)


def test_none_is_impossible_where_held_out_rows_show_a_gap():
    """Probabilities learnt of claims, and withdrawn claims, leave it some."""
    for calibrated, chance in ((about(3.0), 0.0), (about(1.05), 0.05)):
        measured = gap(calibrated=calibrated)
        option = Option(SimpleNamespace(parts=()), 0.05, ())
        facts = Facts((option,), 0.95, lambda _, g=measured: g, lambda *_: 0.95)
        verdict = decide(facts).verdict
        assert verdict.word == "unknown" and sum(verdict.probabilities.values()) == pytest.approx(1)
        assert verdict.probabilities["none"] == pytest.approx(chance, abs=0.06 if chance else 0)


@pytest.mark.parametrize(
    ("calibrated", "floor", "channels", "is_small"),
    [
        (about(1.0), 0.0, None, True),
        (about(1.05), 0.0, None, False),
        (about(1.1), -2.0, None, False),
        (Interval(1.15, 0.76, 1.59), 0.0, 0.3, True),  # noise that channels share enlarges it
        (about(1.3), 0.0, 0.3, False),  # more than 1 for sure
        (Interval(9.0, 0.1, 20.0), 0.0, 9.0, False),  # one pose of many
    ],
)
def test_a_small_gap_is_one_at_most_beyond_the_noise(calibrated, floor, channels, is_small):
    assert small(gap(calibrated=calibrated, floor=floor, channels=channels)) is is_small


def test_a_gap_of_one_joint_counts_alone_and_a_sign_without_a_cause_names_nothing():
    each = {"tau1": {"before": 0.1}, "tau2": {"before": 1.5}}
    joints = replace(gap(calibrated=about(0.8)), per_channel=each)
    assert small(joints) and not small(replace(joints, apart=True))
    for closed, word in (
        (None, "unknown"),
        (about(0.8), "unknown"),
        (about(0.99, 0.01), "identified"),
    ):
        decision = Decision(claimed("drive.delay"), replace(joints, closed=closed))
        assert conclude(decision, [{}], ["rings"]).word == word


PROBABILITY = st.floats(0.001, 1.0)
CLOSES = st.builds(
    lambda value, below, above: Interval(value, value - below, value + above),
    *(st.floats(low, high) for low, high in ((-5.0, 9.0), (0.0, 4.0), (0.0, 4.0))),
)


@st.composite
def verdicts(draw):
    """A verdict of up to three causes with probabilities that sum to 1, and how far it gets."""
    classes = draw(st.lists(st.sampled_from(CLASSES), max_size=3, unique=True))
    others = draw(st.lists(st.sampled_from(("tool.loose", "sensor.gain", "tool.cog")), unique=True))
    keys = [*classes[:1], *others, "none", "unknown"]
    weight = [draw(PROBABILITY) for _ in keys]
    each = [(tuple(c.split("|")), draw(PROBABILITY)) for c in classes]
    causes = tuple(Cause(keys_of(n), p, Part(n[0], 2.0, index=k)) for k, (n, p) in enumerate(each))
    kind = "identified" if classes else draw(st.sampled_from(("none", "unknown")))
    if any("|" in c for c in classes):
        kind = "ambiguous"
    members = {c.names[0]: draw(CLOSES) for c in causes}
    closed = draw(st.one_of(st.none(), CLOSES)) if classes else None
    in_all = draw(st.one_of(st.none(), CLOSES)) if classes else None
    measured = gap(members, closed, draw(CLOSES), draw(st.floats(-1.0, 2.0)), in_all=in_all)
    p = {k: w / sum(weight) for k, w in zip(keys, weight, strict=True)}
    return Verdict(kind, causes, None, p), measured


@given(verdicts())
def test_whatever_is_refuted_probabilities_sum_to_1_and_nothing_is_claimed_that_is(case):
    verdict, measured = case
    told = upheld(verdict, measured)
    assert sum(told.probabilities.values()) == pytest.approx(1.0)
    assert min(told.probabilities.values()) >= 0.0
    assert {c.names for c in told.causes} <= {c.names for c in verdict.causes}
    for c in told.causes:
        sure = surely(measured.members[c.names[0]])
        assert sure or (c.probability <= DOUBTFUL and c is not told.causes[0])
    assert bool(told.causes) == (told.word in ("identified", "ambiguous", "partial"))
    if told.causes:
        assert "|".join(told.causes[0].names) in told.probabilities
    if told.word == "none":
        assert small(measured) or measured.calibrated.high - max(measured.floor, 0.0) < 1.0
    # once more changes no cause, so measuring again with what remains comes to an end
    assert upheld(told, measured).causes == told.causes
