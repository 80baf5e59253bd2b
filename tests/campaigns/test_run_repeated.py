"""What a campaign tries again, how a stopped one goes on, and a writer that never waits."""

import errno
import shutil
import threading
import time
import warnings
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from test_run_live import PLAN, UR5, Arm, Gauge, poses, run

import wrenchbed as wb
from wrenchbed.campaigns import run as recording_run
from wrenchbed.campaigns.resume import Retries, retries
from wrenchbed.data import parquet, writer
from wrenchbed.data.metadata import parse
from wrenchbed.data.writer import RecordingWriter
from wrenchbed.errors import (
    DriverError,
    LateError,
    LimitError,
    LinkError,
    PlanError,
    SafetyStopError,
    StoppedError,
    WrenchbedWarning,
)
from wrenchbed.hardware.device_base import Health, State
from wrenchbed.hardware.drivers.base import ArmSample


class Trouble(NamedTuple):
    """What the arm says after a move that failed, and the error of that move, if any."""

    state: State
    safety: str = "normal"
    mode: str = "running"
    program: str = "playing"
    error: DriverError | None = None


class Telling(Arm):
    """An arm that runs into a trouble at some of its moves."""

    def __init__(self, troubles: dict[int, Trouble]) -> None:
        super().__init__()
        self.troubles, self.now = troubles, Trouble("ok")

    def _read(self) -> ArmSample:
        now = self.now
        return replace(super()._read(), safety=now.safety, mode=now.mode, program=now.program)

    def _begin(self, goal: np.ndarray, seconds: float) -> None:
        trouble = self.troubles.get(self.moves)
        if trouble is None:
            return super()._begin(goal, seconds)
        self.moves += 1
        self.now, self.state = trouble, Health(trouble.state, f"it is {trouble.state}")
        if trouble.error is not None:
            raise trouble.error

    def _recover(self, unlock: bool) -> None:
        super()._recover(unlock)
        self.now = Trouble("ok")


PERSON = {
    "protective stop": Trouble("stopped", "protective stop", program="paused"),
    "emergency stop": Trouble("stopped", "emergency stop", "off", "stopped"),
    "safeguard stop": Trouble("stopped", "safeguard stop", program="paused"),
    "a word not known": Trouble("stopped", "safety mode 14"),
    "power off": Trouble("stopped", mode="off", program="stopped"),
    "brakes on": Trouble("stopped", mode="idle", program="stopped"),
    "drives off": Trouble("stopped", mode="off", program=""),
    "drive fault": Trouble("fault", "quick stop", program=""),
    "drive fault while mute": Trouble("lost", "quick stop", "fault", ""),
    "protective stop while silent": Trouble("lost", "protective stop"),
    "the driver says so": Trouble("ok", error=SafetyStopError("unlocked by nobody")),
    "the load": Trouble("ok", error=LimitError("50 N, above the limit 40 N")),
}
ITSELF = {
    "link": (Trouble("ok", error=LinkError("gone")), Retries.LINK),
    "silent": (Trouble("lost"), Retries.LINK),
    "bus silent": (Trouble("lost", "quick stop", "idle", ""), Retries.LINK),
    "node rebooted": (Trouble("lost", "quick stop", "off", ""), Retries.LINK),
    "program stopped": (Trouble("stopped", program="stopped"), Retries.STOPPED),
    "drives stopped by watchdog": (Trouble("stopped", "quick stop", "idle", ""), Retries.STOPPED),
    "late": (Trouble("ok", error=LateError("not calm")), Retries.STOPPED),
    "other": (Trouble("ok", error=DriverError("another client controls it")), Retries.STOPPED),
}


KINDS = {name: (trouble, Retries.NEVER) for name, trouble in PERSON.items()} | ITSELF


@pytest.mark.parametrize(("trouble", "kind"), KINDS.values(), ids=KINDS)
def test_what_failed_says_how_often_it_is_tried_again(trouble, kind):
    with Telling({}) as arm:
        arm.now, arm.state = trouble, Health(trouble.state, f"it is {trouble.state}")
        error = trouble.error or DriverError(f"it is {trouble.state}")
        assert retries(arm, error) is kind


