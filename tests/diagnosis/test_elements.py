"""Which element a cause is of, what is there and small, and what counts is the user's to say."""

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import wrenchbed as wb
from altered import turned, with_added, with_columns, with_wrench
from simulated import driven
from wrenchbed.calibration.observations import observe
from wrenchbed.diagnosis.decision.decide import withdrawn
from wrenchbed.diagnosis.evidence.search import UNKNOWN
from wrenchbed.diagnosis.explain.elements import _sum, element, listed
from wrenchbed.diagnosis.json_entries import minor
from wrenchbed.diagnosis.prepare.bias_and_load_fit import tolerances
from wrenchbed.diagnosis.prepare.prepare_recording import prepare
from wrenchbed.diagnosis.prepare.prepared import Material
from wrenchbed.diagnosis.result import named_by
from wrenchbed.effects.base import Variant
from wrenchbed.physics.wrench import CHANNELS

OFFSET = 0.01
"""Error of a joint's zero [rad]: 0.57°."""


def simulated(path, effect, plan, seed=1, samples=30):
    """A UR5 in MuJoCo with one effect."""
    return driven(plan, path, samples, noise="white", seed=seed, effects=(effect,))


def poses(n=40, seed=1):
    return wb.poses(wb.load("robots", "ur5"), n, seed)


@pytest.mark.sampled
@pytest.mark.parametrize(("joint", "seed"), [(2, 1), (3, 2), (4, 3), (2, 4), (3, 5), (4, 6)])
def test_zeros_of_parallel_joints_are_one_class_at_rest(tmp_path, joint, seed):
    effect = f"joint.offset:joint={joint},offset={OFFSET}"
    recording = simulated(tmp_path / "rec.parquet", effect, poses(seed=seed), seed)
    findings = wb.diagnose(recording)
    answer = findings.diagnosis.to_json()
    (cause,) = answer["which"]
    assert answer["verdict"] == "ambiguous"
    assert cause["effect"] == "joint.offset"
    assert set(cause["elements"]) == {"joint 2", "joint 3", "joint 4"}
    chosen = cause["parameters"]["joint"]
    assert sorted([chosen["value"], *chosen["rivals"]]) == [2, 3, 4]
    assert cause["elements"][0] == f"joint {chosen['value']}"
    total = cause["combination"]
    assert total["text"] == "sum of joint.offset of joints 2, 3 and 4"
    assert total["unit"] == "rad"
    assert abs(total["value"] - OFFSET) < 4 * total["std"] < 0.1 * OFFSET
    assert cause["parameters"][f"offset.q{chosen['value']}"]["std"] is None  # any part of the sum
    assert answer["where"][0]["detail"] == "joints 2, 3 or 4"
    alike = "joint.offset of joints 2, 3 and 4 are identifiable only as a sum"
    assert answer["cannot_tell"] == [alike]
    assert set(answer["next"][0]["separates"]) == {"joint 2", "joint 3", "joint 4"}


@pytest.mark.slow
@pytest.mark.parametrize("joint", [2, 5])
def test_the_proposed_motion_tells_parallel_joints_apart(tmp_path, joint):
    """A joint that turns about an axis of its own is one element at rest."""
    effect = f"joint.offset:joint={joint},offset={OFFSET}"
    rows = [simulated(tmp_path / "rest.parquet", effect, poses(), 1)]
    findings = wb.diagnose(rows[0])
    if joint == 2:
        plan = next(p for p in findings.plans.values() if p.mode == "dynamic")
        rows.append(simulated(tmp_path / "moving.parquet", effect, plan, 2))
        findings = wb.diagnose_several(rows)
    (cause,) = findings.diagnosis.to_json()["which"]
    assert cause["elements"] == [f"joint {joint}"] and cause["combination"] is None
    assert "rivals" not in cause["parameters"]["joint"]


@pytest.mark.slow
@pytest.mark.parametrize("degrees", [5.0, 2.0, 8.0])
def test_a_tilt_of_any_size_is_one_class_with_a_pull(tmp_path, degrees):
    """Gravity in another direction is a constant force at the centre of gravity."""
    recording = simulated(tmp_path / "rec.parquet", "base.tilt:x=0,y=0", poses(60), 2)
    gravity = Rotation.from_euler("x", degrees, degrees=True).apply([0.0, 0.0, -9.80665])
    stated = replace(recording.metadata, gravity=tuple(gravity.tolist()))
    answer = wb.diagnose(replace(recording, metadata=stated)).diagnosis.to_json()
    (cause,) = answer["which"]
    assert answer["verdict"] == "ambiguous" and cause["effect"] == "base.tilt"
    assert abs(cause["parameters"]["x"]["value"] + np.deg2rad(degrees)) < 1e-3
    assert [r["effect"] for r in cause["rivals"]] == ["cable.pull"]
    assert 0.01 < cause["rivals"][0]["probability"] < 0.2
    assert answer["cannot_tell"] == [
        "base.tilt about x and y and cable.pull (always taut) look the same in this data"
    ]


