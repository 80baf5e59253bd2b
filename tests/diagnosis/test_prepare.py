"""How a recording is cut, split, averaged and weighed before the analysis."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

import wrenchbed as wb
from altered import by_name, stuck, with_added, with_metadata
from simulated import UR5_TRUTH, WHITE, static
from wrenchbed import registry
from wrenchbed.calibration.observations import Observations, observe, scatter
from wrenchbed.data.holds import gather, parts
from wrenchbed.diagnosis.prepare import prepare_recording as module
from wrenchbed.diagnosis.prepare import scenes
from wrenchbed.diagnosis.prepare.configured_simulator import configured
from wrenchbed.diagnosis.prepare.noise import correlation_time
from wrenchbed.diagnosis.prepare.prepare_recording import prepare
from wrenchbed.diagnosis.prepare.prepared import Prepared, inner_stride, split
from wrenchbed.effects.scene import Scene
from wrenchbed.physics.taylor_jets import Jet
from wrenchbed.physics.wrench import CHANNELS


def prepared(rows=16, stride=1, moving=False, source="stated"):
    """Observations in blocks of four; the second block is fold 1 and held out of all fits."""
    block = np.arange(rows) // 4
    scene = SimpleNamespace(held=np.ones(rows, dtype=bool), moving=moving, q=np.arange(rows))
    return Prepared(
        None, None, _Long(scene, rows), np.zeros((rows, 6)), np.ones(rows),
        np.diag(np.array([1.0, 0.5, 0.2, 1.0, 1.0, 0.1]) ** 2), np.full(6, 3.0), source, block,
        block % 4, np.zeros((rows, 6, 6)), 0, stride, held_out=1,
    )  # fmt: skip


class _Long(SimpleNamespace):
    def __init__(self, scene, rows):
        super().__init__(**vars(scene))
        self._rows = rows

    def __len__(self):
        return self._rows


def counting(rows=16):
    return np.arange(float(rows))[:, None] * np.ones(6)


def test_rows_are_whitened_channel_by_channel_and_a_fold_is_held_out():
    p = prepared()
    told = p.rows(counting())
    assert told[:, 0] == pytest.approx([0, 1, 2, 3, *range(8, 16)])
    assert told[:, 5] == pytest.approx(10.0 * told[:, 0])
    assert list(p.block_rows) == list(p.fold_rows) == [0] * 4 + [2] * 4 + [3] * 4
    assert p.variance == pytest.approx(np.full(6, 3.0))
    p.scene.held[1] = False
    assert list(p.poses) == [0, *range(2, 16)]  # joint values of the observations
    assert p.noise_source == "as stated"
    assert prepared(source="repeats").noise_source == "from its repeats"


def test_a_motion_is_averaged_within_its_blocks():
    p = prepared(stride=3, moving=True)
    told = p.rows(counting())
    assert told[:, 0] == pytest.approx([1.0, 9.0, 13.0])  # the fourth row of each is left over
    assert list(p.block_rows) == [0, 2, 3]
    assert p.variance == pytest.approx(np.full(6, 1.0))
    pairs = prepared(stride=2)
    assert pairs.rows(counting())[:, 0] == pytest.approx([0.5, 2.5, 8.5, 10.5, 12.5, 14.5])
    assert list(pairs.block_rows) == [0, 0, 2, 2, 3, 3]


def test_every_four_neighbouring_poses_are_one_of_each_fold():
    for seed in range(4):
        block, fold = split(43, False, seed, 1)
        assert list(block) == list(range(43))
        assert all(set(four) == {0, 1, 2, 3} for four in fold[:40].reshape(-1, 4))
        assert (split(43, False, seed, 1)[1] == fold).all()
        assert (split(43, False, seed + 1, 1)[1] != fold).any()


def test_visits_of_a_pose_are_in_one_fold():
    """20 poses, all visited three times, the last time with an encoder's noise."""
    q = np.random.default_rng(0).uniform(-2.0, 2.0, (20, 6)).round(4)
    visited = np.concatenate([q, q[::-1], q + 1e-6])
    block, fold = split(60, False, 0, 1, visited)
    assert (fold[:20] == fold[39:19:-1]).all() and (fold[:20] == fold[40:]).all()
    assert list(block) == list(range(60))
    assert (fold[:20] == split(60, False, 0, 1)[1][:20]).all()  # that of the first visit
    moved = visited.copy()
    moved[45] += 1e-3
    other = split(60, False, 0, 1, moved)[1]
    assert (np.delete(other, 45) == np.delete(fold, 45)).all()
    assert other[45] == split(60, False, 0, 1)[1][45]


