"""An accelerometer beside the sensor: what it says of a tilt, on simulated and refused data."""

import numpy as np
import pytest

from ntnu import GRAVITY, static
from wrenchbed.diagnosis.prepare import accelerometer
from wrenchbed.physics.rotations import cross


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