@pytest.mark.slow
def test_none_says_what_it_could_not_have_seen(tmp_path):
    effect = "joint.offset:joint=1,offset=0.14"  # 8°
    answer = wb.diagnose(simulated(tmp_path / "r.parquet", effect, poses())).diagnosis.to_json()
    assert answer["verdict"] == "none"
    blind = {(b["effect"], b["element"]): b for b in answer["blind"]}
    assert blind["joint.offset", "joint 1"]["smallest"] is None
    told = blind["joint.offset", "joint 1"]["sentence"]
    assert told == "joint.offset of joint 1: no effect on these readings"
    assert blind["link.length", "a2"]["smallest"] is None  # lengths move no load at rest
    assert blind["timing.delay", None]["smallest"] is None
    soft = blind["joint.compliance", "joint 6"]  # hardly loaded by the tool
    assert soft["smallest"] is None and "shows at no size that may occur" in soft["sentence"]
    stiffer = blind["joint.compliance", "joint 4"]["smallest"]
    assert stiffer["value"] > 1e-5 and stiffer["unit"] == "rad/(N·m)"
    assert ("joint.offset", "joint 5") not in blind and ("sensor.gain", "fx") not in blind


@pytest.fixture(scope="module")
def healthy(tmp_path_factory):
    return driven(poses(60), tmp_path_factory.mktemp("healthy") / "r.parquet", 30, seed=4)


def numbers(recording, effect):
    which = wb.diagnose(recording).diagnosis.which
    return next(w["parameters"] for w in which if w["effect"] == effect)


def test_a_rotation_holds_what_an_ordinary_zero_of_the_last_joint_makes(healthy):
    """Nothing tells them apart, so no residual says how large that zero is."""
    turn = Rotation.from_rotvec([0.01, 0.01, -0.008])
    rotated = with_wrench(healthy, turned(healthy.wrench, turn))
    off = with_columns(rotated, {"q6": rotated.columns["q6"] + 2e-4})
    a, b = (numbers(r, "mount.rotation")["rotation.z"] for r in (rotated, off))
    assert 1e-4 < abs(a["value"] - b["value"]) < 2 * a["std"] < 1e-3


def test_numbers_of_crosstalk_that_hardly_show_may_be_large(healthy):
    """The tool makes little torque about z, whatever the other numbers are."""
    size = np.kron([[0.02, 0.3], [1e-3, 0.01]], np.ones((3, 3)))
    matrix = size * np.random.default_rng(3).standard_normal((6, 6)) * (1.0 - np.eye(6))
    found = numbers(with_added(healthy, healthy.wrench @ matrix.T), "sensor.crosstalk")
    names = [(i, j, f"x.{CHANNELS[i]}.{CHANNELS[j]}") for i, j in permutations(range(6), 2)]
    z = [(found[name]["value"] - matrix[i, j]) / found[name]["std"] for i, j, name in names]
    assert np.mean(np.abs(z) < 1.645) > 0.9


def test_a_pose_beside_a_jump_is_no_exception(healthy):
    """No other pose says whether the zero jumped before it or behind it."""
    step = 0.4 * np.outer(healthy.columns["segment"] >= 45, np.eye(6)[1])
    assert 0.3 < numbers(with_added(healthy, step), "sensor.jump")["step.fy"]["value"] < 0.5


def test_elements_and_sums_in_words():
    assert listed(["joint 3"]) == "joint 3" and listed(["fx", "fy"]) == "fx or fy"
    assert listed(["joint 3", "joint 12", "joint 2"]) == "joints 2, 3 or 12"
    names, parameters = ("joint 3", "joint 2"), ("offset.q3", "offset.q2")
    total = _sum("joint.offset", parameters, (1.0, 1.01), names)
    assert total == "sum of joint.offset of joints 2 and 3"
    assert _sum("joint.offset", parameters, (1.0, -0.5), names) == "offset.q3 − 0.5 offset.q2"
    assert element(Variant("joint 3, side by load", ("x",), detail={"joint": 3})) == "joint 3"
    assert element(Variant("even, fx", ("x",), detail={"law": "even", "channel": "fx"})) == "fx"
    assert element(Variant("about x and y", ("x", "y"))) == "about x and y"


STIFFNESS = 25_000.0
"""Stiffness of joint 2 [N·m/rad] that adds a third of what counts to 60 poses of 50 rows."""
ROWS = 50


def averaged(recording):
    """The mean of each pose as one row, with the noise of a mean."""
    segment = recording.columns["segment"]
    at = [np.flatnonzero(segment == k) for k in np.unique(segment)]
    columns = {
        name: np.array([x[i[0]] if x.dtype.kind in "biu" else x[i].mean() for i in at])
        for name, x in recording.columns.items()
    }
    sensor = recording.metadata.sensor
    noise = np.array(sensor.noise_std) / np.sqrt(ROWS)
    metadata = replace(recording.metadata, sensor=replace(sensor, noise_std=tuple(noise.tolist())))
    return replace(recording, columns=columns, metadata=metadata)


