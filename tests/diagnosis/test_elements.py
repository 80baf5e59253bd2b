"""Which element of the robot a cause is of: as many as the readings allow, and what they fix."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import wrenchbed as wb
from wrenchbed import registry
from wrenchbed.campaigns.recording.run import record
from wrenchbed.data.plan import Plan
from wrenchbed.diagnosis.explain.elements import _sum, element, listed
from wrenchbed.effects.base import Variant
from wrenchbed.hardware.drivers.sim import SimDriver, SimOptions

OFFSET = 0.01
"""Error of a joint's zero [rad]: 0.57°."""


def simulated(path, effect, plan, seed=1, samples=30):
    """A UR5 in MuJoCo with one effect."""
    with SimDriver(SimOptions("ur5", noise="white", seed=seed, effects=(effect,))) as driver:
        record(driver, plan, path, samples=samples)
    return wb.Recording.read(path)


def poses(n=40, seed=1):
    robot = registry.load("robots", "ur5")
    return Plan.of("ur5", robot.sample(n, np.random.default_rng(seed)))


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
    assert answer["where"][0]["detail"] == "joints 2, 3 or 4"
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


@pytest.mark.sampled
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
        "cable.pull (always taut) can reproduce base.tilt about x and y"
    ]


def test_none_says_what_it_could_not_have_seen(tmp_path):
    effect = "joint.offset:joint=1,offset=0.14"  # 8°
    answer = wb.diagnose(simulated(tmp_path / "r.parquet", effect, poses())).diagnosis.to_json()
    assert answer["verdict"] == "none"
    blind = {(b["effect"], b["element"]): b for b in answer["blind"]}
    assert blind["joint.offset", "joint 1"]["smallest"] is None
    assert blind["joint.offset", "joint 1"]["sentence"] == (
        "joint.offset of joint 1: no effect on these readings"
    )
    assert blind["link.length", "a2"]["smallest"] is None  # lengths move no load at rest
    assert blind["timing.delay", None]["smallest"] is None
    soft = blind["joint.compliance", "joint 6"]  # hardly loaded by the tool
    assert soft["smallest"] is None and "shows at no size that may occur" in soft["sentence"]
    stiffer = blind["joint.compliance", "joint 5"]["smallest"]
    assert stiffer["value"] > 1e-5 and stiffer["unit"] == "rad/(N·m)"
    assert ("joint.offset", "joint 5") not in blind and ("sensor.gain", "fx") not in blind


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
