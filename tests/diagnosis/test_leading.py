"""What may be claimed, from explanations whose probabilities are stated: numbers by hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from linear_case import Named
from wrenchbed.diagnosis.decision.decide import leading, reliable
from wrenchbed.diagnosis.decision.options import facts_of
from wrenchbed.diagnosis.explain.claims import Explanation, allowed, complete
from wrenchbed.diagnosis.explain.structures import Ranking
from wrenchbed.diagnosis.explain.verdict import Cause, Part, Verdict

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


def test_an_explanation_that_says_more_is_no_rival_and_adds_to_what_leads_it():
    verdict = decided(explanation(0.6, TILT), explanation(0.4, PULL, GAIN))
    assert names(verdict) == [(TILT,)]
    assert verdict.probabilities[PULL] == pytest.approx(0.4)
    both = decided(explanation(0.4, TILT), explanation(0.3, TILT, GAIN), explanation(0.3))
    assert both.probabilities[TILT] == pytest.approx(0.7)


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


def test_without_its_rule_a_claim_has_no_rivals():
    options = [explanation(0.6, TILT), explanation(0.4, PULL)]
    assert names(decided(*options, without={"rivals"})) == [(TILT,)]


def test_a_twin_is_a_rival_whatever_its_evidence():
    verdict = decided(explanation(1.0, TILT, PULL, twins=(GAIN, PULL)))
    assert (verdict.word, names(verdict)) == ("ambiguous", [(TILT, GAIN), (PULL,)])


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
    facts = SimpleNamespace(right=lambda *_: right)
    said = Verdict("identified" if claims else verdict, causes, None, given)
    told = reliable(facts, said, SimpleNamespace(further={}))
    assert told.word == verdict.partition(" ")[0]
    assert [c.probability for c in told.causes] == pytest.approx([right] * (right > 0.5) * claims)
    assert {TILT: 0.0} | dict(told.probabilities) == pytest.approx(
        dict(zip((TILT, "none", "unknown"), after, strict=True))
    )
