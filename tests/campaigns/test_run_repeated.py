"""What a campaign tries again by itself, and what a person must look at first."""

import time
import warnings
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from test_run_live import PLAN, UR5, Arm, Gauge, poses, run

from wrenchbed.campaigns import run as recording_run
from wrenchbed.campaigns.resume import Retries, retries
from wrenchbed.data.plan import Plan
from wrenchbed.data.recording import Recording
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
from wrenchbed.hardware.device import Health, State
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
    plan = Plan.of("ur5", np.repeat(UR5.home[None], n, axis=0), rate_hz=125.0)
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
    assert (done.visited, len(Recording.read(path))) == (60, 60)
    assert (tmp_path / "r.parquet~").read_text() == "precious"
    assert len(Recording.read(tmp_path / "r.parquet.cut~")) == 20


def test_a_motion_that_was_stopped_for_safety_is_not_begun_again(tmp_path):
    arm = Cut(SafetyStopError("protective stop"))
    with pytest.raises(
        SafetyStopError, match="look what happened, then begin anew: `record … --recover`"
    ):
        moving(arm, tmp_path / "r.parquet")
    assert arm.recovered == 0
    assert len(Recording.read(tmp_path / "r.parquet")) == 20


def test_touches_are_refused_before_the_arm_moves(tmp_path):
    arm = Arm()
    plan = Plan.of("ur5", PLAN.q, points=np.zeros((4, 3)))
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
