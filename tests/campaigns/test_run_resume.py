"""Going on with a stopped campaign: what is kept, what is visited again, what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from test_run_live import PLAN, Arm, poses, quick, run  # noqa: F401

from wrenchbed.campaigns.recording import run as recording_run
from wrenchbed.data.plan import Plan
from wrenchbed.data.recording import Recording
from wrenchbed.errors import PlanError


def cut(path, rows: int) -> Recording:
    """Leave the first rows of a recording."""
    whole = Recording.read(path)
    Recording(whole.metadata, {k: v[:rows] for k, v in whole.columns.items()}).write(path)
    return whole


def test_a_cut_revisit_is_made_anew(tmp_path):
    path = tmp_path / "r.parquet"
    run(Arm(), path)
    first = cut(path, 44)
    arm = Arm()
    done = run(arm, path, resume=True)
    rec = Recording.read(path)
    assert (done.visited, arm.moves, len(rec)) == (0, 1, 50)
    assert np.array_equal(rec.wrench[:40], first.wrench[:40])
    second = rec.columns["segment"] == 4
    assert second.sum() == 10
    assert rec.t[second][0] > first.t[49]
    assert np.diff(rec.t[second]).max() < 0.1  # one visit, without a gap
    mean = [rec.wrench[rec.columns["segment"] == k].mean(axis=0) for k in (0, 4)]
    assert np.allclose(done.drift.change, mean[1] - mean[0])
    assert done.drift.seconds == pytest.approx(rec.t[-1] - rec.t[9])


def test_a_whole_revisit_is_done(tmp_path):
    path = tmp_path / "r.parquet"
    before = run(Arm(), path)
    first = Recording.read(path)
    arm = Arm()
    done = run(arm, path, resume=True)
    assert (done.visited, arm.moves, done.rows) == (0, 0, 50)
    assert np.array_equal(Recording.read(path).wrench, first.wrench)
    assert np.array_equal(done.drift.change, before.drift.change)
    assert done.drift.seconds == before.drift.seconds


def test_a_revisit_does_not_make_its_pose_whole(tmp_path):
    path = tmp_path / "r.parquet"
    run(Arm(), path)
    whole = Recording.read(path)
    keep = (np.arange(50) < 5) | (np.arange(50) >= 40)
    Recording(whole.metadata, {k: v[keep] for k, v in whole.columns.items()}).write(path)
    with Arm() as arm:
        assert recording_run.record(
            arm, PLAN, path, samples=10, rate=500.0, resume=True
        ).visited == 4  # fmt: skip


def test_without_one_whole_pose_all_are_visited(tmp_path):
    path = tmp_path / "r.parquet"
    run(Arm(), path)
    first = cut(path, 4)
    done = run(Arm(), path, resume=True)
    rec = Recording.read(path)
    assert (done.visited, poses(path)) == (4, [20, 10, 10, 10])
    assert rec.t[0] > first.t[3]
    assert rec.metadata.extra["started"] == first.metadata.extra["started"]


def test_what_stood_there_before_the_campaign_stays(tmp_path):
    path = tmp_path / "r.parquet"
    path.write_text("precious")
    run(Arm(), path)
    cut(path, 25)
    run(Arm(), path, resume=True)
    assert (tmp_path / "r.parquet~").read_text() == "precious"
    assert len(Recording.read(tmp_path / "r.parquet.cut~")) == 25
    assert poses(path) == [20, 10, 10, 10]


@pytest.mark.parametrize("samples", [8, 20])
def test_other_samples_are_refused(tmp_path, samples):
    path = tmp_path / "r.parquet"
    run(Arm(), path)
    words = f"10 samples at pose 0, not {samples}: give --samples 10, or record anew"
    with Arm() as arm, pytest.raises(PlanError, match=words):
        recording_run.record(arm, PLAN, path, samples=samples, rate=500.0, resume=True)
    assert len(Recording.read(path)) == 50


def test_another_dwell_is_refused(tmp_path):
    path = tmp_path / "r.parquet"
    run(Arm(), path)
    dwell = Plan("ur5", PLAN.q, PLAN.segment, np.full(4, 0.1))
    with Arm() as arm, pytest.raises(PlanError, match="not 50: give the plan it was made with"):
        recording_run.record(arm, dwell, path, rate=500.0, resume=True)


def test_another_rate_sensor_or_driver_is_refused(tmp_path):
    path = tmp_path / "r.parquet"
    run(Arm(), path)
    with Arm() as arm:
        with pytest.raises(PlanError, match=r"rate_hz = 500\.0, not 250\.0: give --rate"):
            recording_run.record(arm, PLAN, path, samples=10, rate=250.0, resume=True)
        told = arm.metadata
        own = replace(told("static", 500.0).sensor, model="ur-wrench")
        arm.metadata = lambda mode, rate: replace(told(mode, rate), sensor=own)
        words = "sensor.model = 'ati-gamma', not 'ur-wrench': give --sensor as it was"
        with pytest.raises(PlanError, match=words):
            recording_run.record(arm, PLAN, path, samples=10, rate=500.0, resume=True)
        arm.metadata = lambda mode, rate: replace(told(mode, rate), source="other")
        with pytest.raises(PlanError, match="source 'test', not 'other': give --driver"):
            recording_run.record(arm, PLAN, path, samples=10, rate=500.0, resume=True)
        assert arm.moves == 0
