"""An accelerometer beside the sensor: what it says of a tilt, on simulated and refused data."""

import numpy as np
import pytest

from altered import QUATERNION, at_point, by_name
from ntnu import GRAVITY, STD, static
from wrenchbed.data.metadata import Metadata, SensorInfo
from wrenchbed.data.recording import Recording
from wrenchbed.diagnosis.diagnose import diagnose
from wrenchbed.diagnosis.prepare import accelerometer
from wrenchbed.physics.rotations import cross, quaternion
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.robots.oriented import ROBOT
from wrenchbed.simulation.closed_form import Model


def readings(rotation, rng, tilt=(0.0, 0.0), noise=0.02):
    """Of an accelerometer mounted anyhow, 2 % of gain errors, an unknown zero (H, 3) [m/s²]."""
    mounted = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    seen = (GRAVITY + cross(np.array([*tilt, 0.0]), GRAVITY)) @ rotation
    gain = mounted @ (np.eye(3) + 0.02 * rng.standard_normal((3, 3)))
    return seen @ gain + rng.standard_normal(3) + noise * rng.standard_normal(seen.shape)


def test_an_accelerometer_sees_no_tilt_where_there_is_none():
    rotation = static().rotation
    rng = np.random.default_rng(1)
    odds = [
        accelerometer.fitted(readings(rotation, rng), rotation, GRAVITY).log_bayes
        for _ in range(60)
    ]
    assert np.median(odds) < -2.0
    assert np.max(odds) < 2.0


def test_an_accelerometers_tilt_is_right_within_its_uncertainty():
    rotation = static().rotation
    rng = np.random.default_rng(2)
    tilt = np.deg2rad([0.2, -0.15])
    chi2 = []
    for _ in range(100):
        t = accelerometer.fitted(readings(rotation, rng, tilt), rotation, GRAVITY)
        assert t.log_bayes > 3.0
        chi2.append((t.tilt - tilt) @ np.linalg.solve(t.covariance, t.tilt - tilt))
    assert np.mean(chi2) == pytest.approx(2.0, abs=0.7)


def test_too_few_orientations_say_nothing():
    rotation = static().rotation
    rng = np.random.default_rng(0)
    assert accelerometer.fitted(readings(rotation[:8], rng), rotation[:8], GRAVITY) is None
    same = np.repeat(rotation[:1], 24, axis=0)
    assert accelerometer.fitted(readings(same, rng), same, GRAVITY) is None


def simulated(seed: int, tilt=(0.0, 0.0), told=None) -> Recording:
    """40 poses; the wrench with one tilt, the accelerometer with the same or another."""
    rng = np.random.default_rng([seed, 7])
    q = ROBOT.sample(40, rng)
    metadata = Metadata(
        "any", "static", sensor=SensorInfo("ati-gamma", tuple(STD)), gravity=tuple(GRAVITY),
        tolerance={"sensor.bias": 5.0},
    )  # fmt: skip
    theta = Model.of(ROBOT, metadata).configured(metadata)[: len(ROBOT.parameters)]
    theta = ROBOT.theta_of_tool(theta, 0.93, [0.0, 0.0, 0.044])
    rotation = ROBOT.sensor_pose(q, theta)[0]
    force = 0.93 * (GRAVITY + cross(np.array([*tilt, 0.0]), GRAVITY)) @ rotation
    wrench = at_point(force, [0.0, 0.0, 0.044])
    wrench += STD * rng.standard_normal(wrench.shape)
    read = readings(rotation, rng, tilt if told is None else told)
    columns = {"t": np.arange(40.0)} | by_name(CHANNELS, wrench)
    columns |= by_name(QUATERNION, np.stack([quaternion(r) for r in rotation])) | by_name(
        ("ax", "ay", "az"), read
    )
    return Recording(metadata, columns)


def test_an_accelerometer_raises_no_false_alarm():
    assert diagnose(simulated(0)).diagnosis.verdict == "none"


def test_a_small_tilt_is_claimed_with_the_accelerometer():
    tilt = np.deg2rad([0.25, -0.25])
    found = diagnose(simulated(0, tilt))
    assert found.diagnosis.verdict == "identified"
    (cause,) = (w for w in found.diagnosis.which if w["effect"] == "base.tilt")
    told = np.array([cause["parameters"][a]["value"] for a in "xy"])
    assert np.rad2deg(told) == pytest.approx([0.25, -0.25], abs=0.06)


def test_an_accelerometer_that_contradicts_the_wrench_is_not_believed():
    found = diagnose(simulated(0, told=np.deg2rad([1.0, 1.0])))
    assert "base.tilt" not in [w["effect"] for w in found.diagnosis.which]
    assert any("does not agree" in n for n in found.diagnosis.notes)
