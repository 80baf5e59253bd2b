"""Causes beside a rest of the recording's own: faults by plain numpy in a real recording.

The rest is that of a real robot (24 poses, A. Skrede, NTNU 2024, doi 10.5281/zenodo.11096791).
"""

from types import SimpleNamespace

import numpy as np
import pytest

from ntnu import GRAVITY, STD, static
from real_faults import Host
from wrenchbed.diagnosis.decision.decide import confirmed, widened
from wrenchbed.diagnosis.diagnose import diagnose, settle
from wrenchbed.diagnosis.explain.claims import complete
from wrenchbed.diagnosis.explain.familiarity import LEAST_P
from wrenchbed.diagnosis.explain.own_rest import is_left, rest_variance, weighed_again
from wrenchbed.diagnosis.explain.reliability import RIGHT_ELSEWHERE, shipped
from wrenchbed.diagnosis.explain.structures import analyse
from wrenchbed.diagnosis.explain.verdict import Cause, Part, Verdict
from wrenchbed.diagnosis.gap.result import named_by
from wrenchbed.diagnosis.prepare.prepare_recording import prepare


@pytest.fixture(scope="module")
def host():
    return Host.of(static(), STD, GRAVITY)


@pytest.fixture(scope="module")
def real():
    return analyse(prepare(static(), 0))


def named(found):
    return {n for w in found.diagnosis.which for n in named_by(w)}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["sensor.jump", "sensor.crosstalk", "tool.mass"])
def test_a_fault_is_named_beside_what_the_robot_leaves_unexplained(host, name):
    found = diagnose(host.faulty(name, 20.0, np.random.default_rng(1)))
    assert name in named(found)
    assert found.diagnosis.gap.with_effects.value > 5.0  # the robot's own rest remains


@pytest.mark.sampled
@pytest.mark.parametrize("family", ["knock", "bursts", "popcorn"])
def test_a_fault_that_the_library_lacks_is_not_named(host, family):
    assert named(diagnose(host.faulty(family, 8.0, np.random.default_rng(1)))) <= {"base.tilt"}


def test_the_rest_is_measured_channel_by_channel(real):
    """Alone, bias, mass, CoG and an accelerometer's mounting leave their residual over the rows,
    less the numbers fitted."""
    nothing = real.refitter.nothing()
    d = real.at_baseline.d
    left = (d.without_stated(real.at_baseline.y).reshape(-1, 9) ** 2).sum(axis=0)
    rows, free = len(real.calibrated), 10 + 12
    by_hand = left / (rows - free / 9)
    assert rest_variance(real, nothing) == pytest.approx(by_hand, rel=1e-3)


def test_with_its_rest_as_noise_the_best_explanation_is_complete(real):
    assert is_left(real)
    again = weighed_again(real)
    assert complete(again.ranking.explanations[0])
    assert (again.dictionary.prepared.noise >= real.dictionary.prepared.noise).all()
    assert again.dictionary.prepared.noise.max() > 10.0


def test_more_rivals_take_their_probability_along_and_too_many_end_the_claim():
    lead = Cause((("sensor.drift", None),), 0.6, Part("sensor.drift", 3.0, index=0), (1.0,))
    share = {"sensor.drift": 0.6, "sensor.jump": 0.3, "unknown": 0.1}
    verdict = Verdict("identified", (lead,), SimpleNamespace(), share)
    assert widened(verdict, ("sensor.drift",)) is verdict
    told = widened(verdict, ("sensor.jump",))
    assert (told.word, told.causes[0].names) == ("ambiguous", ("sensor.drift", "sensor.jump"))
    assert told.causes[0].probability == pytest.approx(0.9)
    assert dict(told.probabilities) == {
        "sensor.drift|sensor.jump": pytest.approx(0.9),
        "unknown": 0.1,
    }
    assert told.causes[0].shares == pytest.approx((0.5, 0.5))
    many = widened(verdict, tuple("abcde"))
    assert (many.word, many.causes) == ("unknown", ())


@pytest.mark.slow
def test_a_recording_unlike_those_that_taught_has_no_claim_surer_than_on_real_robots(real):
    """But for what other channels than the wrench uphold."""
    weighed = settle(real, shipped(), 0)
    assert weighed.p_value < LEAST_P
    decision = weighed.decision
    alone = [c for c in decision.verdict.causes if not confirmed(c, decision.gap)]
    assert all(c.probability <= RIGHT_ELSEWHERE for c in alone)
