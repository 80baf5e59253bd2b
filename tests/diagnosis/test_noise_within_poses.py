"""Scatter within poses far beyond the stated noise: what is no noise is no estimate of it."""

from dataclasses import replace

import numpy as np
import pytest

from simulated import UR5_TRUTH, WHITE, static
from wrenchbed.diagnosis.diagnose import diagnose
from wrenchbed.diagnosis.prepare.prepare_recording import prepare
from wrenchbed.physics.wrench import CHANNELS

ROWS = 60


def recorded(poses=60, **changes):
    """Poses of 60 rows without segments: joints that do not move are one pose."""
    rec = static("ur5", UR5_TRUTH, poses=poses, samples=ROWS, noise=WHITE, seed=2)
    columns = {k: np.array(v) for k, v in rec.columns.items() if k != "segment"} | changes
    return replace(rec, columns=columns)


def frozen(rec, first=20, last=32):
    """Joint values stand still, bit for bit, while the robot goes on through 12 poses."""
    columns = dict(rec.columns)
    for name in rec.joints:
        columns[name] = np.array(columns[name])
        columns[name][first * ROWS : last * ROWS] = columns[name][first * ROWS]
    return replace(rec, columns=columns)


def shaken(rec, amplitude, hertz=12.0):
    wave = amplitude * np.sin(2.0 * np.pi * hertz * rec.t)
    return replace(rec, columns={**rec.columns, "fx": rec.columns["fx"] + wave})


def sigma(rec):
    return np.sqrt(np.diagonal(prepare(rec).covariance))


def test_ordinary_noise_is_measured_and_needs_no_note():
    prepared = prepare(recorded())
    assert (prepared.source, prepared.noise_note) == ("repeats", "")
    assert np.sqrt(np.diagonal(prepared.covariance)) == pytest.approx(WHITE, rel=0.1)


def test_joints_that_freeze_do_not_raise_the_noise():
    prepared = prepare(frozen(recorded()))
    assert prepared.source == "stated"
    assert np.sqrt(np.diagonal(prepared.covariance)) == pytest.approx(WHITE, rel=0.01)
    note = prepared.noise_note
    assert "is stated" in note and "freeze" in note and note in prepared.notes


def test_a_beat_of_one_frequency_is_no_noise():
    prepared = prepare(shaken(recorded(), 6.0 * WHITE[0]))
    assert prepared.source == "stated"
    measured = np.sqrt(WHITE[0] ** 2 * (1.0 + 18.0))  # a sine has half its amplitude's square
    assert f"rows of fx within a pose scatter by {measured:.2g}" in prepared.noise_note
    assert f"{WHITE[0]:.3g} N is stated" in prepared.noise_note


def test_noise_that_is_stated_too_small_is_measured_with_a_note():
    rec = recorded()
    rng = np.random.default_rng(5)
    louder = {c: rec.columns[c] + 3.0 * WHITE[k] * rng.standard_normal(len(rec))
              for k, c in enumerate(CHANNELS)}  # fmt: skip
    prepared = prepare(replace(rec, columns={**rec.columns, **louder}))
    assert prepared.source == "repeats"
    assert np.sqrt(np.diagonal(prepared.covariance)) == pytest.approx(
        np.sqrt(10.0) * WHITE, rel=0.1
    )
    assert "the measured scatter counts as noise" in prepared.noise_note


@pytest.mark.slow
def test_a_wave_of_30_sigma_beside_frozen_joints_is_not_none():
    rec = frozen(recorded())
    angle = rec.columns["q4"]
    wave = 30.0 * WHITE[0] * np.sin(3.0 * angle)
    found = diagnose(
        replace(rec, columns={**rec.columns, "fx": rec.columns["fx"] + wave})
    ).diagnosis
    assert found.verdict != "none"
    assert found.probabilities.get("none", 0.0) < 0.1
    assert any("is stated: it moves together" in note for note in found.notes)
