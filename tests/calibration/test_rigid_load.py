"""Loads of many mendings at once: each is the one that is fitted alone."""

import numpy as np
import pytest

from wrenchbed.calibration.checks.mistakes import _matrices
from wrenchbed.calibration.checks.rigid_load import Load, Moments
from wrenchbed.physics.newton_euler import Motion, regressor


@pytest.fixture(name="moments")
def _moments() -> Moments:
    rng = np.random.default_rng(3)
    seen = 9.81 * rng.normal(size=(3, 60))
    seen /= np.linalg.norm(seen, axis=0) / 9.81
    design = regressor(Motion(seen, np.zeros_like(seen), np.zeros_like(seen)))
    phi = np.array([1.2, 0.01, -0.03, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    y = design @ phi + 0.02 * rng.normal(size=(60, 6))
    return Moments.of(design, y, np.full(6, 0.02))


def _same(one: Load, other: Load) -> None:
    for name in ("phi", "share", "left", "channel"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-9, atol=1e-12)


def test_mended_readings_together_are_fitted_as_alone(moments: Moments) -> None:
    for mend, load in zip(_matrices(), moments.mended(_matrices()), strict=True):
        _same(load, moments.fit(mend))


def test_each_channel_is_left_out_as_alone(moments: Moments) -> None:
    for k, load in enumerate(moments.without_each()):
        _same(load, moments.fit(without=(k,)))
        assert load.channel[k] == 0.0


def test_the_load_that_made_the_readings_is_found(moments: Moments) -> None:
    load = moments.fit()
    assert abs(load.phi[0] - 1.2) < 0.005
    assert load.share < 1e-3
    np.testing.assert_allclose(moments.swing(load.phi)[:3], np.sqrt(
        np.diagonal(moments.readings)[:3] / moments.count), rtol=0.01)  # fmt: skip