def test_a_motion_has_24_blocks_of_whole_strides():
    block, fold = split(2405, True, 0, 10)
    assert block.max() == 23
    lengths = np.bincount(block)
    assert (lengths[:-1] == 100).all() and lengths[-1] == 105
    of_block = fold[np.searchsorted(block, np.arange(24))]
    assert (of_block[block] == fold).all()
    assert all(set(four) == {0, 1, 2, 3} for four in of_block.reshape(6, 4))
    assert set(split(2400, True, 0, 10, np.zeros((2400, 6)))[1]) == {0, 1, 2, 3}  # of one place
    short, _ = split(5, True, 0, 10)  # less than one stride
    assert set(short) == {0}


def test_what_is_set_aside_takes_no_part_also_in_averages():
    away = np.arange(16) == 6
    p = replace(prepared(), held_out=None).aside(away)
    assert (p.judged == ~away).all() and (p.fitted == ~away).all()
    assert list(p.block_rows) == [0] * 4 + [1] * 3 + [2] * 4 + [3] * 4
    assert p.folds == (0, 1, 2, 3)
    assert not p.without(2).fitted[[6, 8]].any()
    again = p.aside(np.arange(16) < 4)
    assert again.folds == (1, 2, 3) and not again.judged[:4].any() and not again.judged[6]
    p = replace(prepared(16, stride=8, moving=True), held_out=None, block=np.zeros(16, dtype=int))
    held, load = np.ones(16, dtype=bool), np.zeros((16, 6))
    q = Jet(load, load, load)
    scene = Scene(registry.load("robots", "ur5"), None, None, q, np.arange(16.0), held)
    p = replace(p, scene=scene, fold=np.where(np.arange(16) == 5, -1, 2))
    assert p.coarse.fold.tolist() == [2, 2, -1, 2, 2, 2, 2, 2]
    assert p.coarse.stride == 4


def test_averages_are_of_four_pieces_and_noise_with_memory_averages_less(monkeypatch):
    """In motion it is never below that of a row."""
    assert [inner_stride(stride) for stride in (1, 3, 4, 8, 13)] == [1, 1, 1, 2, 3]
    data = SimpleNamespace(count=np.array([4, 12]))
    for time, expected in ((1.0, 0.125), (4.0, 0.5), (20.0, 1.0)):
        monkeypatch.setattr(module, "correlation_time", lambda *_, time=time: np.full(6, time))
        assert module._noise_at_rest(None, data) == pytest.approx(np.full(6, expected))
    told = np.array([0.2, 1.0, 1.5, 3.0, 0.9, 1.1])
    monkeypatch.setattr(module, "noise_in_motion", lambda *_: (np.zeros(6), told))
    assert module._noise_of_averages(None, 0.008, 4) == pytest.approx([1, 1, 1.5, 3.0, 1, 1.1])


def test_rows_of_a_pose_scatter_about_their_mean_and_rows_of_a_motion_do_not():
    data = Observations(
        None, np.array([np.full(6, 1.0), np.full(6, 5.0)]), np.array([2, 3]), np.eye(6), 1.0,
        "repeats", np.zeros(2), np.ones(5, dtype=bool),
    )  # fmt: skip
    columns = {c: np.array([0.0, 2.0, 5.0, 5.0, 5.0]) for c in CHANNELS}
    columns["tx"] = np.array([1.0, 1.0, 2.0, 5.0, 8.0])
    metadata = SimpleNamespace(mode="static", source="device")
    rec = _Long(SimpleNamespace(metadata=metadata, columns=columns), 5)
    told = scatter(rec, data)
    assert told.shape == (2, 6, 6)
    assert told[0, 0, 1] == told[0, 2, 2] == pytest.approx(1.0)
    assert told[1, 3, 3] == pytest.approx((9.0 + 0.0 + 9.0) / 3.0)
    assert told[1, 0, 0] == told[1, 0, 3] == told[1, 3, 0] == pytest.approx(0.0)
    metadata.mode = "dynamic"
    assert (scatter(rec, data) == np.zeros((2, 6, 6))).all()


