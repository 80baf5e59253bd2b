"""What may be claimed, from explanations whose probabilities are stated: numbers by hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from linear_case import Named
from wrenchbed.diagnosis.explain.claims import Explanation, Part
from wrenchbed.diagnosis.explain.structures import Ranking
from wrenchbed.diagnosis.explain.verdict import Verdict, allowed, complete, decide, tempered

TILT, PULL, GAIN, OFFSET = "base.tilt", "cable.pull", "sensor.gain", "joint.offset"


def explanation(weight, *named, rest=0.0, shares=None, twins=(), probability=1.0, form=0.06):
    """An explanation of some weight; the first effect that is named adds most."""
    shares = shares or [3.0 - 0.1 * k for k in range(len(named))]
    finalist = SimpleNamespace(
        parts=tuple(SimpleNamespace(name=n, effect=Named(n, form)) for n in named),
        names=named, log_posterior=float(np.log(weight)),
    )  # fmt: skip
    parts = tuple(
        Part(n, s, probability, k, twins if k == 0 else ())
        for k, (n, s) in enumerate(zip(named, shares, strict=True))
    )
    return Explanation(finalist, parts, rest)


def ranking(*told, unknown=1e-9, mixed=1e-12, gap=4.0, votes=()):
    told = sorted(told, key=lambda e: -e.log_posterior)
    return Ranking(tuple(told), float(np.log(unknown)), float(np.log(mixed)), "time", gap, votes)


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
    verdict = decide(ranking(*told, unknown=0.05))
    assert verdict.verdict == "ambiguous"
    assert names(verdict) == [(TILT, PULL)]
    assert verdict.causes[0].probability == pytest.approx(0.8)
    assert verdict.explanation is told[0]
    expected = {f"{TILT}|{PULL}": 0.8, "none": 0.15, "unknown": 0.05}
    assert dict(verdict.probabilities) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("share", "verdict"), [(0.03, "ambiguous"), (0.015, "identified")]
)  # fmt: skip
def test_a_rival_has_a_fiftieth_of_its_class_with_odds_halved_in_logarithm(share, verdict):
    odds = (share / (1.0 - share)) ** 2
    found = decide(ranking(explanation(1.0, TILT), explanation(odds, PULL), unknown=1e-6))
    assert found.verdict == verdict
    assert names(found) == ([(TILT, PULL)] if verdict == "ambiguous" else [(TILT,)])
    own = (1.0 - share, share) if verdict == "ambiguous" else (1.0,)
    assert found.causes[0].shares == pytest.approx(own, rel=1e-3)
    if verdict == "identified":  # what is no rival keeps its own probability
        assert found.probabilities[PULL] == pytest.approx(odds, rel=1e-2)


def test_every_part_that_counts_is_a_cause_with_rivals_of_its_own():
    told = [
        explanation(0.7, TILT, PULL, GAIN),
        explanation(0.2, TILT, OFFSET, GAIN),  # in the place of the pull
        explanation(0.1, TILT, PULL),
    ]
    verdict = decide(ranking(*told))
    assert names(verdict) == [(TILT,), (PULL, OFFSET), (GAIN,)]
    assert [c.probability for c in verdict.causes] == pytest.approx([1.0, 1.0, 0.9])
    assert verdict.verdict == "ambiguous"
    alone = decide(ranking(told[0]))
    assert names(alone) == [(TILT,), (PULL,), (GAIN,)]
    assert alone.verdict == "identified"


def test_an_explanation_that_says_more_is_no_rival():
    verdict = decide(ranking(explanation(0.6, TILT), explanation(0.4, PULL, GAIN)))
    assert names(verdict) == [(TILT,)]
    assert verdict.probabilities[PULL] == pytest.approx(0.4)


def test_the_leading_effect_collects_all_explanations_that_it_leads():
    told = [explanation(0.4, TILT), explanation(0.3, TILT, GAIN), explanation(0.3)]
    verdict = decide(ranking(*told))
    assert verdict.probabilities[TILT] == pytest.approx(0.7)


@pytest.mark.parametrize(
    ("pair", "verdict"),
    [
        (("mount.rotation", "joint.offset"), "identified"),
        (("sensor.crosstalk", "mount.rotation"), "identified"),
        (("joint.offset", "sensor.crosstalk"), "ambiguous"),
    ],
)
def test_only_what_no_data_could_tell_apart_is_identified_with_a_rival(pair, verdict):
    found = decide(ranking(explanation(0.6, pair[0]), explanation(0.4, pair[1])))
    assert (found.verdict, names(found)) == (verdict, [pair])


@pytest.mark.parametrize(("gap", "verdict"), [(0.7, "none"), (0.8, "unknown")])
def test_a_small_gap_is_nothing_unknown(gap, verdict):
    found = decide(ranking(explanation(0.1), unknown=0.9, gap=gap))
    assert found.verdict == verdict
    assert found.probabilities["unknown"] == pytest.approx(0.0 if gap < 0.75 else 0.9)
    claimed = decide(ranking(explanation(0.3), explanation(0.1, TILT), unknown=0.6, gap=gap))
    assert claimed.verdict == verdict and not claimed.causes


def test_what_leaves_too_much_competes_with_something_unknown():
    left = explanation(1.0, TILT, rest=9.0)
    likely = np.exp(3.0) / (1.0 + np.exp(3.0))
    found = decide(ranking(left))
    assert found.probabilities["unknown"] == pytest.approx(likely, rel=1e-6)
    assert (found.verdict, found.causes, found.explanation) == ("unknown", (), left)
    beside = decide(ranking(left, mixed=100.0))
    assert beside.probabilities["unknown"] == pytest.approx(100.0 / 101.0, rel=1e-6)
    assert decide(ranking(explanation(1.0, TILT))).verdict == "identified"


@pytest.mark.parametrize(("rivals", "verdict"), [(4, "ambiguous"), (5, "unknown")])
def test_more_than_four_rivals_are_no_answer(rivals, verdict):
    told = [explanation(0.5, TILT), *(explanation(0.05, f"a.{k}") for k in range(rivals))]
    assert decide(ranking(*told)).verdict == verdict


def test_a_twin_is_a_rival_whatever_its_evidence():
    verdict = decide(ranking(explanation(1.0, TILT, PULL, twins=(GAIN, PULL))))
    assert names(verdict) == [(TILT, GAIN), (PULL,)]
    assert verdict.verdict == "ambiguous"


@pytest.mark.parametrize(("ahead", "named"), [(3.5, [(TILT, PULL)]), (2.5, [(TILT,)])])
def test_who_foretells_blocks_clearly_better_is_a_rival(ahead, named):
    told = [explanation(1.0, TILT), explanation(1e-5, PULL)]
    assert names(decide(ranking(*told, votes=(7.0, 7.0 + ahead)))) == named
    assert names(decide(ranking(*told, votes=()))) == [(TILT,)]


def test_the_most_probable_of_none_unknown_and_claims_is_the_verdict():
    none = decide(ranking(explanation(0.5), explanation(0.4, TILT), unknown=0.1))
    assert (none.verdict, none.causes) == ("none", ())
    assert none.explanation.parts == ()
    unknown = decide(ranking(explanation(0.1), explanation(0.4, TILT), unknown=0.5))
    assert (unknown.verdict, unknown.causes) == ("unknown", ())
    assert unknown.explanation.names == {TILT}
    claim = decide(ranking(explanation(0.3), explanation(0.4, TILT), unknown=0.3))
    assert (claim.verdict, names(claim)) == ("identified", [(TILT,)])


def test_a_wrong_number_is_as_sure_as_its_part():
    verdict = decide(ranking(explanation(0.9, "tool.mass", probability=0.6), explanation(0.1)))
    assert verdict.causes[0].probability == pytest.approx(0.54)


def test_doubt_about_no_claim_goes_to_unknown_and_about_unknown_to_all_others():
    none = Verdict("none", (), None, {TILT: 0.1, "none": 0.8, "unknown": 0.1})
    told = tempered(none, 0.5).probabilities
    assert dict(told) == pytest.approx({TILT: 0.1, "none": 0.4, "unknown": 0.5})
    unknown = Verdict("unknown", (), None, {TILT: 0.1, "none": 0.1, "unknown": 0.8})
    told = tempered(unknown, 0.5).probabilities
    assert dict(told) == pytest.approx({TILT: 0.3, "none": 0.3, "unknown": 0.4})
    alone = Verdict("unknown", (), None, {"unknown": 1.0})
    assert dict(tempered(alone, 0.7).probabilities) == pytest.approx({"unknown": 0.7, "none": 0.3})
