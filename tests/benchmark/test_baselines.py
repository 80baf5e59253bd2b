"""Simple methods beside the diagnosis: each keeps the contract and knows an easy case."""

import numpy as np
import pytest

from wrenchbed import registry
from wrenchbed.benchmark.lookalikes import ExperimentDesign, draw, recording
from wrenchbed.benchmark.scoring.baselines import BASELINES, descend, linear
from wrenchbed.benchmark.scoring.case_rows import Claim
from wrenchbed.data.plan import Plan
from wrenchbed.diagnosis.prepare.prepare_recording import prepare


@pytest.fixture(scope="module")
def design():
    robot = registry.load("robots", "ur5")
    q = robot.sample(60, np.random.default_rng(2))
    return ExperimentDesign.of_plan(Plan.of("ur5", q), robot, samples=30)


@pytest.fixture(scope="module")
def tilted(design):
    return prepare(recording(design, draw(design, 1, "single", "base.tilt", 4.0)))


@pytest.fixture(scope="module")
def fine(design):
    return prepare(recording(design, draw(design, 2, "none")))


@pytest.mark.parametrize("name", BASELINES)
def test_every_baseline_keeps_the_contract(name, tilted, fine):
    for prepared in (tilted, fine):
        claim = BASELINES[name](prepared)
        assert claim.verdict in ("none", "identified", "ambiguous", "unknown")
        assert bool(claim.causes) == (claim.verdict in ("identified", "ambiguous"))
        assert sum(claim.probabilities.values()) == pytest.approx(1.0)
        assert min(claim.probabilities.values()) >= 0.0
        known = {h.name for h in linear(prepared).d.hypotheses}
        assert {n for c in claim.causes for n in c} <= known
        assert 0.0 < claim.sure <= 1.0
        assert BASELINES[name](prepared) == claim


@pytest.mark.parametrize("name", ["bic", "bic-counting", "bayes", "lasso"])
def test_a_large_tilt_is_recovered(name, tilted):
    assert "base.tilt" in {c[0] for c in BASELINES[name](tilted).causes}


@pytest.mark.parametrize("name", ["bic", "bic-counting", "bayes"])
def test_one_effect_is_named_first_and_alone(name, tilted):
    claim = BASELINES[name](tilted)
    assert claim.causes == (("base.tilt",),) and claim.sure > 0.99


def test_everything_free_names_a_jump(design):
    case = draw(design, 3, "single", "sensor.jump", 4.0)
    causes = BASELINES["everything"](prepare(recording(design, case))).causes
    assert ("sensor.jump",) in causes


def test_none_never_claims(tilted):
    assert BASELINES["none"](tilted) == Claim("none", (), {"none": 1.0})


def test_small_effects_do_not_count_where_counting_is_the_rule(fine):
    assert BASELINES["bic-counting"](fine).verdict == "none"
    assert BASELINES["lasso"](fine).verdict == "none"


def test_the_residual_rule_names_by_channel(design):
    case = draw(design, 4, "single", "sensor.bias", 4.0)
    claim = BASELINES["largest-residual-channel"](prepare(recording(design, case)))
    assert claim.causes == (("sensor.bias",),)


def test_lasso_descends_to_the_solution_of_its_conditions():
    rng = np.random.default_rng(0)
    design = rng.standard_normal((200, 12))
    design /= np.linalg.norm(design, axis=0)
    gram, scores = design.T @ design, design.T @ (design[:, 3] * 40 - design[:, 7] * 25)
    x = np.zeros(12)
    descend(gram, scores, 5.0, x)
    slope = scores - gram @ x
    assert set(np.flatnonzero(x)) == {3, 7}
    np.testing.assert_allclose(slope[[3, 7]], 5.0 * np.sign(x[[3, 7]]), atol=0.05)
    assert np.abs(slope[x == 0.0]).max() <= 5.02
