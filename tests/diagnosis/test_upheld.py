"""Held-out rows have the last word: verdicts and gaps made by hand, and what remains of them."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wrenchbed.diagnosis.explain.claims import Part
from wrenchbed.diagnosis.explain.verdict import Cause, Verdict
from wrenchbed.diagnosis.gap.closure import Interval
from wrenchbed.diagnosis.gap.upheld import DOUBTFUL, REFUTED, small, surely, upheld, withdrawn

TILT, GAIN, BIAS = "base.tilt", "sensor.gain", "sensor.bias"


def about(value, half=0.1):
    return Interval(value, value - half, value + half)


LARGE = about(6.0)


def gap(members=None, closed=None, calibrated=LARGE, floor=0.0, channels=None):
    """Gaps on held-out rows, as far as a verdict depends on them."""
    excess = calibrated.value - max(floor, 0.0)
    members = {k: v if isinstance(v, Interval) else about(v) for k, v in (members or {}).items()}
    share = about(closed) if isinstance(closed, float) else closed
    return SimpleNamespace(
        calibrated=calibrated,
        floor=floor,
        excess=excess,
        members=members,
        closed=share,
        channels=calibrated.value if channels is None else channels,
    )


def claimed(*names, verdict="identified", lead=0.9, **others):
    """A verdict with these causes, each a name or a class "a|b"; the first leads."""
    of = [tuple(n.split("|")) for n in names]
    causes = tuple(Cause(n, lead, Part(n[0], 2.0, index=k)) for k, n in enumerate(of))
    rest = {"none": 0.0, "unknown": 1.0 - lead} | others
    return Verdict(verdict, causes, None, {names[0]: lead} | rest)


def without(verdict, none):
    return Verdict(verdict, (), None, {"none": none, "unknown": 1.0 - none})


def names(verdict):
    return [c.names[0] for c in verdict.causes]


def test_a_claim_that_closes_the_gap_stays_as_it_is():
    verdict = claimed(TILT)
    told = upheld(verdict, gap({TILT: 5.0}, 0.9))
    assert (told.verdict, told.causes) == ("identified", verdict.causes)
    assert told.probabilities == verdict.probabilities


@pytest.mark.parametrize(
    "closes",
    [Interval(2.0, -0.01, 4.0), Interval(2.0, 0.0, 4.0), about(0.49, 0.05), about(-3.0), None],
    ids=["interval holds 0", "interval begins at 0", "too little", "makes it larger", "nothing"],
)
def test_a_claim_that_held_out_rows_do_not_show_is_withdrawn(closes):
    members = {} if closes is None else {TILT: closes}
    told = upheld(claimed(TILT), gap(members, 0.9))
    assert (told.verdict, told.causes) == ("unknown", ())
    assert told.probabilities[TILT] == pytest.approx(REFUTED * 0.9)
    assert told.probabilities["unknown"] == pytest.approx(0.1 + (1.0 - REFUTED) * 0.9)


def test_what_holds_is_above_zero_and_large_enough():
    assert surely(Interval(0.5, 0.01, 2.0)) and surely(about(3.0))
    assert not surely(Interval(0.5, 0.0, 2.0)) and not surely(Interval(0.49, 0.4, 0.6))
    assert not surely(None)


def test_all_causes_together_must_close_something():
    """Each stands in for the other: without one nothing is lost, and both close nothing."""
    told = upheld(claimed(TILT, GAIN), gap({TILT: 5.0, GAIN: 5.0}, Interval(0.2, -0.1, 0.4)))
    assert (told.verdict, told.causes) == ("unknown", ())
    assert upheld(claimed(TILT), gap({TILT: 5.0}, None)).verdict == "unknown"


def test_a_claim_where_there_is_hardly_a_gap_becomes_none():
    told = upheld(claimed(TILT), gap({TILT: -0.2}, 0.1, calibrated=about(0.8)))
    assert (told.verdict, told.causes) == ("none", ())
    assert told.probabilities["none"] == pytest.approx((1.0 - REFUTED) * 0.9)
    assert told.probabilities["unknown"] == pytest.approx(0.1)


def test_only_what_is_refuted_goes():
    told = upheld(claimed(TILT, GAIN), gap({TILT: 4.0, GAIN: Interval(0.4, -1.0, 3.0)}, 0.7))
    assert told.verdict == "identified" and names(told) == [TILT]
    assert told.probabilities == claimed(TILT, GAIN).probabilities


def test_a_cause_that_few_poses_show_is_doubtful_beside_a_sure_one():
    few = Interval(1.0, -1.0, 3.0)
    told = upheld(claimed(TILT, GAIN), gap({TILT: 4.0, GAIN: few}, 0.7))
    assert [c.probability for c in told.causes] == [0.9, DOUBTFUL]
    rare = upheld(claimed(TILT, GAIN, lead=0.3), gap({TILT: 4.0, GAIN: few}, 0.7))
    assert [c.probability for c in rare.causes] == [0.3, 0.3]
    swapped = upheld(claimed(GAIN, TILT), gap({TILT: 4.0, GAIN: few}, 0.7))
    assert names(swapped) == [TILT, GAIN] and swapped.probabilities[TILT] == pytest.approx(0.9)
    assert upheld(claimed(GAIN), gap({GAIN: few}, 0.7)).verdict == "unknown"


def test_the_next_cause_leads_where_the_leading_one_goes():
    verdict = claimed(TILT, "sensor.gain|tool.mass", verdict="ambiguous", **{GAIN: 0.0})
    told = upheld(verdict, gap({TILT: 0.1, GAIN: 4.0}, 0.7))
    assert told.verdict == "ambiguous" and names(told) == [GAIN]
    assert TILT not in told.probabilities
    assert told.probabilities["sensor.gain|tool.mass"] == pytest.approx(0.9)


def test_nothing_is_ambiguous_where_the_cause_with_rivals_goes():
    verdict = claimed(TILT, "sensor.gain|tool.mass", verdict="ambiguous")
    told = upheld(verdict, gap({TILT: 4.0, GAIN: 0.1}, 0.7))
    assert told.verdict == "identified" and names(told) == [TILT]


@pytest.mark.parametrize(("closed", "told"), [(0.49, "partial"), (0.5, "identified")])
def test_causes_that_close_less_than_half_are_partial(closed, told):
    verdict = upheld(claimed(TILT), gap({TILT: 2.0}, closed))
    assert verdict.verdict == told and names(verdict) == [TILT]
    assert verdict.probabilities == claimed(TILT).probabilities


def test_what_another_sensor_measured_stays_but_explains_no_gap():
    refuting = gap({TILT: -0.3}, -0.2)
    assert upheld(claimed(TILT), refuting).verdict == "unknown"
    told = upheld(claimed(TILT), refuting, witnessed=(TILT,))
    assert told.verdict == "partial" and names(told) == [TILT]
    assert upheld(claimed(GAIN), gap({GAIN: -0.3}, -0.2), (TILT,)).verdict == "unknown"
    both = upheld(claimed(GAIN, TILT), gap({GAIN: -0.3, TILT: 0.0}, -0.2), (TILT,))
    assert names(both) == [TILT]


def test_a_witness_of_a_rival_is_one_of_the_class():
    verdict = claimed("cable.pull|base.tilt", verdict="ambiguous")
    told = upheld(verdict, gap({"cable.pull": -0.3}, -0.2), (TILT,))
    assert told.verdict == "partial" and names(told) == ["cable.pull"]


def test_none_with_a_gap_becomes_unknown():
    told = upheld(without("none", 0.97), gap(calibrated=about(3.0)))
    assert told.verdict == "unknown"
    assert told.probabilities["none"] == pytest.approx(REFUTED * 0.97)
    kept = without("none", 0.97)
    assert upheld(kept, gap(calibrated=about(0.9))) is kept
    # loud noise is no gap
    assert upheld(kept, gap(calibrated=about(9.0), floor=8.5)) is kept
    assert upheld(kept, gap(calibrated=Interval(1.3, 0.8, 2.0))).verdict == "unknown"


def test_unknown_without_a_gap_becomes_none():
    told = upheld(without("unknown", 0.2), gap(calibrated=Interval(0.2, 0.1, 0.3)))
    assert told.verdict == "none"
    assert told.probabilities["unknown"] == pytest.approx(REFUTED * 0.8)
    kept = without("unknown", 0.2)
    assert upheld(kept, gap(calibrated=Interval(0.6, 0.3, 1.4))) is kept


@pytest.mark.parametrize(
    ("calibrated", "floor", "is_small"),
    [(about(1.0), 0.0, True), (about(1.05), 0.0, False), (about(2.0), 1.5, True),
     (about(9.0), 7.9, False), (about(0.9), -2.0, True), (about(1.1), -2.0, False)],
)  # fmt: skip
def test_a_small_gap_is_one_at_most_beyond_the_noise(calibrated, floor, is_small):
    assert small(gap(calibrated=calibrated, floor=floor)) is is_small


def test_small_is_judged_channel_by_channel():
    """Noise that channels share makes the same imperfection a larger gap."""
    shared = Interval(1.15, 0.76, 1.59)
    assert small(gap(calibrated=shared, channels=0.3))
    assert not small(gap(calibrated=about(1.3), channels=0.3))  # more than 1 for sure
    assert not small(gap(calibrated=Interval(9.0, 0.1, 20.0), channels=9.0))  # one pose of many


def test_what_is_withdrawn_leaves_a_little_of_each_name():
    verdict = claimed(TILT, lead=0.6, **{GAIN: 0.2, "none": 0.1, "unknown": 0.1})
    told = withdrawn(verdict, "unknown").probabilities
    assert told[TILT] == pytest.approx(0.03) and told[GAIN] == pytest.approx(0.01)
    assert told["none"] == pytest.approx(0.005)
    assert told["unknown"] == pytest.approx(0.1 + 0.95 * 0.9)


CLASSES = ("base.tilt", "sensor.gain|tool.mass", "cable.pull", "joint.offset|joint.backlash")


def test_a_doubtful_cause_does_not_lead_in_the_place_of_a_witnessed_one():
    """What another sensor measured closes nothing here; the other's interval holds zero."""
    members = {TILT: Interval(0.0, 0.0, 0.0), "cable.pull": Interval(1.0, 0.0, 1.0)}
    told = upheld(claimed(TILT, "cable.pull"), gap(members, 1.0), [TILT])
    assert names(told)[0] == TILT
    assert all(c.probability <= DOUBTFUL for c in told.causes[1:])


