"""Motions streamed ahead of time: what is recorded of them, and what ends them."""

import time

import numpy as np
import pytest
from test_run_live import UR5, Arm

from wrenchbed.errors import DriverError, LimitError, LinkError
from wrenchbed.hardware.device import Health
from wrenchbed.hardware.drivers import live
from wrenchbed.hardware.drivers.base import Applied, ArmSample

STANDING = np.repeat(UR5.home[None], 400, axis=0)


class Ahead(Arm):
    """An arm that is told its targets ahead, and is at each when it is due."""

    lead = 0.3

    def __init__(self, **limits) -> None:
        super().__init__(**limits)
        self.due: list[tuple[float, np.ndarray]] = []

    def _stream(self, q: np.ndarray, at: float) -> Applied:
        self.due.append((at, np.array(q)))
        return Applied(q)

    def _read(self) -> ArmSample:
        now = time.monotonic()
        if self.due:
            t, q = zip(*self.due, strict=True)
            self.q = np.array([np.interp(now, t, column) for column in np.transpose(q)])
        return ArmSample(now, None, 0.0, self.q, np.zeros(6))


def sweep(n: int) -> np.ndarray:
    q = np.repeat(UR5.home[None], n, axis=0)
    q[:, 0] += 0.4 * np.arange(n) / n
    return q


def columns(blocks) -> dict[str, np.ndarray]:
    found = list(blocks)
    return {k: np.concatenate([block[k] for block in found]) for k in found[0]}


def test_the_whole_trajectory_is_sent_and_recorded():
    targets = sweep(200)
    with Ahead() as arm:
        rows = columns(arm.track(targets, 125.0))
    assert len(arm.due) == len(rows["q1"]) == 200
    at = np.array([t for t, _ in arm.due])
    assert np.abs(np.diff(at) - 0.008).max() < 1e-6  # though the loop is late now and then
    assert np.abs(rows["q1"] - targets[:, 0]).max() < 0.4 * 3 / 200
    assert np.abs(rows["q1"] - rows["q_target1"]).max() < 0.4 * 2 / 200
    assert arm.stops == ["soft"]


def test_no_state_of_a_fast_robot_is_lost_however_late_the_loop_is(monkeypatch):
    """States come at 500 Hz and are kept; the loop looks every 8 ms or later."""

    class Fast(Arm):
        def _states(self, after):
            ends = (np.floor(t * 500.0 + 1e-6) + 1 for t in (after, time.monotonic()))  # rounding
            ticks = np.arange(*ends)
            return [ArmSample(t, None, 0.0, self.q, np.zeros(6)) for t in ticks / 500.0]

    taken, add = [], live.Resampler.add
    monkeypatch.setattr(
        live.Resampler, "add", lambda even, arm: (taken.append(arm.t), add(even, arm))
    )
    monkeypatch.setattr(live, "_POLL_S", 0.008)
    with Fast() as arm:
        assert len(columns(arm.track(STANDING[:60], 125.0))["t"]) == 60
    assert np.diff(taken) == pytest.approx(0.002, abs=1e-6)


@pytest.mark.parametrize("kind", ["soft", "hard"])
def test_a_stop_from_elsewhere_ends_the_motion(kind):
    with Ahead() as arm:
        rows = arm.track(STANDING, 125.0)
        next(rows)
        arm.stop(kind)
        sent = len(arm.due)
        with pytest.raises(DriverError, match="a stop was asked for"):
            list(rows)
        assert len(arm.due) == sent and arm.stops[0] == kind


def test_a_load_in_motion_stops_the_arm_hard():
    with Ahead(force=40.0) as arm:
        rows = arm.track(STANDING, 125.0)
        next(rows)
        assert arm.stops == []
        arm.push = np.array([0.0, 0.0, 60.0, 0.0, 0.0, 0.0])
        with pytest.raises(LimitError, match="above the limit 40 N"):
            list(rows)
        assert arm.stops and set(arm.stops) == {"hard"}


def test_a_motion_that_is_left_stops_the_arm():
    with Arm() as arm:
        rows = arm.track(STANDING, 125.0)
        next(rows)
        rows.close()
        assert arm.stops == ["soft"]


def test_a_gap_stops_the_arm():
    def gap(t):
        raise LinkError("the sensor's readings have a gap")

    with Arm() as arm:
        rows = arm.track(STANDING, 125.0)
        next(rows)
        arm.transducer._at = gap
        with pytest.raises(LinkError, match="have a gap"):
            list(rows)
        assert arm.stops == ["soft"]


def test_a_stop_that_fails_stands_beside_its_cause():
    def mute(kind):
        raise LinkError("no answer")

    with Arm() as arm:
        arm._stop = mute
        rows = arm.track(STANDING, 125.0)
        next(rows)
        arm.state = Health("stopped", "the program ended")
        with pytest.raises(DriverError, match="the program ended") as told:
            list(rows)
        assert told.value.__notes__ == ["the stop failed, too: no answer"]


def test_a_move_that_is_interrupted_as_it_begins_is_stopped():
    with Arm({0: KeyboardInterrupt()}) as arm:
        with pytest.raises(KeyboardInterrupt):
            arm.move(arm.q + 0.01)
        assert arm.stops == ["soft"]
