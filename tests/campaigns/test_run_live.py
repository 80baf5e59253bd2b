"""Campaigns on a live driver: what fails is tried again, what was stopped goes on."""

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from wrenchbed import registry
from wrenchbed.campaigns import run as recording_run
from wrenchbed.data.plan import Plan
from wrenchbed.data.recording import Recording
from wrenchbed.errors import (
    DriverError,
    LinkError,
    StoppedError,
    WrenchbedWarning,
)
from wrenchbed.hardware.device import Health
from wrenchbed.hardware.drivers.base import Applied, ArmSample
from wrenchbed.hardware.drivers.live import LiveDriver
from wrenchbed.hardware.transducers.base import Transducer, WrenchSample
from wrenchbed.robots.motion_limits import Limits
from wrenchbed.simulation.closed_form import Model

UR5 = registry.load("robots", "ur5")
PLAN = Plan.of("ur5", UR5.home + 0.2 * np.random.default_rng(0).standard_normal((4, 6)))


@dataclass(frozen=True)
class Options:
    limits: Limits | None = None


class Gauge(Transducer):
    """Reads what the model says at the arm's joints, with a little noise."""

    name, title, options = "gauge", "a test's sensor", Options

    def __init__(self, arm: "Arm") -> None:
        super().__init__()
        self.arm, self.model = arm, Model.of(UR5)
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
    return np.bincount(Recording.read(path).columns["pose"], minlength=4).tolist()


def test_every_pose_is_there_and_the_first_one_twice(tmp_path):
    done = run(Arm(), tmp_path / "r.parquet")
    assert (done.visited, done.rows, done.tried_again) == (4, 50, 0)
    assert poses(tmp_path / "r.parquet") == [20, 10, 10, 10]
    rec = Recording.read(tmp_path / "r.parquet")
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
    first = Recording.read(path)
    assert poses(path) == [10, 10, 0, 0]
    arm = Arm()
    counts = []
    done = run(arm, path, resume=True, progress=counts.append)
    rec = Recording.read(path)
    assert (done.visited, arm.moves, counts) == (2, 3, [2, 1, 1])
    assert poses(path) == [20, 10, 10, 10]
    assert np.array_equal(rec.wrench[:20], first.wrench)
    assert (np.diff(rec.t) > 0).all()
    assert rec.metadata.extra["started"] == first.metadata.extra["started"]
    assert done.drift.seconds > 0.0


def test_a_robot_in_fault_takes_no_target():
    with Arm() as arm:
        arm.state = Health("fault", "drive 3 is hot")
        applied = arm.write(arm.q)
        assert applied.sent is None
        assert applied.reason == "fault: drive 3 is hot"
        with pytest.raises(DriverError, match="drive 3 is hot"):
            arm.move(arm.q + 0.01)
