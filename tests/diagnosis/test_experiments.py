"""What a design of poses can show and at what size, and the next experiment that it lacks."""

import numpy as np
import pytest

from wrenchbed import registry
from wrenchbed.data.plan import Plan
from wrenchbed.diagnosis.evidence.dictionary import build
from wrenchbed.diagnosis.evidence.likelihood import row_variance
from wrenchbed.diagnosis.evidence.search import Searcher
from wrenchbed.diagnosis.evidence.similarity import Similarity
from wrenchbed.diagnosis.next.actions import ExperimentRun, actions, posed
from wrenchbed.diagnosis.next.blind import Design, showings
from wrenchbed.diagnosis.next.dry_run import RUNG, of_plan
from wrenchbed.diagnosis.next.experiments import Comparison, explore, jensen_shannon, separate
from wrenchbed.diagnosis.next.isolability import cannot_tell
from wrenchbed.diagnosis.prepare.baseline import calibrate
from wrenchbed.errors import DiagnosisError
from wrenchbed.planning.choose import multisine

UR5 = registry.load("robots", "ur5")
WIDE = UR5.sample(60, np.random.default_rng(3))


STILL = np.column_stack([np.full(60, 0.3), WIDE[:, 1:]])
TIMING = {"timing.delay", "timing.lowpass", "timing.skew"}
TILT_OR_OFFSET = (("joint.offset", "joint 2", 1.5), ("base.tilt", "about x and y", 0.6))


def dictionary(plan):
    prepared = of_plan(plan)
    return build(prepared, prepared.configuration.robot_theta, calibrate(prepared).tolerance)


def of_poses(q):
    d = dictionary(Plan.of("ur5", q))
    return d, Similarity(d)


@pytest.fixture(scope="module")
def wide():
    return of_poses(WIDE)


@pytest.fixture(scope="module")
def still():
    return of_poses(STILL)


def candidates(d, *named):
    """Hypotheses (name, label, size) with their amplitudes."""
    known = {(h.name, h.variant.label): h for h in d.hypotheses}
    each = [(known[name, label], size) for name, label, size in named]
    return [(h, np.full(len(h.columns), float(size))) for h, size in each]


# ---- what a design shows ------------------------------------------------------------------------


def within(similarity, first, second):
    """Whether the readings of (effect, label) can be made by the other."""
    place = {(w.name, w.variant.label): k for k, w in enumerate(similarity.signatures)}
    return bool(similarity.inside[place[first], place[second]])


def shown(d, similarity):
    """How a design shows each effect best, by name."""
    return {s.effect: s for s in showings(Design(similarity, Searcher(d), RUNG))}


def test_mass_hides_in_a_gain_of_forces_and_cog_in_a_shifted_origin(wide):
    d, similarity = wide
    tt, tf = (("sensor.crosstalk", f"torques from {x}") for x in ("torques", "forces"))
    assert within(similarity, tt, tf) and not within(similarity, tf, tt)
    assert within(similarity, ("tool.mass", "mass"), ("sensor.gain", "forces"))
    assert within(similarity, ("tool.cog", "x, y and z"), ("sensor.crosstalk", "shifted origin"))
    ways = shown(d, similarity)
    assert "sensor.crosstalk" in ways["tool.cog"].rivals
    assert "sensor.gain" in ways["tool.mass"].rivals


def test_offsets_of_parallel_joints_enter_as_their_sum(wide):
    d, similarity = wide
    assert within(similarity, ("joint.offset", "joint 2"), ("joint.offset", "joint 4"))
    told = cannot_tell(d, similarity, classes=[{"joint.offset"}])
    assert "joint.offset of joints 2, 3 and 4 are identifiable only as a sum" in told
    assert "joint.offset of joint 1 has no effect on these readings" in told
    assert not any("tool.cog" in text for text in told)


def test_timing_cannot_show_at_rest(wide):
    d, similarity = wide
    ways = shown(d, similarity)
    for name in TIMING | {"tool.inertia", "tool.self_weight"}:
        assert ways[name].smallest is None and not ways[name].detectable
    assert any(
        "timing.delay" in text and "poses at rest" in text for text in cannot_tell(d, similarity)
    )


