"""A tracker or an accelerometer beside the wrench, or alone: what one cannot tell, another may."""

import numpy as np
import pytest

from altered import with_wrench
from plain_ur5 import PlainUr5
from tracked_ur5 import TrackedUr5
from wrenchbed.data.recording import Recording
from wrenchbed.diagnosis.diagnose import diagnose
from wrenchbed.diagnosis.prepare.prepare_recording import prepare
from wrenchbed.diagnosis.prepare.prepared import Material
from wrenchbed.diagnosis.several import diagnose_several
from wrenchbed.errors import DiagnosisError
from wrenchbed.physics.wrench import CHANNELS as WRENCH


def with_zero_off(joint: int, degrees: float = 0.3) -> PlainUr5:
    offset = np.deg2rad(degrees) * np.eye(6)[joint - 1]
    return PlainUr5(offset=tuple(offset), tracked=5e-5)


def without(recording: Recording, *columns: str) -> Recording:
    kept = {k: v for k, v in recording.columns.items() if k not in columns}
    return Recording(recording.metadata, kept, recording.name)


def of_joint(found, joint):
    """Its zero is the one cause, 0.3° within 3 standard uncertainties."""
    (only,) = found.which
    assert (only["effect"], only["elements"]) == ("joint.offset", [f"joint {joint}"])
    assert off(only["parameters"], **{f"offset.q{joint}": np.deg2rad(0.3)}) < 3.0


@pytest.mark.slow
@pytest.mark.parametrize("joint", [2, 3, 4])
@pytest.mark.parametrize("seed", [1, 2])
def test_zeros_of_parallel_joints_are_told_apart(joint, seed):
    recording = without(with_zero_off(joint).recording(seed), "ax", "ay", "az")
    of_joint(diagnose(recording).diagnosis, joint)


def test_a_healthy_robot_has_no_cause():
    found = diagnose(without(PlainUr5(tracked=5e-5).recording(0), "ax", "ay", "az")).diagnosis
    assert (found.verdict, found.which, found.minor) == ("none", [], [])


def tracker_alone(robot, seed, **more):
    return without(robot.recording(seed, **more), "ax", "ay", "az", *WRENCH)


def test_what_counts_is_stated_by_unit_for_every_set_of_channels():
    both = without(PlainUr5(tracked=5e-5).recording(0), "ax", "ay", "az")
    noise = prepare(both).sigma
    stated = prepare(both, material=Material(force=0.2, place=1e-4)).sigma
    assert stated == pytest.approx([0.2] * 3 + [*noise[3:6]] + [1e-4] * 3)
    alone = prepare(without(both, *WRENCH), material=Material(0.2, 0.01, 1e-4))
    assert alone.sigma == pytest.approx([1e-4] * 3)


@pytest.mark.sampled
@pytest.mark.parametrize("joint", [3, 2, 4, 5])
@pytest.mark.parametrize("seed", [0, 1])
def test_a_tracker_alone_names_the_joint(joint, seed):
    found = diagnose(tracker_alone(with_zero_off(joint), seed)).diagnosis
    of_joint(found, joint)
    assert not found.which[0]["rivals"]
    assert set(found.gap.per_channel) == {"mx", "my", "mz"} and found.fitted == []


def test_of_the_first_zero_a_tracker_knows_nothing_and_says_so():
    found = diagnose(tracker_alone(with_zero_off(1), 0)).diagnosis
    assert found.verdict == "none"
    blind = {(spot.effect, spot.element) for spot in found.blind}
    assert ("joint.offset", "joint 1") in blind


def test_readings_that_do_not_follow_the_arm_are_no_places():
    """Torques under the names of a tracker's columns."""
    whole = PlainUr5().recording(0)
    torques = {m: whole.columns[t] for m, t in zip(("mx", "my", "mz"), WRENCH[3:], strict=True)}
    beside = Recording(whole.metadata, {**whole.columns, **torques}, whole.name)
    prepared = prepare(beside)
    assert [c.name for c in prepared.channels] == ["wrench", "accelerometer"]
    assert any("mx my mz hold something else" in note for note in prepared.notes)
    with pytest.raises(DiagnosisError, match="mx my mz hold something else"):
        prepare(without(beside, *WRENCH, "ax", "ay", "az"))


def test_a_tracker_without_repeats_has_the_noise_that_no_effect_explains():
    rows = tracker_alone(with_zero_off(5, 0.2), 3)
    first = np.unique(rows.columns["segment"], return_index=True)[1]
    single = Recording(rows.metadata, {k: v[first] for k, v in rows.columns.items()}, rows.name)
    found = diagnose(single).diagnosis
    assert found.which[0]["elements"] == ["joint 5"]
    assert 3e-5 < found.scale["mx"].noise < 8e-5 and " mm a pose" in " ".join(found.notes)  # 50 µm


def one_wrong(row, column, size):
    wrong = np.zeros((4, 6))
    wrong[row, column] = size
    return TrackedUr5(wrong=wrong)


SPRUNG = TrackedUr5(give=(0.0, 1 / 2e4, 0.0, 0.0, 0.0, 0.0))


