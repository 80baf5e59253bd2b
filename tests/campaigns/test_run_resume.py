"""Going on with a stopped campaign: what is kept, what is visited again, what is refused."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
from test_run_live import PLAN, UR5, Arm, poses, run

from wrenchbed.campaigns import run as recording_run
from wrenchbed.data.plan import Plan
from wrenchbed.data.recording import Recording
from wrenchbed.errors import PlanError


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A complete recording, and its run."""
    path = tmp_path_factory.mktemp("recorded") / "r.parquet"
    return path, run(Arm(), path)


@pytest.fixture
def path(recorded, tmp_path):
    """A copy of it."""
    return shutil.copy(recorded[0], tmp_path / "r.parquet")


def kept(path, rows: np.ndarray) -> Recording:
    """Leave some rows (50,) of a recording; the whole one."""
    whole = Recording.read(path)
    Recording(whole.metadata, {k: v[rows] for k, v in whole.columns.items()}).write(path)
    return whole


FIRST = np.arange(50)


def test_a_cut_revisit_is_made_anew(path):
    first, arm = kept(path, FIRST < 44), Arm()
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


def test_a_whole_revisit_is_done(recorded, path):
    first, arm = Recording.read(path), Arm()
    done = run(arm, path, resume=True)
    assert (done.visited, arm.moves, done.rows) == (0, 0, 50)
    assert np.array_equal(Recording.read(path).wrench, first.wrench)
    assert np.array_equal(done.drift.change, recorded[1].drift.change)
    assert done.drift.seconds == recorded[1].drift.seconds


@pytest.mark.parametrize(
    ("rows", "visited"),
    [((FIRST < 5) | (FIRST >= 40), 4), (FIRST < 25, 2), (FIRST < 4, 4)],
    ids=["a revisit does not make its pose whole", "half a pose", "no whole pose"],
)
def test_poses_that_are_not_whole_are_visited_again(path, rows, visited):
    first = kept(path, rows)
    done = run(Arm(), path, resume=True)
    rec = Recording.read(path)
    assert (done.visited, poses(path)) == (visited, [20, 10, 10, 10])
    assert (np.diff(rec.t) > 0).all()
    assert rec.metadata.extra["started"] == first.metadata.extra["started"]


def test_what_stood_there_before_the_campaign_stays(path, tmp_path):
    (tmp_path / "r.parquet~").write_text("precious")
    kept(path, FIRST < 25)
    run(Arm(), path, resume=True)
    assert (tmp_path / "r.parquet~").read_text() == "precious"
    assert len(Recording.read(tmp_path / "r.parquet.cut~")) == 25


@pytest.mark.parametrize(
    ("plan", "samples", "words"),
    [
        (PLAN, 8, "10 samples at pose 0, not 8: give --samples 10, or record anew"),
        (PLAN, 20, "10 samples at pose 0, not 20: give --samples 10, or record anew"),
        (
            Plan("ur5", PLAN.q, PLAN.segment, np.full(4, 0.1)),
            10,
            "not 50: give the plan it was made with",
        ),
        (Plan.of("ur5", PLAN.q + 0.3), 10, "row 0 is not at pose 0"),
        (
            Plan.of("ur5", np.repeat(UR5.home[None], 20, axis=0), rate_hz=500.0),
            10,
            "a motion cannot be resumed",
        ),
    ],
)
def test_another_plan_or_other_samples_are_refused(path, plan, samples, words):
    with Arm() as arm, pytest.raises(PlanError, match=words):
        recording_run.record(arm, plan, path, samples=samples, rate=500.0, resume=True)
    assert len(Recording.read(path)) == 50


def test_another_rate_sensor_or_driver_is_refused(path):
    with Arm() as arm:
        with pytest.raises(PlanError, match=r"rate_hz = 500\.0, not 250\.0: give --rate"):
            recording_run.record(arm, PLAN, path, samples=10, rate=250.0, resume=True)
        stated = arm.metadata
        own = replace(stated("static", 500.0).sensor, model="ur-wrench")
        arm.metadata = lambda mode, rate: replace(stated(mode, rate), sensor=own)
        words = "sensor.model = 'ati-gamma', not 'ur-wrench': give --sensor as it was"
        with pytest.raises(PlanError, match=words):
            recording_run.record(arm, PLAN, path, samples=10, rate=500.0, resume=True)
        arm.metadata = lambda mode, rate: replace(stated(mode, rate), source="other")
        with pytest.raises(PlanError, match="source 'test', not 'other': give --driver"):
            recording_run.record(arm, PLAN, path, samples=10, rate=500.0, resume=True)
        assert arm.moves == 0
