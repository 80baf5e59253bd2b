"""Campaigns on a live driver: retried, continued, within limits that nobody had to give."""

import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

import wrenchbed as wb
from wrenchbed.campaigns import run as recording_run
from wrenchbed.campaigns.moves import MARGIN_M, live_limits
from wrenchbed.errors import (
    DriverError,
    LimitError,
    LinkError,
    PlanError,
    StoppedError,
    WrenchbedWarning,
)
from wrenchbed.hardware.device_base import Health
from wrenchbed.hardware.drivers.base import Applied, ArmSample
from wrenchbed.hardware.drivers.live_base import LiveDriver
from wrenchbed.hardware.transducers.base import Transducer, WrenchSample
from wrenchbed.robots.checked_moves import Limits

UR5 = wb.load("robots", "ur5")
PLAN = wb.Plan.of("ur5", UR5.home + 0.2 * np.random.default_rng(0).standard_normal((4, 6)))


@dataclass(frozen=True)
class Options:
    limits: Limits | None = None


class Gauge(Transducer):
    """Reads what the model says at the arm's joints, with a little noise."""

    name, title, options = "gauge", "a test's sensor", Options

    def __init__(self, arm: "Arm") -> None:
        super().__init__()
        self.arm, self.model = arm, wb.Model.of(UR5)
        self.rng = np.random.default_rng(1)
        self.count = 0

    def _connect(self) -> None: ...
    def _close(self) -> None: ...

    def _read(self) -> WrenchSample:
        self.count += 1
        load = self.model.predict(self.arm.q[None], self.model.parameters.nominal)[0]
        noisy = load + 1e-3 * self.rng.standard_normal(6)
        return WrenchSample(time.monotonic(), None, 0, 0.0, True, noisy + self.arm.push)

    def _at(self, t: float) -> WrenchSample | None:
        return self._read()

    def _health(self) -> Health:
        return Health("ok")


class Arm(LiveDriver):
    """An arm that is at its goal at once, and fails when it is told to."""

    name, title, options, source = "arm", "a test's arm", Options, "test"

    def __init__(self, fail: dict[int, Exception] | None = None, **limits) -> None:
        super().__init__(Limits(**limits) if limits else None)
        self.robot, self.transducer = UR5, Gauge(self)
        self.q, self.push = np.array(UR5.home), np.zeros(6)
        self.fail, self.moves, self.stops, self.recovered = fail or {}, 0, [], 0
        self.state = Health("ok")

    def _open(self) -> None: ...
    def _shut(self) -> None: ...

    def _read(self) -> ArmSample:
        return ArmSample(time.monotonic(), None, 0.0, self.q, np.zeros(6))

    def _begin(self, goal: np.ndarray, seconds: float) -> None:
        error = self.fail.get(self.moves)
        self.moves += 1
        if error is None:
            self.q = np.array(goal)
        elif isinstance(error, StoppedError):
            self.state = Health("stopped", str(error))
        else:
            raise error

    def _stream(self, q: np.ndarray, at: float) -> Applied:
        self.q = np.array(q)
        return Applied(q)

    def _settle(self) -> float:
        """It is calm as soon as it can be read; how calm is measured has tests of its own."""
        self._fresh_arm(0.0)
        self._fresh_wrench()
        return 0.0

    def _stop(self, kind: str) -> None:
        self.stops.append(kind)

    def _recover(self, unlock: bool) -> None:
        self.recovered += 1
        self.state = Health("ok")

    def _arm_health(self) -> Health:
        return self.state


def run(arm: Arm, path: Path, **more) -> recording_run.RunProgress:
    with arm:
        return recording_run.record(arm, PLAN, path, samples=10, rate=500.0, **more)


def poses(path: Path) -> list[int]:
    return np.bincount(wb.Recording.read(path).columns["pose"], minlength=4).tolist()


def test_every_pose_is_there_and_the_first_one_twice(tmp_path):
    arm = Arm()
    arm.q[5] = UR5.joints[5].upper + 5e-7  # a joint at rest flickers by some counts
    done = run(arm, tmp_path / "r.parquet")
    assert (done.visited, done.rows, done.tried_again) == (4, 50, 0)
    assert poses(tmp_path / "r.parquet") == [20, 10, 10, 10]
    rec = wb.Recording.read(tmp_path / "r.parquet")
    assert rec.metadata.source == "test"
    assert {"pose", "saturated", "lost", "age", "status"} <= rec.columns.keys()
    assert list(np.unique(rec.columns["segment"])) == [0, 1, 2, 3, 4]
    assert np.abs(done.drift.change).max() < 5 * done.drift.std.max()


def test_what_fails_is_recovered_from_and_nothing_is_lost(tmp_path):
    arm = Arm({1: LinkError("gone"), 2: StoppedError("program stopped"), 4: LinkError("gone")})
    with pytest.warns(WrenchbedWarning, match=r"pose \d: .*: trying again"):
        done = run(arm, tmp_path / "r.parquet")
    assert (done.tried_again, arm.recovered) == (3, 3)
    assert "soft" in arm.stops
    assert poses(tmp_path / "r.parquet") == [20, 10, 10, 10]


def test_a_stopped_campaign_goes_on_where_it_stopped(tmp_path):
    path = tmp_path / "r.parquet"
    with pytest.raises(KeyboardInterrupt):
        run(Arm({2: KeyboardInterrupt()}), path)
    first = wb.Recording.read(path)
    assert poses(path) == [10, 10, 0, 0]
    arm = Arm()
    counts = []
    done = run(arm, path, resume=True, progress=counts.append)
    rec = wb.Recording.read(path)
    assert (done.visited, arm.moves, counts) == (2, 3, [2, 1, 1])
    assert poses(path) == [20, 10, 10, 10]
    assert np.array_equal(rec.wrench[:20], first.wrench)
    assert (np.diff(rec.t) > 0).all()
    assert rec.metadata.extra["started"] == first.metadata.extra["started"]
    assert done.drift.seconds > 0.0


