"""An accelerometer beside the wrench: agreement, both together, and what may then be claimed."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from linear_case import dictionary, named, readings, refitter
from ntnu import GRAVITY, static
from wrenchbed.diagnosis.explain.claims import Explanation, explained
from wrenchbed.diagnosis.explain.tilt import agreement, sentences, with_accelerometer
from wrenchbed.diagnosis.explain.verdict import Part, Verdict
from wrenchbed.diagnosis.prepare import accelerometer
from wrenchbed.physics.rotations import cross

TILT = "base.tilt"
COVARIANCE = np.array([[4e-4, 1e-4], [1e-4, 9e-4]])
SEEN = np.sqrt(0.1)
"""The tilt that adds a gap of 0.4 with its first column."""


def analysed(gaps, tilt, parts=None, probability=0.95):
    """An analysis whose only explanations are of these parts, and nothing."""
    d = dictionary()
    r = refitter(d, readings(d, gaps))
    f = r.fit(named(d, *(parts or gaps)), 0)
    with_parts, without = np.log([probability, 1.0 - probability])
    told = [
        explained(r, replace(f, log_posterior=float(with_parts))),
        Explanation(replace(r.nothing(), log_posterior=float(without)), (), 0.0),
    ]
    told.sort(key=lambda e: -e.log_posterior)
    testimony = accelerometer.Testimony(np.array(tilt), COVARIANCE, 5.0, 0.01, 100)
    return SimpleNamespace(
        ranking=SimpleNamespace(explanations=tuple(told), unknown=-np.inf),
        prepared=SimpleNamespace(testimony=testimony),
        refitter=r,
        dictionary=d,
    )


def cause(name, probability=0.95, gap=0.4):
    return SimpleNamespace(names=(name,), probability=probability, part=Part(name, gap, index=0))


def tilted(a):
    return next(e for e in a.ranking.explanations if TILT in e.finalist.names)


def verdict_of(a, kind, *causes):
    told = {"none": 0.6, "unknown": 0.3, TILT: 0.1}
    return Verdict(kind, tuple(causes), a.ranking.explanations[0], told)


def test_agreement_is_the_chance_of_a_difference_as_large():
    a = analysed({TILT: 0.4}, [0.35, 0.05])
    f = tilted(a).finalist
    away = f.x - np.array([0.35, 0.05])
    square = away @ np.linalg.inv(f.covariance + COVARIANCE) @ away
    assert agreement(a, tilted(a), a.prepared.testimony) == pytest.approx(np.exp(-square / 2))
    assert 0.01 < np.exp(-square / 2) < 0.9


def test_both_sensors_together_are_their_weighted_mean():
    a = analysed({TILT: 0.4}, [0.35, 0.02])
    told = with_accelerometer(a, verdict_of(a, "none"))
    before, after = tilted(a).finalist, told.explanation.finalist
    one, other = np.linalg.inv(before.covariance), np.linalg.inv(COVARIANCE)
    together = np.linalg.inv(one + other)
    assert after.covariance == pytest.approx(together)
    assert after.x == pytest.approx(together @ (one @ before.x + other @ [0.35, 0.02]))
    assert after.residual == pytest.approx(a.refitter.y - before.design @ after.x)


def test_a_small_tilt_that_both_see_is_claimed():
    a = analysed({TILT: 0.4}, [SEEN, 0.0])
    told = with_accelerometer(a, verdict_of(a, "none"))
    assert told.word == "identified"
    (cause,) = told.causes
    assert (cause.names, cause.part.name, cause.part.index) == ((TILT,), TILT, 0)
    assert cause.probability == pytest.approx(0.95)
    assert cause.part.share == pytest.approx(0.4, abs=0.01)
    # what is left of probability goes to the others in proportion, what was the tilt's to unknown
    assert dict(told.probabilities) == pytest.approx({TILT: 0.95, "none": 0.03, "unknown": 0.02})


@pytest.mark.parametrize(
    ("gap", "probability", "tilt", "sentence"),
    [
        (0.2, 0.95, np.sqrt(0.05), 1),  # less than a quarter of a gap
        (0.4, 0.85, SEEN, 1),  # not sure enough
        (0.4, 0.95, SEEN + 0.2, 1),  # the two contradict each other
        (0.4, 0.95, None, 0),
    ],
    ids=["small", "unsure", "apart", "no testimony"],
)
def test_otherwise_the_verdict_stays(gap, probability, tilt, sentence):
    a = analysed({TILT: gap}, [tilt or 0.0, 0.0], probability=probability)
    if tilt is None:
        a.prepared.testimony = None
    verdict = verdict_of(a, "none")
    assert with_accelerometer(a, verdict) is verdict
    assert len(sentences(a, verdict)) == sentence


def test_without_a_tilt_the_verdict_stays():
    other = analysed({"cable.pull": 3.0}, [0.3, 0.0])
    verdict = verdict_of(other, "identified")
    assert with_accelerometer(other, verdict) is verdict
    assert len(sentences(other, verdict)) == 1


def test_a_tilt_joins_the_causes_of_the_same_explanation():
    a = analysed({"cable.pull": 3.0, TILT: 0.4}, [SEEN, 0.0])
    pull = cause("cable.pull", 0.9, 3.0)
    told = with_accelerometer(a, verdict_of(a, "identified", pull))
    assert [c.names for c in told.causes] == [("cable.pull",), (TILT,)]
    assert told.causes[1].part.index == 1
    assert told.explanation.finalist.x[2] == pytest.approx(SEEN, abs=0.02)
    elsewhere = replace(verdict_of(a, "identified", pull), explanation=a.ranking.explanations[1])
    assert with_accelerometer(a, elsewhere) is elsewhere


def test_a_tilt_that_is_claimed_already_is_only_measured_better():
    a = analysed({TILT: 3.0}, [np.sqrt(0.75) + 0.01, 0.0])
    claim = SimpleNamespace(names=(TILT,), probability=0.7, part=tilted(a).parts[0])
    told = with_accelerometer(a, verdict_of(a, "identified", claim))
    assert told.causes == (claim,)
    before, after = tilted(a).finalist, told.explanation.finalist
    assert np.diagonal(after.covariance).max() < np.diagonal(before.covariance).max()
    assert before.x[0] < after.x[0] < np.sqrt(0.75) + 0.01


def test_people_are_told_whether_they_agree_and_what_is_left():
    a = analysed({TILT: 0.4, "pose": 3.0}, [SEEN, 0.0], parts=(TILT,))
    a.prepared.testimony = replace(a.prepared.testimony, tilt=tilted(a).finalist.x)
    verdict = replace(verdict_of(a, "identified", cause(TILT)), explanation=tilted(a))
    first, second = sentences(a, verdict)
    assert "agrees (p = 1)" in first
    assert "remaining gap of 3" in second or "remaining gap of 2.9" in second
    assert len(sentences(a, replace(verdict, causes=(cause(TILT, gap=9.0),)))) == 1
    a.prepared.testimony = replace(a.prepared.testimony, tilt=a.prepared.testimony.tilt + 0.3)
    assert "does not agree" in sentences(a, verdict)[0]
    a.prepared.testimony = replace(a.prepared.testimony, log_bayes=0.5)
    assert "measures a tilt of the base" in sentences(a, verdict)[0]
    a.prepared.testimony = replace(a.prepared.testimony, log_bayes=-0.1)
    assert sentences(a, verdict)[0].startswith("the accelerometer measures no tilt")


def test_beside_a_number_that_is_blamed_only_the_tilt_is_updated():
    a = analysed({"tool.mass": 9.0, TILT: 0.4}, [SEEN, 0.0])
    before = tilted(a).finalist
    assert (len(before.x), before.covariance.shape) == (2, (3, 3))
    after = with_accelerometer(a, verdict_of(a, "none")).explanation.finalist
    assert len(after.x) == 2
    assert after.x[0] == pytest.approx(SEEN, abs=0.02)


# ---- what it says by itself ----------------------------------------------------------------------


def measured(rotation, rng, tilt=(0.0, 0.0), noise=0.02):
    """Of an accelerometer mounted anyhow, 2 % of gain errors, an unknown zero (H, 3) [m/s²]."""
    mounted = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    seen = (GRAVITY + cross(np.array([*tilt, 0.0]), GRAVITY)) @ rotation
    gain = mounted @ (np.eye(3) + 0.02 * rng.standard_normal((3, 3)))
    return seen @ gain + rng.standard_normal(3) + noise * rng.standard_normal(seen.shape)


def test_an_accelerometer_sees_no_tilt_where_there_is_none():
    rotation, rng = static().rotation, np.random.default_rng(1)
    fits = (accelerometer.fitted(measured(rotation, rng), rotation, GRAVITY) for _ in range(60))
    odds = [f.log_bayes for f in fits]
    assert np.median(odds) < -2.0
    assert np.max(odds) < 2.0


def test_an_accelerometers_tilt_is_right_within_its_uncertainty():
    rotation, rng = static().rotation, np.random.default_rng(2)
    tilt = np.deg2rad([0.2, -0.15])
    chi2 = []
    for _ in range(100):
        t = accelerometer.fitted(measured(rotation, rng, tilt), rotation, GRAVITY)
        assert t.log_bayes > 3.0
        chi2.append((t.tilt - tilt) @ np.linalg.solve(t.covariance, t.tilt - tilt))
    assert np.mean(chi2) == pytest.approx(2.0, abs=0.7)


def test_too_few_orientations_say_nothing():
    rotation, rng = static().rotation, np.random.default_rng(0)
    assert accelerometer.fitted(measured(rotation[:8], rng), rotation[:8], GRAVITY) is None
    same = np.repeat(rotation[:1], 24, axis=0)
    assert accelerometer.fitted(measured(same, rng), same, GRAVITY) is None
