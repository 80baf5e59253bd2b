"""Long recordings: what is looked at, what it says of the whole, and how it is told."""

import numpy as np
import pytest
from scipy.signal import lfilter

import wrenchbed as wb
from altered import by_name, with_metadata
from wrenchbed.calibration.observations import observe
from wrenchbed.data.holds import gather, parts
from wrenchbed.diagnosis.prepare import scenes
from wrenchbed.diagnosis.prepare.noise import correlation_time
from wrenchbed.physics.wrench import CHANNELS


def at_rest(count, rho=0.0, seed=0):
    """A UR5 at rest in poses of so many rows each, its noise correlated from row to row."""
    rng = np.random.default_rng(seed)
    robot = wb.load("robots", "ur5")
    model, n = wb.Model.of(robot), int(np.sum(count))
    hold = np.repeat(np.arange(len(count)), count)
    q = robot.sample(len(count), rng)
    with wb.SimDriver(wb.SimOptions("ur5")) as driver:
        metadata = driver.metadata("static", 125.0)
    fresh = np.sqrt(1.0 - rho**2)
    noise = rng.standard_normal((n, 6))
    noise[0] /= fresh
    noise = lfilter([fresh], [1.0, -rho], noise, axis=0)
    y = model.predict(q, model.parameters.nominal)[hold] + metadata.sensor.noise_std * noise
    columns = {"t": np.arange(n) / 125.0, "segment": hold}
    columns |= by_name([f"q{k + 1}" for k in range(6)], q[hold]) | by_name(CHANNELS, y)
    return wb.Recording(metadata, columns, "long")


@pytest.fixture
def short(monkeypatch):
    """Limits that small recordings exceed."""
    monkeypatch.setattr(scenes, "ROWS", 2000)
    monkeypatch.setattr(scenes, "LEAST_IN_HOLD", 20)


def test_the_last_rows_of_every_pose_are_looked_at(short):
    """What rings after a move is gone by then."""
    count = np.array([300, 40, 900, 500, 700, 10])
    recording = at_rest(count)
    part = scenes.excerpt(recording)
    held, rows = np.unique(part.columns["segment"], return_counts=True)
    assert held.tolist() == [0, 1, 2, 3, 4, 5]
    assert rows.tolist() == [300, 40, 333, 333, 333, 10]
    assert "in 1,349 of 2,450 rows" in scenes.notes(recording, recording, part)[0]
    for hold in held:
        own = recording.t[recording.columns["segment"] == hold]
        assert part.t[part.columns["segment"] == hold].tolist() == own[-333:].tolist()


@pytest.mark.parametrize("count", [np.full(300, 15), np.array([4000, *[1] * 200])])
def test_evenly_spread_runs_are_looked_at_where_poses_are_many(short, monkeypatch, count):
    monkeypatch.setattr(scenes, "RUNS", 10)
    recording = at_rest(count)
    part = scenes.excerpt(recording)
    assert len(part) == 2000
    gaps = np.flatnonzero(np.diff(part.t) > 1.5 / 125.0)
    assert np.array_equal(gaps, np.arange(199, 1999, 200))
    assert part.t[0] == recording.t[0] and part.t[-1] == recording.t[-1]


def test_channels_may_be_whole_numbers():
    recording = at_rest(np.full(20, 20))
    columns = recording.columns | {
        c: np.round(1e3 * recording.columns[c]).astype(np.int64) for c in CHANNELS
    }
    keep = np.ones(len(recording), dtype=bool)
    whole = gather(wb.Recording(recording.metadata, columns, "counts"), keep)
    assert np.allclose(whole.wrench, 1e3 * gather(recording, keep).wrench, atol=0.5)
    assert np.all(np.diagonal(whole.row_covariance) > 0.0)


def test_what_is_short_stays_as_it_is():
    recording = at_rest(np.full(12, 10))
    assert scenes.excerpt(recording) is recording
    assert scenes.stretch(recording) is recording
    assert scenes.notes(recording, recording, recording) == ()


def test_of_a_long_motion_the_middle_is_diagnosed_and_said_to_be(monkeypatch):
    monkeypatch.setattr(scenes, "MOTION", 1500)
    motion = with_metadata(at_rest([2500]), mode="dynamic")
    middle = scenes.stretch(motion)
    assert middle.t.tolist() == motion.t[500:2000].tolist()
    assert scenes.notes(motion, middle, middle) == (
        "of 2,500 rows of motion, 1,500 were diagnosed, from 4 s to 16 s: what happens outside it, "
        "or over longer times, is not seen",
    )


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9])
def test_rows_that_follow_each_other_count_for_fewer(rho):
    """An AR(1) process: τ = (1 + ρ)/(1 − ρ)."""
    recording = at_rest(np.full(20, 1500), rho)
    tau = correlation_time(recording, observe(recording))
    assert tau == pytest.approx(np.full(6, (1.0 + rho) / (1.0 - rho)), rel=0.25)


def test_poses_are_gathered_alike_however_many_rows_at_once(monkeypatch):
    recording = at_rest(np.array([50, 7, 120, 3, 80]))
    keep = np.ones(len(recording), dtype=bool)
    keep[[0, 60]] = False
    whole = gather(recording, keep)
    monkeypatch.setattr("wrenchbed.data.holds.ROWS_AT_ONCE", 60)
    few = gather(recording, keep)
    assert [(s.start, s.stop, r.start, r.stop) for s, r in parts(few.count)] == [
        (0, 2, 0, 56), (2, 3, 56, 175), (3, 4, 175, 178), (4, 5, 178, 258),
    ]  # fmt: skip
    assert np.array_equal(few.count, [49, 7, 119, 3, 80])
    assert np.allclose(few.row_covariance, whole.row_covariance, rtol=1e-12, atol=0.0)
    y, hold = recording.wrench[keep], recording.columns["segment"][keep]
    away = np.concatenate([y[hold == k] - y[hold == k].mean(axis=0) for k in range(5)])
    assert np.allclose(few.row_covariance, away.T @ away / (258 - 5), rtol=1e-12, atol=1e-18)
    assert np.allclose(few.wrench, [y[hold == k].mean(axis=0) for k in range(5)], rtol=1e-13)