def test_without_turning_joint_one_a_tilt_looks_like_an_offset(still, wide):
    for (_, similarity), alike in ((still, True), (wide, False)):
        place = [(w.name, w.variant.label) for w in similarity.signatures]
        rivals = similarity.rivals(place.index(("joint.offset", "joint 2")))
        assert ("base.tilt" in rivals) is alike


def test_a_motion_shows_timing():
    d = dictionary(multisine(UR5, 6.0, 50.0, 1))
    delay = shown(d, Similarity(d))["timing.delay"]
    assert delay.detectable and delay.size["delay"][1] == "s"
    assert not any("timing.delay cannot" in text for text in cannot_tell(d))


def test_a_rehearsed_plan_carries_only_noise_and_a_short_one_is_refused(wide):
    with pytest.raises(DiagnosisError, match="poses cannot separate"):
        of_plan(Plan.of("ur5", WIDE[:5]))
    with pytest.raises(DiagnosisError, match="touches"):
        of_plan(Plan.of("ur5", WIDE, points=np.zeros((60, 3))))
    d, _ = wide
    left = d.prepared.rows(d.prepared.y).ravel() - d.baseline
    assert 0.005 < d.gap(left) < 0.1  # white noise of 60 rows, 0.017, and the sensor's wander


# ---- the next experiment ------------------------------------------------------------------------


@pytest.mark.parametrize("d", [0.0, 0.5, 2.0, 8.0])
def test_divergence_of_two_gaussians(d):
    x = np.linspace(-12, 20, 20001)
    p, q = (np.exp(-((x - m) ** 2) / 2) / np.sqrt(2 * np.pi) for m in (0.0, d))
    middle = np.maximum((p + q) / 2, 1e-300)
    terms = [f * np.log(np.maximum(f, 1e-300) / middle) for f in (p, q)]
    exact = 0.5 * sum(np.trapezoid(t, x) for t in terms)
    assert jensen_shannon(d) == pytest.approx(exact, abs=2e-3)


def test_poses_are_chosen_where_the_explanations_differ(still):
    d, _ = still
    comparison = Comparison(d, candidates(d, *TILT_OR_OFFSET))
    q = np.concatenate([STILL[:5], STILL[:5] + np.array([2.0, 0, 0, 0, 0, 0])])
    run = ExperimentRun(posed(d.prepared, q, np.arange(10.0), d.prepared.noise, after=False))
    contrast = comparison.contrast(comparison.known, comparison.columns(run))
    assert contrast[5:].min() > 0.0 and contrast[5:].mean() > 10 * contrast[:5].mean()


def test_columns_of_a_contest_are_those_of_the_dictionary(wide):
    d, _ = wide
    pair = candidates(d, ("joint.offset", "joint 2", 1), ("sensor.gain", "all channels", 1))
    comparison = Comparison(d, pair)
    again, noise = comparison.columns(ExperimentRun(d.prepared)), row_variance(d.prepared, 0.15)
    own = d.E[:, comparison.chosen] / np.sqrt(noise)[:, None]
    assert np.allclose(again, own, atol=1e-9)
    known = comparison.known
    assert comparison.after(ExperimentRun(d.prepared)) == pytest.approx(known, rel=1e-6)
    far = comparison.distance(0, 1, known)
    assert comparison.distance(0, 1, 2.0 * known) > far > 0
    free = comparison.columns_of(comparison.candidates[1][0])
    variance = comparison.background + 64.0 * np.isin(np.arange(len(known)), free)
    covariance = (own * variance) @ own.T + np.eye(len(own))
    change = own @ comparison.sizes[0]  # in readings instead of numbers it is the same
    assert far**2 == pytest.approx(change @ np.linalg.solve(covariance, change), rel=1e-6)
    assert separate(d, pair[:1]) == ()  # one explanation needs no experiment


@pytest.mark.sampled
@pytest.mark.parametrize(
    "kernel, word",
    [("joint 3", "sweep joint q3"), ("direction", "both sides"), ("time", "return to the first")],
)
def test_the_unknown_is_asked_for_its_variable(wide, kernel, word):
    found = explore(wide[0], kernel)
    own = next(e for e in found if word in e.action)
    assert own.separates == (kernel,) and own.gain > 0 and kernel in own.sentence


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
