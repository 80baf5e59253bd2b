"""Simple methods beside the diagnosis: each keeps the contract and knows an easy case."""

import numpy as np
import pytest

from wrenchbed import registry
from wrenchbed.benchmark.lookalikes import ExperimentDesign, draw, recording
from wrenchbed.benchmark.scoring.baselines import BASELINES
from wrenchbed.benchmark.scoring.case_rows import Claim
from wrenchbed.data.plan import Plan
from wrenchbed.diagnosis.prepare.prepare_recording import prepare


@pytest.fixture(scope="module")
def tilted():
    robot = registry.load("robots", "ur5")
    q = robot.sample(60, np.random.default_rng(2))
    design = ExperimentDesign.of_plan(Plan.of("ur5", q), robot, samples=30)
    return prepare(recording(design, draw(design, 1, "single", "base.tilt", 4.0)))


def test_one_large_effect_is_named_first_and_alone(tilted):
    claim = BASELINES["bic"](tilted)
    assert claim.verdict == "identified" and claim.causes == (("base.tilt",),)
    assert claim.sure > 0.99 and min(claim.probabilities.values()) >= 0.0
    assert sum(claim.probabilities.values()) == pytest.approx(1.0)
    assert BASELINES["bic"](tilted) == claim


def test_none_never_claims(tilted):
    assert BASELINES["none"](tilted) == Claim("none", (), {"none": 1.0})