@pytest.mark.parametrize("name", ["protective stop", "drive fault", "the load"])
def test_a_robot_that_protects_itself_ends_the_campaign(tmp_path, name):
    arm, path = Telling({2: PERSON[name]}), tmp_path / "r.parquet"
    wanted = LimitError if name == "the load" else SafetyStopError
    with pytest.raises(wanted) as raised:
        run(arm, path)
    assert "pose 2: " in str(raised.value)
    flag = "" if wanted is LimitError else " --recover"
    assert str(raised.value).endswith(f"look what happened, then go on: `record … --resume{flag}`")
    assert (arm.moves, arm.recovered) == (3, 0)
    assert poses(path) == [10, 10, 0, 0]
    assert run(Arm(), path, resume=True).visited == 2
    assert poses(path) == [20, 10, 10, 10]


@pytest.mark.sampled
@pytest.mark.parametrize("name", ["link", "program stopped"])
def test_a_link_or_a_stopped_program_is_tried_again_so_often(tmp_path, monkeypatch, name):
    monkeypatch.setattr(recording_run, "_PAUSE_S", 0.0)
    trouble, kind = ITSELF[name]
    few = Telling(dict.fromkeys(range(2, 2 + kind), trouble))
    with pytest.warns(WrenchbedWarning, match="pose 2: .*: trying again"):
        done = run(few, tmp_path / "r.parquet")
    assert (done.tried_again, few.recovered) == (kind, kind)
    assert poses(tmp_path / "r.parquet") == [20, 10, 10, 10]
    more = Telling(dict.fromkeys(range(2, 3 + kind), trouble))
    with (
        warnings.catch_warnings(),
        pytest.raises(DriverError, match="find the cause, then go on: `record … --resume`$"),
    ):
        warnings.simplefilter("ignore", WrenchbedWarning)
        run(more, tmp_path / "s.parquet")
    assert more.recovered == kind


def test_a_sensor_in_fault_or_an_arm_that_says_nothing_yet_is_a_lost_link():
    def silent() -> ArmSample:
        raise LinkError("no state yet")

    with Arm() as arm:
        arm.transducer.health = lambda: Health("fault", "frozen")
        assert retries(arm, StoppedError("frozen")) is Retries.LINK
    with Arm() as arm:
        arm._read, arm.state = silent, Health("lost", "gone")
        assert retries(arm, DriverError("gone")) is Retries.LINK
        arm.state = Health("fault", "broken")
        assert retries(arm, DriverError("broken")) is Retries.NEVER


def test_before_the_first_row_there_is_nothing_to_resume(tmp_path):
    with pytest.raises(
        SafetyStopError, match="look what happened, then begin anew: `record … --recover`$"
    ):
        run(Telling({0: PERSON["protective stop"]}), tmp_path / "r.parquet")
    assert list(tmp_path.iterdir()) == []


def moving(arm: Arm, path, n: int = 60):
    plan = wb.Plan.of("ur5", np.repeat(UR5.home[None], n, axis=0), rate_hz=125.0)
    with arm:
        return recording_run.record(arm, plan, path)


class Cut(Arm):
    """An arm whose motion, told 20 rows at a time, is cut after the first ones, some times."""

    def __init__(self, *errors: DriverError) -> None:
        super().__init__()
        self.errors = list(errors)

    def _track(self, targets, rate):
        begun = time.monotonic()
        for first in range(0, len(targets), 20):
            if first and self.errors:
                raise self.errors.pop(0)
            rows = [
                self._row(begun + k / rate, self.read(), self.read_wrench())
                for k in range(first, min(first + 20, len(targets)))
            ]
            yield {name: np.array([row[name] for row in rows]) for name in rows[0]}


def test_a_motion_begun_again_keeps_the_recording_that_stood_there(tmp_path):
    path = tmp_path / "r.parquet"
    path.write_text("precious")
    with pytest.warns(WrenchbedWarning, match="the motion: gone"):
        done = moving(Cut(LinkError("gone"), LinkError("gone")), path)
    assert (done.visited, len(wb.Recording.read(path))) == (60, 60)
    assert (tmp_path / "r.parquet~").read_text() == "precious"
    assert len(wb.Recording.read(tmp_path / "r.parquet.cut~")) == 20


