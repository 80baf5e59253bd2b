"""The next experiment: it separates what is left, is feasible, and says so."""

import numpy as np
import pytest

from wrenchbed import registry
from wrenchbed.benchmark.lookalikes import ExperimentDesign, draw, recording
from wrenchbed.data.plan import Plan
from wrenchbed.diagnosis.evidence.dictionary import build
from wrenchbed.diagnosis.explain.structures import analyse
from wrenchbed.diagnosis.next.actions import ExperimentRun, actions, feasible, posed
from wrenchbed.diagnosis.next.dry_run import of_plan
from wrenchbed.diagnosis.next.experiments import (
    Comparison,
    candidates_of,
    explore,
    jensen_shannon,
    propose,
    separate,
)
from wrenchbed.diagnosis.prepare.baseline import calibrate
from wrenchbed.diagnosis.prepare.prepare_recording import prepare
from wrenchbed.planning.choose import poses

UR5 = registry.load("robots", "ur5")
WIDE = UR5.sample(60, np.random.default_rng(3))
NARROW = UR5.home + np.random.default_rng(0).uniform(-1, 1, (60, 6)) * np.deg2rad(20)
STILL = np.column_stack([np.full(60, 0.3), WIDE[:, 1:]])


def dictionary(robot, q):
    prepared = of_plan(Plan.of(robot, q))
    return build(prepared, prepared.configuration.robot_theta, calibrate(prepared).tolerance)


@pytest.fixture(scope="module")
def wide():
    return dictionary("ur5", WIDE)


@pytest.fixture(scope="module")
def still():
    return dictionary("ur5", STILL)


@pytest.fixture(scope="module")
def narrow():
    return dictionary("ur5", NARROW)


def candidate(d, name, label, *sizes):
    h = next(h for h in d.hypotheses if (h.name, h.variant.label) == (name, label))
    return h, np.broadcast_to(np.array(sizes, dtype=float), len(h.columns))


@pytest.mark.parametrize("d", [0.0, 0.5, 2.0, 8.0])
def test_divergence_of_two_gaussians(d):
    x = np.linspace(-12, 20, 20001)
    p, q = (np.exp(-((x - m) ** 2) / 2) / np.sqrt(2 * np.pi) for m in (0.0, d))
    middle = np.maximum((p + q) / 2, 1e-300)
    terms = [f * np.log(np.maximum(f, 1e-300) / middle) for f in (p, q)]
    exact = 0.5 * sum(np.trapezoid(t, x) for t in terms)
    assert jensen_shannon(d) == pytest.approx(exact, abs=2e-3)


@pytest.mark.slow
def test_tilt_and_offset_are_separated_by_moving_joint_one(still):
    found = separate(
        still,
        [
            candidate(still, "joint.offset", "joint 2", 1.5),
            candidate(still, "base.tilt", "about x and y", 0.6),
        ],
    )
    assert [e.gain for e in found] == sorted((e.gain for e in found), reverse=True)
    sweep = next(e for e in found if "q1" in e.action)
    assert set(sweep.separates) == {"joint.offset", "base.tilt"}
    assert "base.tilt" in sweep.sentence and "min" in sweep.sentence
    assert np.ptp(sweep.plan.q[:, 0]) > 2.0
    for e in found:
        assert e.plan.robot == "ur5" and e.minutes > 0.1
        assert not UR5.infeasible(e.plan.q, UR5.parameters.nominal)
        if e.plan.mode == "static":
            assert feasible(UR5, e.plan.q).all()


@pytest.mark.slow
def test_nothing_separates_a_turned_sensor_from_joint_six(narrow):
    pair = [
        candidate(narrow, "joint.offset", "joint 6", 2.6),
        candidate(narrow, "mount.rotation", "about z", 1.0),
    ]
    assert separate(narrow, pair) == ()


@pytest.mark.slow
def test_a_second_payload_separates_crosstalk_from_cog(narrow):
    found = separate(
        narrow,
        [
            candidate(narrow, "sensor.crosstalk", "torques from forces", 3.0),
            candidate(narrow, "tool.cog", "x, y and z", 1.0),
        ],
    )
    payload = next(e for e in found if "payload" in e.action)
    assert set(payload.separates) == {"sensor.crosstalk", "tool.cog"}
    assert payload.minutes > 2.0
    assert not any("rows" in e.action for e in found)


def test_poses_are_chosen_where_the_explanations_differ(still):
    pair = [
        candidate(still, "joint.offset", "joint 2", 1.5),
        candidate(still, "base.tilt", "about x and y", 0.6),
    ]
    comparison = Comparison(still, pair)
    noise = still.prepared.noise
    q = np.concatenate([STILL[:5], STILL[:5] + np.array([2.0, 0, 0, 0, 0, 0])])
    rows = comparison.rows(
        ExperimentRun(posed(still.prepared, q, np.arange(10.0), noise, after=False))
    )
    told = comparison.contrast([comparison.old], rows)
    assert told[5:].min() > 0.0 and told[5:].mean() > 10 * told[:5].mean()


def test_columns_of_a_contest_are_those_of_the_dictionary(wide):
    pair = [
        candidate(wide, "joint.offset", "joint 2", 1.0),
        candidate(wide, "sensor.gain", "all channels", 1.0),
    ]
    comparison = Comparison(wide, pair)
    again = comparison.rows(ExperimentRun(wide.prepared))
    assert np.allclose(again.E, comparison.old.E, atol=1e-9)
    far = comparison.distance(0, 1, [comparison.old])
    assert comparison.distance(0, 1, [again, again]) > far > 0


def test_one_explanation_needs_no_experiment(wide):
    assert separate(wide, [candidate(wide, "joint.offset", "joint 2", 1.0)]) == ()


@pytest.mark.parametrize(
    "kernel, word",
    [("joint 3", "sweep joint q3"), ("direction", "both sides"), ("time", "return to the first")],
)
def test_the_unknown_is_asked_for_its_variable(wide, kernel, word):
    found = explore(wide, kernel)
    own = next(e for e in found if word in e.action)
    assert own.separates == (kernel,) and own.gain > 0 and kernel in own.sentence


@pytest.mark.slow
def test_experiments_after_an_analysis():
    robot = registry.load("robots", "ur5")
    design = ExperimentDesign.of_plan(poses(robot, 40, 3), robot)
    analysis = analyse(prepare(recording(design, draw(design, 2, "single", "joint.offset"))))
    lead = analysis.ranking.explanations[0].parts[0].name
    found = candidates_of(analysis, {lead})
    assert [h.name for h, _ in found] == [lead]
    assert len(found[0][1]) == len(found[0][0].columns) and np.abs(found[0][1]).max() > 0
    assert propose(analysis, found) == ()
    assert isinstance(propose(analysis, (), unknown=True), tuple)


def test_plans_for_a_closed_chain_stay_inside():
    medrue = registry.load("robots", "medrue")
    prepared = of_plan(Plan.of("medrue", medrue.sample(24, np.random.default_rng(1))))
    found = list(actions(prepared, lambda pool: np.arange(len(pool))))
    assert len(found) >= 8
    for action in found:
        assert not medrue.infeasible(action.plan.q, medrue.parameters.nominal)
        if action.session.again:
            assert len(action.session.prepared.scene) > len(prepared.scene) or (
                (action.session.prepared.noise < prepared.noise).all()
            )
