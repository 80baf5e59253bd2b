"""Isolability: what a design can show, at what size, and what merges in it."""

import numpy as np
import pytest

from wrenchbed import registry
from wrenchbed.data.plan import Plan
from wrenchbed.diagnosis.evidence.dictionary import build
from wrenchbed.diagnosis.evidence.similarity import Similarity
from wrenchbed.diagnosis.next.dry_run import of_plan
from wrenchbed.diagnosis.next.isolability import (
    VisibleSize,
    cannot_tell,
    classes,
    isolability,
    visible_sizes,
)
from wrenchbed.diagnosis.prepare.baseline import calibrate
from wrenchbed.errors import DiagnosisError
from wrenchbed.planning.choose import multisine

UR5 = registry.load("robots", "ur5")
WIDE = UR5.sample(60, np.random.default_rng(3))
NARROW = UR5.home + np.random.default_rng(0).uniform(-1, 1, (60, 6)) * np.deg2rad(20)
STILL = np.column_stack([np.full(60, 0.3), WIDE[:, 1:]])
TIMING = {"timing.delay", "timing.lowpass", "timing.skew"}


def dictionary(plan):
    prepared = of_plan(plan)
    return build(prepared, prepared.configuration.robot_theta, calibrate(prepared).tolerance)


@pytest.fixture(scope="module")
def designs():
    made = {}
    for name, q in {"wide": WIDE, "narrow": NARROW, "still": STILL}.items():
        d = dictionary(Plan.of("ur5", q))
        made[name] = d, Similarity(d)
    return made


def within(similarity, first, second):
    """Whether the readings of (effect, label) can be made by the other."""
    place = {(w.name, w.variant.label): k for k, w in enumerate(similarity.signatures)}
    return bool(similarity.inside[place[first], place[second]])


@pytest.mark.slow
def test_every_effect_with_a_mean_is_told_once(designs):
    d, similarity = designs["wide"]
    told = isolability(d, similarity)
    names = [s.effect for s in told]
    assert len(set(names)) == len(names) >= 30
    assert "sensor.noise" not in names
    tilt = next(s for s in told if s.effect == "base.tilt")
    assert tilt.detectable and tilt.size["x"][1] == "rad"
    assert 1e-4 < tilt.size["x"][0] < np.deg2rad(0.5)


def test_the_smallest_size_adds_a_gap_of_one(designs):
    d, similarity = designs["wide"]
    told = visible_sizes(similarity, "joint.offset", "joint 6")
    (k,) = next(h.columns for h in d.hypotheses if (h.name, h.variant.label) == (
        "joint.offset", "joint 6"))  # fmt: skip
    assert d.gap(told.smallest * d.E[:, k]) == pytest.approx(1.0)
    assert told.size["offset.q6"][0] == pytest.approx(told.smallest * d.size[k])


def test_torque_from_torque_crosstalk_lies_in_torque_from_force(designs):
    similarity = designs["wide"][1]
    tt, tf = (("sensor.crosstalk", f"torques from {x}") for x in ("torques", "forces"))
    assert within(similarity, tt, tf)
    assert not within(similarity, tf, tt)


def test_mass_hides_in_a_gain_of_forces_and_cog_in_a_shifted_origin(designs):
    d, similarity = designs["wide"]
    assert within(similarity, ("tool.mass", "mass"), ("sensor.gain", "forces"))
    assert within(similarity, ("tool.cog", "x, y and z"), ("sensor.crosstalk", "shifted origin"))
    told = {s.effect: s for s in isolability(d, similarity)}
    assert "sensor.crosstalk" in told["tool.cog"].rivals
    assert "sensor.gain" in told["tool.mass"].rivals


def test_offsets_of_parallel_joints_enter_as_their_sum(designs):
    d, similarity = designs["wide"]
    assert within(similarity, ("joint.offset", "joint 2"), ("joint.offset", "joint 4"))
    told = cannot_tell(d, similarity, among={"joint.offset"})
    assert "joint.offset of joints 2, 3 and 4 are identifiable only as a sum" in told
    assert "joint.offset of joint 1 has no effect on these readings" in told
    assert not any("tool.cog" in text for text in told)


def test_a_turn_of_the_sensor_about_z_is_joint_six(designs):
    d, similarity = designs["wide"]
    turn, joint = ("mount.rotation", "about z"), ("joint.offset", "joint 6")
    assert within(similarity, turn, joint) and within(similarity, joint, turn)
    pair = {"mount.rotation about z", "joint.offset of joint 6"}
    assert any(
        all(p in text for p in pair) and "any free-space data" in text
        for text in cannot_tell(d, similarity)
    )


def test_timing_cannot_show_at_rest(designs):
    d, similarity = designs["wide"]
    told = {s.effect: s for s in isolability(d, similarity)}
    for name in TIMING | {"tool.inertia", "tool.self_weight"}:
        assert told[name].smallest is None and not told[name].detectable
    assert any(
        "timing.delay" in text and "poses at rest" in text for text in cannot_tell(d, similarity)
    )


def test_without_turning_joint_one_a_tilt_looks_like_an_offset(designs):
    assert "base.tilt" in visible_sizes(designs["still"][1], "joint.offset", "joint 2").rivals
    assert "base.tilt" not in visible_sizes(designs["wide"][1], "joint.offset", "joint 2").rivals


def test_narrow_orientations_merge_more_and_show_less(designs):
    told = {k: {s.effect: s for s in isolability(*designs[k])} for k in ("wide", "narrow")}
    rivals = {k: sum(len(s.rivals) for s in v.values()) for k, v in told.items()}
    assert rivals["narrow"] > rivals["wide"]
    for name in ("mount.rotation", "joint.offset", "sensor.crosstalk", "base.tilt"):
        assert told["narrow"][name].smallest > 1.5 * told["wide"][name].smallest


def test_classes_join_what_is_mutual():
    def told(name, *rivals):
        return VisibleSize(name, "", 1.0, {}, True, rivals)

    chain = [told("a", "b"), told("b", "a", "c"), told("c", "b"), told("d", "a"), told("e")]
    assert classes(chain) == (frozenset("abc"),)


def test_a_motion_shows_timing():
    d = dictionary(multisine(UR5, 8.0, 60.0, 1))
    told = {s.effect: s for s in isolability(d)}
    assert told["timing.delay"].detectable
    assert told["timing.delay"].size["delay"][1] == "s"
    assert not any("timing.delay cannot" in text for text in cannot_tell(d))


def test_a_plan_too_short_is_refused():
    with pytest.raises(DiagnosisError, match="poses cannot separate"):
        of_plan(Plan.of("ur5", WIDE[:5]))
    with pytest.raises(DiagnosisError, match="touches"):
        of_plan(Plan.of("ur5", WIDE, points=np.zeros((60, 3))))


def test_a_rehearsed_plan_carries_only_noise():
    prepared = of_plan(Plan.of("ur5", WIDE))
    d = build(prepared, prepared.configuration.robot_theta, calibrate(prepared).tolerance)
    left = prepared.rows(prepared.y).ravel() - d.baseline
    assert 0.005 < d.gap(left) < 0.1  # white noise of 60 rows, 0.017, and the sensor's wander