class Switched(Gauge):
    identity = property(lambda self: {"counts_per_force": 1 + self.arm.moves // self.move})


@pytest.mark.parametrize("move, go_on", [(1, "`record …`,"), (3, "`record … --resume`")])
def test_a_sensor_set_otherwise_ends_a_run_before_its_pose_is_whole(tmp_path, move, go_on):
    arm, out = Arm(), tmp_path / "rec.parquet"
    arm.transducer = Switched(arm)
    arm.transducer.move = move
    told = f"counts_per_force = 1, not 2: set the box as it was and go on: {go_on}"
    with arm, pytest.raises(PlanError, match=told):
        wb.record(arm, PLAN, out, samples=4)
    if move > 1:
        assert sorted(wb.Recording.read(out).columns["pose"]) == [0] * 4 + [1] * 4


def test_a_robot_in_fault_takes_no_target():
    with Arm() as arm:
        arm.state = Health("fault", "drive 3 is hot")
        applied = arm.write(arm.q)
        assert applied.sent is None
        assert applied.reason == "fault: drive 3 is hot"
        with pytest.raises(DriverError, match="drive 3 is hot"):
            arm.move(arm.q + 0.01)


WEIGHT = 1.35 * 9.80665
"""Of the nominal tool [N]."""


@pytest.fixture
def arm():
    with Arm() as one:
        yield one


def test_without_limits_the_box_is_around_the_way_and_the_load_within_the_range(arm):
    arm.state = Health("fault")  # limits are shown before somebody recovers it
    found = live_limits(arm, PLAN)
    poses = np.vstack([UR5.home, PLAN.q])
    _, at = UR5.sensor_pose(poses, UR5.parameters.nominal)
    lower, upper = np.asarray(found.limits.workspace)
    assert (at - lower >= MARGIN_M - 1e-9).all() and (upper - at >= MARGIN_M - 1e-9).all()
    assert (upper - lower < np.ptp(at, axis=0) + 0.3).all()
    assert found.limits.force == pytest.approx((WEIGHT + 65.0) / 2.0, abs=0.01)
    lever = float(np.linalg.norm(UR5.tool(UR5.parameters.nominal).cog))
    assert found.limits.torque == pytest.approx((WEIGHT * lever + 5.0) / 2.0, abs=0.01)
    assert found.limits.speed == arm.limits.speed
    assert found.to_json()["derived"] == ["workspace", "force", "torque"]


def test_the_sensors_zero_widens_the_limit_and_one_out_of_range_is_refused(arm):
    arm.push[:] = (0.0, 30.0, 0.0, 0.0, 0.0, 1.0)
    found = live_limits(arm, PLAN).limits
    assert found.force == pytest.approx((WEIGHT + 30.0 + 65.0) / 2.0, abs=0.1)
    arm.push[1] = 55.0
    with pytest.raises(LimitError, match="set its zero, or give --max-force"):
        live_limits(arm, PLAN)


def test_what_was_given_stays_and_nothing_is_worked_out(monkeypatch):
    box = ((-2.0, -2.0, -2.0), (2.0, 2.0, 2.0))
    with Arm(workspace=box, force=20.0, torque=2.0, speed=0.1) as arm:
        monkeypatch.setattr(arm, "_read_wrench", None)
        found = live_limits(arm, PLAN)
        assert found.limits is arm.limits and found.to_json()["derived"] == []


def test_a_run_states_its_limits_and_keeps_to_them(tmp_path):
    arm = Arm()
    run(arm, tmp_path / "r.parquet")
    stated = wb.Recording.read(tmp_path / "r.parquet").metadata.extra["limits"]
    assert stated["max_force"] == arm.limits.force < 65.0
    assert stated["workspace"] == [v for bound in arm.limits.workspace for v in bound]
    arm.push[:3] = 50.0
    with arm, pytest.raises(LimitError, match="measured force"):
        arm.guard()
    with arm, pytest.raises(PlanError, match="outside the workspace"):
        arm.move(UR5.home + np.array([1.5, 0.0, 0.0, 0.0, 0.0, 0.0]))


def test_a_recording_holds_what_joints_report(tmp_path):
    class Telling(Arm):
        def _read(self):
            sample = super()._read()
            extra_columns = {"i": np.arange(6.0), "joint_temperature": np.full(6, 30.0)}
            return replace(sample, extra_columns=extra_columns)

    run(Telling(), tmp_path / "r.parquet")
    rec = wb.Recording.read(tmp_path / "r.parquet")
    assert (rec.columns["i4"] == 3.0).all() and (rec.columns["joint_temperature6"] == 30.0).all()


def test_a_motion_stays_in_its_own_box(arm):
    share = np.linspace(0.0, 1.0, 200)[:, None]
    motion = wb.Plan.of("ur5", UR5.home + 0.2 * share * np.ones(6), rate_hz=125.0)
    _, at = UR5.sensor_pose(motion.q, UR5.parameters.nominal)
    lower, upper = np.asarray(live_limits(arm, motion).limits.workspace)
    assert np.allclose(lower, at.min(axis=0) - MARGIN_M, atol=1e-3)
    assert np.allclose(upper, at.max(axis=0) + MARGIN_M, atol=1e-3)
