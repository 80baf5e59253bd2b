"""The accelerometer against plain numpy, and when it cannot be compared."""

import numpy as np
import pytest

from plain_ur5 import GRAVITY, flange, poses, turned
from wrenchbed import registry
from wrenchbed.channels.accelerometer import CHANNEL
from wrenchbed.channels.own_noise import own_noise
from wrenchbed.channels.response import readings
from wrenchbed.effects.chain import ActiveEffect
from wrenchbed.effects.scene import Scene

UR5 = registry.load("robots", "ur5")
Q = poses(30, np.random.default_rng(0))


def scene(q):
    t, held = np.arange(len(q), dtype=float), np.ones(len(q), dtype=bool)
    return Scene(UR5, UR5.parameters.nominal, np.array(UR5.gravity), q, t, held)


def test_it_reads_gravity_in_its_own_axes():
    rotation = np.array([flange(q)[:3, :3] for q in Q])
    rng = np.random.default_rng(1)
    gain, zero = rng.standard_normal((3, 3)), rng.standard_normal(3)
    fitted = CHANNEL.fitted(GRAVITY @ rotation @ gain + zero, scene(Q))
    assert fitted.gain == pytest.approx(gain) and fitted.zero == pytest.approx(zero)
    tilt = ActiveEffect.of(UR5, "base.tilt", {"x": 0.02, "y": -0.03})
    seen = turned(np.array([0.02, -0.03, 0.0])) @ GRAVITY @ rotation
    assert readings((fitted,), scene(Q), [tilt]) == pytest.approx(seen @ gain + zero)


def test_poses_that_turn_gravity_too_little_determine_no_mounting():
    same = np.repeat(Q[:1], 20, axis=0)
    about_gravity = same + np.eye(6)[0] * np.linspace(0.0, 3.0, 20)[:, None]
    for q in (same, about_gravity):
        read = readings((CHANNEL,), scene(q))
        assert CHANNEL.fitted(read + 1e-3, scene(q)) is None


@pytest.mark.parametrize("seed", range(5))
def test_its_own_noise_is_what_no_effect_explains(seed):
    """White noise of 0.01, nuisance, and effects ten and no times as large."""
    rng = np.random.default_rng(seed)
    nuisance, columns = rng.standard_normal((150, 12)), rng.standard_normal((150, 40))
    noise = 0.01 * rng.standard_normal(150)
    away = nuisance @ rng.standard_normal(12)
    for size in (0.0, 0.1):
        one = columns[:, 0] * size
        assert own_noise(one + away + noise, nuisance, columns) == pytest.approx(0.01, rel=0.35)


def test_readings_that_nuisance_fits_exactly_have_no_noise_of_their_own():
    assert own_noise(np.ones(4), np.eye(4), np.zeros((4, 2))) == 0.0
