"""Poses and stretches that all others contradict are set aside, and named with force and place."""

from dataclasses import replace

import numpy as np
import pytest

from simulated import UR5_TRUTH, WHITE, static
from wrenchbed import registry
from wrenchbed.benchmark.lookalikes import ExperimentDesign, draw
from wrenchbed.benchmark.lookalikes import recording as look_alike
from wrenchbed.data.metadata import ToolInfo
from wrenchbed.data.recording import Recording
from wrenchbed.diagnosis.diagnose import diagnose
from wrenchbed.diagnosis.explain.outliers import Outlier
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.planning import choose

POSES, ROWS = 60, 10
TIP = np.array([0.0, 0.0, 0.1])
"""Where a hand pushes, sensor axes [m]."""
ALONG = {"+x": (1.0, 0.0, 0.0), "−y": (0.0, -1.0, 0.0), "+z": (0.0, 0.0, 1.0)}
LOAD = {k: v for k, v in UR5_TRUTH.items() if k.startswith("tool")}
BIAS = {k: v for k, v in UR5_TRUTH.items() if k.startswith("sensor.bias")}


def sound(seed, truth=LOAD):
    """A robot as its metadata states it; its bias is stated as 0."""
    rec = static("ur5", truth, poses=POSES, samples=ROWS, noise=WHITE, seed=seed)
    mass, *cog = (LOAD[f"tool.{k}"] for k in ("mass", "cog.x", "cog.y", "cog.z"))
    return replace(rec, metadata=replace(rec.metadata, tool=ToolInfo(mass, tuple(cog))))


def pushed(rec, rows, force):
    """The recording with a force (3,) at the tip in some rows (N,)."""
    more = np.concatenate([force, np.cross(TIP, force)]) * rows[:, None]
    columns = dict(zip(CHANNELS, (rec.wrench + more).T, strict=True))
    return Recording(rec.metadata, dict(rec.columns) | columns)


def in_pose(rec, pose):
    return rec.columns["segment"] == pose


@pytest.mark.sampled
@pytest.mark.parametrize(
    ("seed", "pose", "along"), [(0, 7, "+x"), (1, 0, "−y"), (2, 59, "+z"), (3, 30, "−y")]
)
def test_one_pose_of_60_that_is_pushed_is_named_and_the_rest_is_sound(seed, pose, along):
    rec = sound(seed)
    own = in_pose(rec, pose)
    found = diagnose(pushed(rec, own, 20.0 * np.array(ALONG[along])))
    told = found.diagnosis
    assert (told.verdict, told.which) == ("none", [])
    assert abs(told.gap.calibrated.value) < 0.3 and told.gap.rows == (POSES - 1) * ROWS
    (outlier,) = told.outliers
    assert outlier["pose"] == pose
    assert outlier["t"] == pytest.approx(rec.t[own][[0, -1]])
    assert outlier["sentence"].startswith(f"pose {pose}: 20 N along {along} ")
    assert told.to_json()["outliers"] == [dict(outlier)]
    assert found.analysis.prepared.judged.tolist() == [k != pose for k in range(POSES)]


@pytest.mark.slow
def test_two_poses_are_named_though_the_larger_force_hides_the_other():
    rec = sound(5)
    one = pushed(rec, in_pose(rec, 7), np.array([20.0, 0.0, 0.0]))
    told = diagnose(pushed(one, in_pose(rec, 41), np.array([0.0, -4.0, 0.0]))).diagnosis
    assert told.verdict == "none" and told.gap.rows == (POSES - 2) * ROWS
    first, second = (o["sentence"] for o in told.outliers)
    assert first.startswith("pose 7: 20 N along +x ")
    assert second.startswith("pose 41: 4 N along −y ")


@pytest.mark.slow
def test_poses_that_disagree_at_many_times_are_a_fault_of_their_own():
    rec = sound(4)
    rng = np.random.default_rng(4)
    for pose in (3, 14, 26, 39, 52):
        force = 20.0 * rng.standard_normal(3) / np.sqrt(3.0)
        rec = pushed(rec, in_pose(rec, pose), force)
    told = diagnose(rec).diagnosis
    assert len(told.outliers) == 5
    assert told.verdict == "unknown" and told.which == []
    assert any("intermittent fault" in note for note in told.notes)


