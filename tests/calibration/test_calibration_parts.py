"""Which parameters a calibration frees, what it refuses, and what it says of its result."""

from types import SimpleNamespace

import numpy as np
import pytest

from simulated import UR5_TRUTH, WHITE, static
from wrenchbed import registry
from wrenchbed.calibration import calibrate as calibration
from wrenchbed.calibration.calibrate import CalibrationOptions, calibrate, check_mass
from wrenchbed.calibration.checks.mistakes import _matrices
from wrenchbed.calibration.checks.rigid_load import Moments
from wrenchbed.calibration.checks.rows import _off_neighbours
from wrenchbed.calibration.fit import FitNoise
from wrenchbed.calibration.touches import Agreement, Touches
from wrenchbed.data.recording import POINT, Recording
from wrenchbed.errors import CalibrationError, RecordingError
from wrenchbed.physics.newton_euler import Motion, regressor
from wrenchbed.simulation.closed_form import Model

UR5 = Model.of(registry.load("robots", "ur5"))


def test_an_interval_of_a_stated_noise_is_normal_and_of_a_found_one_student_s():
    stated = calibrate(static("ur5", UR5_TRUTH, poses=30, noise=WHITE))
    for p in stated.identified:
        assert p.interval95 == pytest.approx(1.959964 * p.std)
    repeated = calibrate(static("ur5", UR5_TRUTH, poses=6, samples=4, noise=WHITE))
    assert repeated.noise.source == "repeats"
    for p in repeated.identified:  # 6 · 3 degrees of freedom
        assert p.interval95 == pytest.approx(2.100922 * p.std)
    assert (repeated.poses, repeated.rows) == (6, 24)


def test_a_tool_weighs_something():
    check_mass(1e-6)
    for mass in (0.0, -0.5, float("nan")):
        with pytest.raises(CalibrationError, match="opposite sign"):
            check_mass(mass)


def test_touches_are_no_recording_under_gravity_and_an_unknown_loss_is_refused():
    rec = static("ur5", UR5_TRUTH, poses=12)
    with pytest.raises(CalibrationError, match="loss 'cubic' is not one of linear, huber, student"):
        calibrate(rec, CalibrationOptions(loss="cubic"))
    touching = dict(rec.columns) | dict.fromkeys(POINT, np.zeros(12))
    with pytest.raises(CalibrationError, match="these are touches"):
        calibrate(Recording(rec.metadata, touching))
    with pytest.raises(RecordingError, match="px without the rest of px py pz"):
        Recording(rec.metadata, dict(rec.columns) | {"px": np.zeros(12)})
    bare = {k: v for k, v in touching.items() if not k.startswith("q")}
    with pytest.raises(CalibrationError, match="touches need joint columns"):
        Touches.of(SimpleNamespace(name="r", columns=bare, joints=()), 1e-4)


def status(noise=None, agreement=None, identified=(), steps=1, converged=True, **data):
    solution = SimpleNamespace(steps=steps, converged=converged)
    six = np.ones(6)
    noise = noise or FitNoise(six, "repeats", six, six, six, 4.0, False)
    seen = SimpleNamespace(**{"left_out": 0, "flagged": 0} | data)
    return calibration._status(solution, noise, list(identified), seen, agreement)


def test_the_status_says_how_far_to_trust_a_fit():
    good = "converged in 1 step; the residual is what the noise of the repeats explains"
    assert status() == good
    assert status(steps=3).startswith("converged in 3 steps; ")
    assert status(steps=50, converged=False).startswith(
        "not converged after 50 steps: do not use these values; "
    )
    six = np.ones(6)
    scatter = np.array([1.0, 2, 3, 4, 9, 6])
    wide = status(FitNoise(six, "stated", 2.0 * six, scatter, six, 4.0, True))
    assert "up to 4.5 times what the stated noise explains" in wide
    alone = status(FitNoise(six, "residual", six, six, six, 4.0, False))
    assert alone.endswith("no repeats and no stated noise: uncertainties follow the residual")
    blind = [SimpleNamespace(name=n, std=s) for n, s in (("a", None), ("b", 0.1), ("c", None))]
    assert status(identified=blind) == f"{good}; 2 parameters are fixed only in combination (a, c)"
    assert status(left_out=3) == f"{good}; 3 saturated rows were left out"
    assert status(flagged=2).endswith("; the sensor's status word is not 0 in 2 of the rows used")
    assert "touch" not in status(agreement=Agreement(4, 1e-4, 2, 3.0, 0.5))
    doubtful = status(agreement=Agreement(4, 1e-4, 2, 6.0, 1e-6))
    assert "touch 2 (counted from 0) lies 6.0 standard deviations" in doubtful


# ---- loads of many mendings at once: each is the one that is fitted alone -----------------------


@pytest.fixture
def moments():
    rng = np.random.default_rng(3)
    seen = 9.81 * rng.normal(size=(3, 60))
    seen /= np.linalg.norm(seen, axis=0) / 9.81
    design = regressor(Motion(seen, np.zeros_like(seen), np.zeros_like(seen)))
    phi = np.array([1.2, 0.01, -0.03, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    y = design @ phi + 0.02 * rng.normal(size=(60, 6))
    return Moments.of(design, y, np.full(6, 0.02))


def same(one, other):
    for name in ("phi", "share", "left", "channel"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-9, atol=1e-12)


def test_mended_readings_together_are_fitted_as_alone(moments):
    for mend, load in zip(_matrices(), moments.mended(_matrices()), strict=True):
        same(load, moments.fit(mend))


def test_each_channel_is_left_out_as_alone(moments):
    for k, load in enumerate(moments.without_each()):
        same(load, moments.fit(without=(k,)))
        assert load.channel[k] == 0.0


def test_the_load_that_made_the_readings_is_found(moments):
    load = moments.fit()
    assert abs(load.phi[0] - 1.2) < 0.005
    assert load.share < 1e-3
    swing = np.sqrt(np.diagonal(moments.readings)[:3] / moments.count)
    np.testing.assert_allclose(moments.swing(load.phi)[:3], swing, rtol=0.01)


def test_a_row_is_off_by_its_distance_from_the_median_of_three():
    y = np.random.default_rng(0).integers(-5, 5, 500).astype(float)
    median = np.median([np.roll(y, 1), y, np.roll(y, -1)], axis=0)
    off = _off_neighbours(y)
    assert np.array_equal(off[1:-1], np.abs(y - median)[1:-1])
    assert off[0] == off[-1] == 0.0