def test_a_motion_that_was_stopped_for_safety_is_not_begun_again(tmp_path):
    arm = Cut(SafetyStopError("protective stop"))
    with pytest.raises(
        SafetyStopError, match="look what happened, then begin anew: `record … --recover`"
    ):
        moving(arm, tmp_path / "r.parquet")
    assert arm.recovered == 0
    assert len(wb.Recording.read(tmp_path / "r.parquet")) == 20


def test_touches_are_refused_before_the_arm_moves(tmp_path):
    arm = Arm()
    plan = wb.Plan.of("ur5", PLAN.q, points=np.zeros((4, 3)))
    with arm, pytest.raises(PlanError, match="'arm' cannot touch points"):
        recording_run.record(arm, plan, tmp_path / "r.parquet")
    assert (arm.moves, list(tmp_path.iterdir())) == (0, [])


class Zeroed(Gauge):
    """A sensor whose zero changes after some readings."""

    after = 10**9

    def _read(self):
        reading = super()._read()
        return replace(reading, bias_id=int(self.count > self.after))


def test_a_zero_that_changes_is_named_with_its_pose(tmp_path):
    arm = Arm()
    arm.transducer = Zeroed(arm)
    run(arm, tmp_path / "r.parquet")  # without a change, no warning
    arm = Arm()
    arm.transducer = gauge = Zeroed(arm)
    begin = arm._begin

    def third(goal, seconds):
        gauge.after = gauge.count if arm.moves == 2 else gauge.after
        begin(goal, seconds)

    arm._begin = third
    with pytest.warns(WrenchbedWarning) as told:
        run(arm, tmp_path / "s.parquet")
    assert len(told) == 1
    assert "pose 2: the sensor's zero changed (bias id 0, now 1)" in str(told[0].message)
    assert "separately, or record anew" in str(told[0].message)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    path = tmp_path_factory.mktemp("recorded") / "r.parquet"
    return path, run(Arm(), path)


@pytest.fixture
def path(recorded, tmp_path):
    return shutil.copy(recorded[0], tmp_path / "r.parquet")


def kept(path, rows: np.ndarray) -> wb.Recording:
    """Leave some rows (50,) of a recording; the whole one."""
    whole = wb.Recording.read(path)
    wb.Recording(whole.metadata, {k: v[rows] for k, v in whole.columns.items()}).write(path)
    return whole


FIRST = np.arange(50)


def test_a_cut_revisit_is_made_anew(path):
    first, arm = kept(path, FIRST < 44), Arm()
    done = run(arm, path, resume=True)
    rec = wb.Recording.read(path)
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
    first, arm = wb.Recording.read(path), Arm()
    done = run(arm, path, resume=True)
    assert (done.visited, arm.moves, done.rows) == (0, 0, 50)
    assert np.array_equal(wb.Recording.read(path).wrench, first.wrench)
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
    rec = wb.Recording.read(path)
    assert (done.visited, poses(path)) == (visited, [20, 10, 10, 10])
    assert (np.diff(rec.t) > 0).all()
    assert rec.metadata.extra["started"] == first.metadata.extra["started"]


def test_what_stood_there_before_the_campaign_stays(path, tmp_path):
    (tmp_path / "r.parquet~").write_text("precious")
    kept(path, FIRST < 25)
    run(Arm(), path, resume=True)
    assert (tmp_path / "r.parquet~").read_text() == "precious"
    assert len(wb.Recording.read(tmp_path / "r.parquet.cut~")) == 25