@pytest.mark.sampled
@pytest.mark.parametrize(
    ("arm", "effect", "element", "parameter", "truth"),
    [
        (SPRUNG, "joint.compliance", "joint 2", "stiffness", 2e4),
        (one_wrong(2, 1, 1e-3), "link.length", "a2", "length.a2", 1e-3),
        (one_wrong(1, 2, 1e-3), "link.length", "alpha3", "twist.3", 1e-3),
        (one_wrong(0, 1, 0.087), "joint.offset", "joint 2", "offset.q2", 0.087),
    ],
)
def test_what_moves_the_arm_is_named_by_element(arm, effect, element, parameter, truth):
    found = diagnose(arm.recording(0, rows=8)).diagnosis
    assert [(w["effect"], w["elements"]) for w in found.which] == [(effect, [element])]
    assert off(found.which[0]["parameters"], **{parameter: truth}) < 3.0
    assert found.gap.closed.low > 0.98


@pytest.mark.sampled
@pytest.mark.parametrize("seed", [0, 1])
def test_an_arm_that_was_never_calibrated_is_off_in_zeros_and_geometry(seed):
    found = diagnose(TrackedUr5.anyhow(np.random.default_rng(seed)).recording(seed)).diagnosis
    assert {w["effect"] for w in found.which} == {"joint.offset", "link.length"}
    assert found.gap.closed.low > 0.99


@pytest.mark.slow
@pytest.mark.parametrize("joint", [3, 2, 4])
@pytest.mark.parametrize("tracker_first", [False, True])
def test_a_wrench_and_a_tracker_of_two_days_tell_parallel_joints_apart(joint, tracker_first):
    arm, wrong = with_zero_off(joint), np.zeros((4, 6))
    wrong[0] = arm.offset
    whole = arm.recording(0)
    wrench = without(whole, "ax", "ay", "az", "mx", "my", "mz")
    both = [wrench, TrackedUr5(wrong=wrong).recording(1, count=40, rows=5)]
    found = diagnose_several(both[::-1] if tracker_first else both).diagnosis
    assert [w["elements"] for w in found.which] == [[f"joint {joint}"]]
    assert set(found.gap.per_channel) == {*WRENCH, "mx", "my", "mz"} == set(found.scale)


TILT = "base.tilt"
SMALL, LARGE = (2.1e-3, -1.6e-3), (0.014, -0.0105)
"""Tilts about x and y [rad]: 0.15° and 1.0°."""


def answer(robot: PlainUr5, seed: int):
    return diagnose(robot.recording(seed)).diagnosis


def causes(found) -> dict[str, dict]:
    return {w["effect"]: w["parameters"] for w in found.which}


def off(parameters, **truth) -> float:
    """Largest error in standard uncertainties."""
    return max(abs(parameters[k]["value"] - v) / parameters[k]["std"] for k, v in truth.items())


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
def test_a_small_tilt_that_the_accelerometer_proves_is_claimed(seed):
    """The wrench alone shows a gap of 0.2 and names nothing; of 8° it may name a pull instead."""
    found = answer(PlainUr5(tilt=SMALL), seed)
    assert (found.verdict, list(causes(found))) == ("identified", [TILT])
    assert found.which[0]["probability"] > 0.99
    assert off(causes(found)[TILT], x=SMALL[0], y=SMALL[1]) < 3.0
    assert all(causes(found)[TILT][k]["std"] < np.deg2rad(0.02) for k in "xy")
    assert any("upheld by the accelerometer" in note for note in found.notes)
    made = without(PlainUr5(tilt=(0.14, 0.0)).recording(1 + seed), "ax", "ay", "az")
    gains = 1.0 + 0.005 * np.random.default_rng(1).standard_normal(6)
    first = diagnose(with_wrench(made, gains * made.wrench)).diagnosis.which[0]
    assert {x["effect"] for x in (first, *first["rivals"])} == {TILT, "cable.pull"}


@pytest.mark.sampled
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("bent", [0.005, 0.001])
def test_imperfections_of_an_accelerometer_are_no_cause(seed, bent):
    found = answer(PlainUr5(bent=bent, noise=0.005), seed)
    assert (found.verdict, found.which, found.minor) == ("none", [], [])


@pytest.mark.parametrize("seed", [0, 1])
def test_an_accelerometer_alone_names_tilts_and_zeros_and_no_imperfection_of_its_own(seed):
    def alone(**wrong):
        return diagnose(PlainUr5(bent=0.003, **wrong).recording(seed).without_wrench()).diagnosis

    assert alone().verdict == "none"
    assert alone(offset=(0.0,) * 5 + (0.01,)).verdict == "none"  # its mounting takes it up
    tilted = causes(alone(tilt=(0.008, 0.0)))
    assert set(tilted) == {TILT} and off(tilted[TILT], x=0.008, y=0.0) < 3.0
    zero = alone(offset=(0.0, 0.0, 0.006, 0.0, 0.0, 0.0))
    assert set(zero.which[0]["elements"]) == {"joint 2", "joint 3", "joint 4"}
    assert not zero.next  # no pose at rest tells them apart


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
def test_a_tilt_that_wrench_or_accelerometer_contradicts_is_not_claimed(seed):
    """A pull that hides it is a conspiracy, one that makes it for the wrench alone is none."""
    found = answer(PlainUr5(tilt_of_accelerometer=LARGE), seed)
    assert (found.verdict, found.which, found.minor) == ("none", [], [])
    found = answer(PlainUr5(tilt=LARGE, tilt_of_accelerometer=(0.0, 0.0)), seed)
    assert TILT not in {x["effect"] for w in found.which for x in (w, *w["rivals"])}


@pytest.mark.slow
def test_what_moves_the_arm_speaks_through_both():
    """The zero of joint 5: the wrench alone shows a gap of 0.4."""
    of_joint(answer(PlainUr5(offset=with_zero_off(5).offset), 0), 5)
