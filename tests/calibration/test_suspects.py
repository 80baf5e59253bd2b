"""What no noise explains enlarges the intervals, or refuses the fit by the likeliest fault."""

import numpy as np
import pytest

from corrupted import CORRUPTIONS, good
from wrenchbed.calibration import suspects
from wrenchbed.calibration.calibrate import CalibrationOptions, calibrate
from wrenchbed.calibration.checks.rows_of_poses import contradicted
from wrenchbed.errors import CalibrationError
from wrenchbed.physics.wrench import CHANNELS

SEED = 3


def recording(name="", base="oriented"):
    sound = good(base, SEED)
    if not name:
        return sound.recording, sound.truth
    return CORRUPTIONS[name].make(sound.recording, np.random.default_rng(1)), sound.truth


def mass(fit):
    return next(p for p in fit.identified if p.name == "tool.mass")


def test_a_sound_fit_keeps_its_intervals(monkeypatch):
    sound, _ = recording()
    with_suspects = calibrate(sound)
    monkeypatch.setattr(suspects, "allowed_for", lambda _, outcome: (outcome, None))
    assert calibrate(sound).covariance == pytest.approx(with_suspects.covariance, rel=1e-12)


@pytest.mark.parametrize("name", ["gain_of_fx_+1_percent", "gain_of_fz_-5_percent"])
def test_a_small_gain_is_held_by_the_interval(monkeypatch, name):
    broken, truth = recording(name)
    fit = calibrate(broken)
    assert abs(mass(fit).value - truth["tool.mass"]) < 3.0 * mass(fit).std
    monkeypatch.setattr(suspects, "allowed_for", lambda _, outcome: (outcome, None))
    narrow = calibrate(broken)
    assert mass(narrow).value == mass(fit).value
    assert abs(mass(narrow).value - truth["tool.mass"]) > 5.0 * mass(narrow).std


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("gain_of_fz_+20_percent", "a wrong gain of fz explains most"),
        ("gain_of_tx_+20_percent", "a wrong gain of tx explains most"),
        ("fx_shows_fz", "a crosstalk of fz in fx explains most"),
    ],
)
def test_a_large_fault_is_refused_by_its_name(name, words):
    broken, truth = recording(name)
    with pytest.raises(CalibrationError) as caught:
        calibrate(broken)
    assert words in str(caught.value) and "wrenchbed diagnose" in str(caught.value)
    forced = calibrate(broken, CalibrationOptions(force=True))
    assert words in str(forced.refuted)
    assert abs(mass(forced).value - truth["tool.mass"]) < 5.0 * mass(forced).std


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("wrench_1_rows_late", "Leave out the first 1 rows of each pose"),
        ("wrench_2_rows_late", "Leave out the first 2 rows of each pose"),
        ("low_passed", "those of the move before"),
        ("rows_lost", "lie far from all others of their pose"),
    ],
)
def test_rows_that_contradict_their_pose_are_named(name, words):
    broken, _ = recording(name)
    with pytest.raises(CalibrationError) as caught:
        calibrate(broken)
    assert words in str(caught.value)


@pytest.mark.parametrize("rows", [1, 2])
def test_the_remedy_for_a_late_wrench_works(rows):
    broken, truth = recording(f"wrench_{rows}_rows_late")
    segment = broken.columns["segment"]
    place = np.arange(len(broken)) - np.searchsorted(segment, segment)
    columns = {k: v[place >= rows] for k, v in broken.columns.items()}
    fit = calibrate(type(broken)(broken.metadata, columns, broken.name))
    assert abs(mass(fit).value - truth["tool.mass"]) < 4.0 * mass(fit).std


def test_few_rows_a_pose_and_noiseless_rows_contradict_nothing():
    sound, _ = recording()
    keep, count = np.ones(len(sound), dtype=bool), np.full(len(sound) // 4, 4)
    assert contradicted(sound, keep, np.append(count, len(sound) - count.sum())) is None


def test_coarse_steps_of_a_sensor_contradict_nothing():
    sound, _ = recording()
    steps = np.array([0.4, 0.4, 0.8, 0.02, 0.02, 0.02])  # some eight times the noise
    columns = dict(sound.columns)
    columns |= {c: np.round(columns[c] / s) * s for c, s in zip(CHANNELS, steps, strict=True)}
    coarse = type(sound)(sound.metadata, columns, sound.name)
    _, count = np.unique(coarse.columns["segment"], return_counts=True)
    assert contradicted(coarse, np.ones(len(coarse), dtype=bool), count) is None