@pytest.mark.parametrize(
    ("plan", "samples", "words"),
    [
        (PLAN, 8, "10 samples at pose 0, not 8: give --samples 10, or record anew"),
        (PLAN, 20, "10 samples at pose 0, not 20: give --samples 10, or record anew"),
        (
            wb.Plan("ur5", PLAN.q, PLAN.segment, np.full(4, 0.1)),
            10,
            "not 50: give the plan it was made with",
        ),
        (wb.Plan.of("ur5", PLAN.q + 0.3), 10, "row 0 is not at pose 0"),
        (
            wb.Plan.of("ur5", np.repeat(UR5.home[None], 20, axis=0), rate_hz=500.0),
            10,
            "a motion cannot be resumed",
        ),
    ],
)
def test_another_plan_or_other_samples_are_refused(path, plan, samples, words):
    with Arm() as arm, pytest.raises(PlanError, match=words):
        recording_run.record(arm, plan, path, samples=samples, rate=500.0, resume=True)
    assert len(wb.Recording.read(path)) == 50


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


METADATA = parse({"format": 1, "robot": "oriented", "mode": "dynamic"}, "x")
NAMES = ("fx", "fy", "fz", "tx", "ty", "tz")


def block(t: float) -> dict[str, np.ndarray]:
    return {"t": np.array([t]), "q1": np.array([t])} | {name: np.array([t]) for name in NAMES}


@pytest.fixture
def slow(monkeypatch):
    """Every rewriting of the whole file takes half a second; how many ran."""
    runs, write, one = [], parquet.write, threading.Lock()

    def late(path, table):
        assert one.acquire(blocking=False), "two at once"
        try:
            time.sleep(0.5)
            write(path, table)
            runs.append(table.num_rows)
        finally:
            one.release()

    monkeypatch.setattr(parquet, "write", late)
    monkeypatch.setattr(writer, "FLUSH_S", 0.05)
    return runs


class Steady(Arm):
    """An arm that notes how long each of its rows was waited for."""

    def _track(self, targets, rate):
        self.waits = []
        begun = time.monotonic()
        for k in range(len(targets)):
            time.sleep(max(0.0, begun + k / rate - time.monotonic()))
            row = self._row(begun + k / rate, self.read(), self.read_wrench())
            handed = time.monotonic()
            yield {name: np.array([value]) for name, value in row.items()}
            self.waits.append(time.monotonic() - handed)


def test_rows_are_taken_while_the_file_is_rewritten(tmp_path, slow):
    arm, path = Steady(), tmp_path / "r.parquet"
    moving(arm, path, 250)
    assert max(arm.waits) < 0.4  # a rewriting takes 0.5 s
    assert len(slow) > 2  # twice or more on the way, and at the end
    rec = wb.Recording.read(path)
    assert len(rec) == 250
    assert (np.diff(rec.t) > 0).all()
    assert [p.name for p in tmp_path.iterdir()] == ["r.parquet"]


def test_what_is_being_rewritten_is_in_the_journal(tmp_path, slow):
    path = tmp_path / "r.parquet"
    with RecordingWriter(path, METADATA) as out:
        for k in range(30):
            out.append(block(float(k)))
            time.sleep(0.01)
        assert slow == []
        with pytest.warns(UserWarning, match="did not finish"):
            told = wb.Recording.read(path)
        assert np.array_equal(told.t, np.arange(len(told)))
        assert len(told) > 15
    assert np.array_equal(wb.Recording.read(path).t, np.arange(30.0))


def test_flush_waits_for_a_rewriting_under_way(tmp_path, slow, monkeypatch):
    monkeypatch.setattr(writer, "FLUSH_S", 0.0)
    with RecordingWriter(tmp_path / "r.parquet", METADATA) as out:
        out.append(block(0.0))
        out.append(block(1.0))
        out.flush()  # two at once would fail
        assert slow[0] == 1


def full(path, table):
    raise OSError(errno.ENOSPC, "No space left on device")


def test_a_full_disk_is_named_by_the_next_rows_and_the_journal_stays(tmp_path, monkeypatch):
    monkeypatch.setattr(parquet, "write", full)
    monkeypatch.setattr(writer, "FLUSH_S", 0.02)
    path = tmp_path / "r.parquet"
    given = 0
    with pytest.raises(OSError) as told, RecordingWriter(path, METADATA) as out:
        for k in range(100):
            out.append(block(float(k)))
            given = k + 1
            time.sleep(0.01)
    assert told.value.errno == errno.ENOSPC
    assert given < 20
    with pytest.warns(UserWarning, match="did not finish"):
        assert len(wb.Recording.read(path)) == given