@pytest.fixture(scope="module")
def spring(tmp_path_factory):
    path = tmp_path_factory.mktemp("spring") / "rec.parquet"
    effect = f"joint.compliance:joint=2,stiffness={STIFFNESS}"
    return simulated(path, effect, poses(60), 3, ROWS)


@pytest.fixture(scope="module")
def findings(spring):
    return wb.diagnose(spring)


@pytest.fixture(scope="module")
def answer(findings):
    return findings.diagnosis.to_json()


def stiffness(entry):
    assert entry["effect"] == "joint.compliance" and entry["elements"] == ["joint 2"]
    return entry["parameters"]["stiffness"]


def test_small_causes_are_detected_and_listed_below_what_counts(answer, findings):
    assert answer["verdict"] == "none" and answer["format"] == 2
    (small,) = [m for m in answer["minor"] if m["effect"] == "joint.compliance"]
    assert small["probability"] > 0.9 and 0.1 < small["gap"] < 0.75
    value = stiffness(small)
    assert abs(value["value"] - STIFFNESS) < 3 * value["std"] < 0.5 * STIFFNESS
    # Noise that channels share can make a gap larger than evidence, which leaves that out.
    (small,) = minor(findings.analysis, withdrawn(findings.verdict, UNKNOWN), 1.0)
    assert small["effect"] == "joint.compliance" and small["probability"] > 0.9


@pytest.mark.slow
def test_averaging_first_changes_no_answer_where_what_counts_is_stated(spring):
    material = Material(0.04, 0.001)
    each = [
        wb.diagnose(r, material=material).diagnosis.to_json() for r in (spring, averaged(spring))
    ]
    raw, mean = ([m for m in a["minor"] if m["effect"] == "joint.compliance"] for a in each)
    assert each[0]["verdict"] == each[1]["verdict"] == "none"
    assert raw[0]["gap"] == pytest.approx(mean[0]["gap"], rel=0.05)
    a, b = stiffness(raw[0]), stiffness(mean[0])
    assert abs(a["value"] - b["value"]) < 0.2 * a["std"]
    assert each[0]["gap"]["material"]["fx"] == 0.04
    assert each[0]["gap"]["calibrated"] == pytest.approx(each[1]["gap"]["calibrated"], abs=0.1)


def test_stated_numbers_may_be_as_wrong_whether_rows_were_averaged_first_or_not(spring):
    prepared = (prepare(r, material=Material(0.04, 0.001)) for r in (spring, averaged(spring)))
    raw, mean = (tolerances(p)["sensor.bias"] for p in prepared)
    assert mean == pytest.approx(raw)


def test_the_noise_of_means_is_not_that_of_a_count(spring):
    """Means of rows stand between the counts of a sensor; a row that stands on them does not."""
    means = averaged(spring)
    stated = np.square(means.metadata.sensor.noise_std)
    assert np.diagonal(observe(means).row_covariance) == pytest.approx(stated)
    step = wb.load("sensors", spring.metadata.sensor.model).calibration().resolution
    columns = {c: np.round(means.columns[c] / u) * u for c, u in zip(CHANNELS, step, strict=True)}
    coarse = observe(replace(means, columns=means.columns | columns)).row_covariance
    assert np.diagonal(coarse) == pytest.approx(np.maximum(stated, np.square(step) / 12.0))


def test_what_counts_decides_whether_it_is_a_cause(spring):
    answer = wb.diagnose(spring, material=Material(0.01, 3e-4)).diagnosis.to_json()
    assert answer["verdict"] == "identified"
    value = stiffness(answer["which"][0])
    assert abs(value["value"] - STIFFNESS) < 3 * value["std"]


def test_fits_say_what_they_took_up_and_leave_residuals_in_newtons(spring, answer):
    fitted = {f["name"]: f for f in answer["fitted"]}
    assert len(fitted) == 10 and fitted["tool.mass"]["stated"] == spring.metadata.tool.mass
    assert abs(fitted["tool.mass"]["value"] - 1.35) < 3 * fitted["tool.mass"]["std"]
    assert fitted["sensor.bias.tz"]["unit"] == "N·m"
    gap = answer["gap"]
    for channel, rms in gap["rms"].items():
        square = gap["per_channel"][channel]["before"] * gap["unit"][channel] ** 2
        assert rms["before"] == pytest.approx(np.sqrt(max(square, 0.0)))
        assert rms["unit"] == ("N" if channel.startswith("f") else "N·m")


def test_rivals_of_both_formats_are_read():
    old = {"effect": "a", "rivals": ["b", "c"]}
    new = {"effect": "a", "rivals": [{"effect": "b"}, {"effect": "c"}]}
    assert named_by(old) == named_by(new) == ("a", "b", "c")