SHARE = st.floats(0.001, 1.0)
CLOSES = st.builds(
    lambda value, below, above: Interval(value, value - below, value + above),
    st.floats(-5.0, 9.0), st.floats(0.0, 4.0), st.floats(0.0, 4.0),
)  # fmt: skip


@st.composite
def verdicts(draw):
    """A verdict of up to three causes with probabilities that sum to 1, and how far it gets."""
    classes = draw(st.lists(st.sampled_from(CLASSES), max_size=3, unique=True))
    others = draw(st.lists(st.sampled_from(("tool.loose", "sensor.gain", "tool.cog")), unique=True))
    keys = [*classes[:1], *others, "none", "unknown"]
    weight = [draw(SHARE) for _ in keys]
    share = {k: w / sum(weight) for k, w in zip(keys, weight, strict=True)}
    causes = tuple(
        Cause(of := tuple(c.split("|")), draw(SHARE), Part(of[0], 2.0, index=k))
        for k, c in enumerate(classes)
    )
    kind = "identified" if classes else draw(st.sampled_from(("none", "unknown")))
    if any("|" in c for c in classes):
        kind = "ambiguous"
    members = {c.names[0]: draw(CLOSES) for c in causes}
    closed = draw(st.one_of(st.none(), CLOSES)) if classes else None
    measured = gap(members, closed, draw(CLOSES), draw(st.floats(-1.0, 2.0)))
    witnessed = draw(st.lists(st.sampled_from(("base.tilt", "tool.mass")), unique=True))
    return Verdict(kind, causes, None, share), measured, witnessed