@pytest.mark.slow
def test_a_pushed_pose_is_found_beside_a_named_cause():
    """The bias of the session is most of the gap, so that it alone looks like an answer."""
    rec = sound(2, LOAD | BIAS)
    told = diagnose(pushed(rec, in_pose(rec, 59), np.array([0.0, 0.0, 20.0]))).diagnosis
    assert told.verdict == "identified"
    (cause,) = told.which
    assert cause["effect"] == "sensor.bias"
    for k, v in BIAS.items():
        found = cause["parameters"][k.removeprefix("sensor.")]
        assert abs(found["value"] - v) < 4.0 * found["std"] < 0.4
    assert [o["pose"] for o in told.outliers] == [59]
    assert abs(told.gap.with_effects.value) < 0.3


def test_a_sound_recording_has_no_outliers():
    told = diagnose(sound(0)).diagnosis
    assert (told.verdict, list(told.outliers)) == ("none", [])


@pytest.mark.study  # three quarters of a minute
def test_a_second_of_a_motion_that_is_pushed_is_named():
    robot = registry.load("robots", "ur5")
    design = ExperimentDesign.of_plan(choose.multisine(robot, 40.0, 125.0, 11), robot)
    rec = look_alike(design, draw(design, 22, "none"))
    during = (rec.t > 20.0) & (rec.t < 21.0)
    found = diagnose(pushed(rec, during, np.array([0.0, 20.0, 0.0])))
    told = found.diagnosis
    assert told.verdict == "none" and abs(told.gap.excess) < 0.5
    (outlier,) = told.outliers
    assert outlier["pose"] is None
    begin, end = outlier["t"]
    assert 19.2 < begin <= 20.0 and 21.0 <= end < 21.8
    assert "20 N along +y that the rest of the motion does not show" in outlier["sentence"]
    prepared = found.analysis.prepared
    assert np.mean(~prepared.judged) < 2.5 / 40.0  # hardly more than the second
    looked = prepared.excerpt.t  # the longer run without it
    assert (looked[0], looked[-1]) == pytest.approx((rec.t[0], begin), abs=0.05)


@pytest.mark.slow
def test_a_contact_in_many_poses_is_no_outlier():
    robot = registry.load("robots", "ur5")
    design = ExperimentDesign.of_plan(choose.poses(robot, POSES, 3), robot, samples=ROWS)
    case = draw(design, 7, "single", "environment.contact", 3.0)
    told = diagnose(look_alike(design, case)).diagnosis
    assert not told.outliers
    assert "environment.contact" in {n for w in told.which for n in (w["effect"], *w["rivals"])}


@pytest.mark.parametrize(
    ("error", "words"),
    [
        ((20.0, 1.0, -2.0, 0.0, 2.0, 0.0), "20 N along +x"),
        ((0.0, 0.0, -3.0, 0.0, 0.0, 0.0), "3 N along −z"),
        ((6.0, 0.0, -8.0, 0.0, 0.0, 0.0), "10 N along (0.60, 0.00, −0.80)"),
        ((0.1, 0.0, 0.0, 0.0, -0.9, 0.0), "0.9 N·m about −y"),
        ((0.0, 0.0, 0.0, 0.3, 0.4, 0.0), "0.5 N·m about (0.60, 0.80, 0.00)"),
    ],
)
def test_a_force_is_named_with_size_and_direction_a_torque_only_where_no_lever_makes_it(
    error, words
):
    none = np.zeros(3, dtype=bool)
    pose = Outlier(none, 4, 1.0, 2.0, np.array(error)).sentence()
    assert pose == f"pose 4: {words} that no other pose shows: contact, or wrong rows"
    stretch = Outlier(none, None, 1.04, 2.0, np.array(error)).sentence()
    assert stretch.startswith(f"1.0 s to 2.0 s: {words} that the rest of the motion does not show")


def test_a_direction_has_no_minus_zero():
    """Found by `scripts/invariants --seed 7230126`: 0.49 N along (−0.00, 0.32, −0.95)."""
    error = np.array([-0.001, 0.16, -0.465, 0.0, 0.0, 0.0])
    told = Outlier(np.array([True]), 3, 0.0, 1.0, error).sentence()
    assert "along (0.00, 0.33, −0.95)" in told