ROWS = 60


def recorded(poses=60, **changes):
    """Poses of 60 rows without segments: joints that do not move are one pose."""
    rec = static("ur5", UR5_TRUTH, poses=poses, samples=ROWS, noise=WHITE, seed=2)
    columns = {k: np.array(v) for k, v in rec.columns.items() if k != "segment"} | changes
    return replace(rec, columns=columns)


def frozen(rec, first=20, last=32):
    """Joint values stand still, bit for bit, while the robot goes on through 12 poses."""
    row = np.arange(len(rec)) // ROWS
    return stuck(rec, rec.joints, (row >= first) & (row < last))


def shaken(rec, amplitude, hertz=12.0):
    wave = amplitude * np.sin(2.0 * np.pi * hertz * rec.t)
    return with_added(rec, wave[:, None] * np.eye(6)[0])


def test_noise_is_measured_where_joints_move_and_rows_are_noise():
    prepared = prepare(recorded())
    assert (prepared.source, prepared.remarks) == ("repeats", ())
    assert prepared.sigma == pytest.approx(WHITE, rel=0.1)
    prepared = prepare(frozen(recorded()))
    assert prepared.source == "stated"
    assert prepared.sigma == pytest.approx(WHITE, rel=0.01)
    (note,) = prepared.remarks
    assert "is stated" in note and "freeze" in note and note in prepared.notes
    prepared = prepare(shaken(recorded(), 6.0 * WHITE[0]))
    assert prepared.source == "stated"
    measured = np.sqrt(WHITE[0] ** 2 * (1.0 + 18.0))  # a sine has half its amplitude's square
    assert f"rows of fx within a pose scatter by {measured:.2g}" in prepared.remarks[0]
    assert f"{WHITE[0]:.3g} N is stated" in prepared.remarks[0]
    rec = recorded()
    louder = 3.0 * WHITE * np.random.default_rng(5).standard_normal((len(rec), 6))
    prepared = prepare(with_added(rec, louder))
    assert prepared.source == "repeats"
    assert prepared.sigma == pytest.approx(np.sqrt(10.0) * WHITE, rel=0.1)
    assert "the measured scatter counts as noise" in prepared.remarks[0]


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
    counts = {c: np.round(1e3 * recording.columns[c]).astype(np.int64) for c in CHANNELS}
    numbers = gather(replace(recording, columns=recording.columns | counts), keep)
    assert np.allclose(numbers.wrench, 1e3 * whole.wrench, atol=0.5)
    assert np.all(np.diagonal(numbers.row_covariance) > 0.0)
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


def test_single_rows_scatter_by_what_coarse_counts_round_too():
    rec = static("ur5", UR5_TRUTH, poses=40, samples=1, noise=WHITE)
    counts = 0.2 * np.round(rec.columns["fx"] / 0.2)
    coarse = with_added(rec, np.outer(counts - rec.columns["fx"], np.eye(6)[0]))
    expected = np.square(WHITE) + 0.2**2 / 12.0 * np.eye(6)[0]
    assert np.diagonal(prepare(coarse).covariance) == pytest.approx(expected)


@pytest.mark.parametrize("robot", ["ur5", "medrue"])
def test_a_negative_mass_of_a_linear_fit_gives_the_lightest_tool(robot):
    configuration = configured(static(robot, {}, poses=8))
    lightest = configuration.with_nearest_load(-0.1, configuration.cog, None)
    assert 0.0 < lightest.mass < 0.002
    np.testing.assert_allclose(lightest.cog, configuration.cog, atol=1e-12)