@given(verdicts())
def test_whatever_is_refuted_probabilities_sum_to_1_and_nothing_is_claimed_that_is(case):
    verdict, measured, witnessed = case
    told = upheld(verdict, measured, witnessed)
    assert sum(told.probabilities.values()) == pytest.approx(1.0)
    assert min(told.probabilities.values()) >= 0.0
    assert {c.names for c in told.causes} <= {c.names for c in verdict.causes}
    for c in told.causes:
        sure = surely(measured.members[c.names[0]]) or set(c.names) & set(witnessed)
        assert sure or (c.probability <= DOUBTFUL and c is not told.causes[0])
    assert bool(told.causes) == (told.verdict in ("identified", "ambiguous", "partial"))
    if told.causes:
        assert "|".join(told.causes[0].names) in told.probabilities
    if told.verdict == "none":
        assert small(measured) or measured.calibrated.high - max(measured.floor, 0.0) < 1.0
    # once more changes no cause, so measuring again with what remains comes to an end
    assert upheld(told, measured, witnessed).causes == told.causes


def test_a_wrong_number_closes_nothing_after_the_fit_and_stays_by_its_own_gap():
    """Any fit of mass takes a wrong mass, so the calibrated gap does not show it."""
    mass = claimed("tool.mass")
    of_number = replace(mass.causes[0], part=Part("tool.mass", 9.0))
    mass = replace(mass, causes=(of_number,))
    members = {"tool.mass": about(9.0)}
    told = upheld(mass, gap(members, Interval(-0.1, -0.3, 0.1)))
    assert names(told) == ["tool.mass"]
    assert names(upheld(claimed(TILT), gap({TILT: 9.0}, Interval(-0.1, -0.3, 0.1)))) == []
    assert names(upheld(mass, gap({"tool.mass": about(9.0, 9.5)}, 0.1))) == []
