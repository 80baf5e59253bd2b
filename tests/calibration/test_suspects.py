"""What no noise explains enlarges the intervals, or refuses the fit by the likeliest fault."""

import numpy as np
import pytest

from altered import with_rows, with_wrench
from sound import good
from subtle import SUBTLE
from wrenchbed.calibration import calibrate as calibration
from wrenchbed.calibration.calibrate import CalibrationOptions, calibrate
from wrenchbed.calibration.checks.rows_of_poses import contradicted
from wrenchbed.errors import CalibrationError

GOOD = good("oriented", 3)
SOUND, MASS = GOOD.recording, GOOD.truth["tool.mass"]


def broken_by(name):
    return SUBTLE[name].make(GOOD, "oriented", np.random.default_rng(1)).recording


def test_a_sound_fit_keeps_its_intervals(monkeypatch):
    with_suspects = calibrate(SOUND)
    monkeypatch.setattr(calibration, "allowed_for", lambda _, outcome: (outcome, None))
    assert calibrate(SOUND).covariance == pytest.approx(with_suspects.covariance, rel=1e-12)


@pytest.mark.parametrize("name", ["gain of fx +5 %", "gain of fz +5 %"])
def test_a_small_gain_is_held_by_the_interval(monkeypatch, name):
    broken = broken_by(name)
    fit = calibrate(broken)
    assert abs(fit["tool.mass"].value - MASS) < 3.0 * fit["tool.mass"].std
    monkeypatch.setattr(calibration, "allowed_for", lambda _, outcome: (outcome, None))
    narrow = calibrate(broken)
    assert narrow["tool.mass"].value == fit["tool.mass"].value
    assert abs(narrow["tool.mass"].value - MASS) > 5.0 * narrow["tool.mass"].std


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("gain of fz +20 %", "a wrong gain of fz"),
        ("gain of tx +20 %", "a wrong gain of tx"),
        ("crosstalk of fz in fx, 5 %", "a crosstalk of fz in fx"),
    ],
)
def test_a_large_fault_is_refused_by_its_name(name, words):
    broken = broken_by(name)
    with pytest.raises(CalibrationError) as caught:
        calibrate(broken)
    assert words in str(caught.value) and "explains most" in str(caught.value)
    forced = calibrate(broken, CalibrationOptions(force=True))
    assert words in str(forced.refuted)
    assert abs(forced["tool.mass"].value - MASS) < 5.0 * forced["tool.mass"].std


@pytest.mark.parametrize("rows", [1, 2])
def test_the_remedy_for_a_late_wrench_works(rows):
    broken = broken_by(f"wrench {rows} rows late")
    segment = broken.columns["segment"]
    place = np.arange(len(broken)) - np.searchsorted(segment, segment)
    fit = calibrate(with_rows(broken, place >= rows))
    assert abs(fit["tool.mass"].value - MASS) < 4.0 * fit["tool.mass"].std


def test_few_rows_a_pose_and_noiseless_rows_contradict_nothing():
    keep, count = np.ones(len(SOUND), dtype=bool), np.full(len(SOUND) // 2, 2)
    assert contradicted(SOUND, keep, count) is None


def test_coarse_steps_of_a_sensor_contradict_nothing():
    steps = np.array([0.4, 0.4, 0.8, 0.02, 0.02, 0.02])  # some eight times the noise
    coarse = with_wrench(SOUND, np.round(SOUND.wrench / steps) * steps)
    _, count = np.unique(coarse.columns["segment"], return_counts=True)
    assert contradicted(coarse, np.ones(len(coarse), dtype=bool), count) is None
