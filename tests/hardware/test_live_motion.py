"""Motions streamed ahead of time, and rows on an even clock from states that come unevenly."""

import time

import numpy as np
import pytest
from test_run_live import UR5, Arm

from wrenchbed.errors import DriverError, LimitError, LinkError
from wrenchbed.hardware.device_base import ClockFit, Health
from wrenchbed.hardware.drivers import live_base
from wrenchbed.hardware.drivers.base import Applied, ArmSample
from wrenchbed.hardware.drivers.live_base import pace, settled
from wrenchbed.hardware.drivers.row_times import Resampler, hermite
from wrenchbed.hardware.transducers.base import Past

STANDING = np.repeat(UR5.home[None], 400, axis=0)


class Ahead(Arm):
    """An arm that is told its targets ahead, and is at each when it is due."""

    lead, rate = 0.3, 125.0

    def __init__(self, **limits) -> None:
        super().__init__(**limits)
        self.due: list[tuple[float, np.ndarray]] = []

    def _stream(self, q: np.ndarray, at: float) -> Applied:
        self.due.append((at, np.array(q)))
        return Applied(q)

    def _read(self) -> ArmSample:
        return self._at(time.monotonic())

    def _at(self, now: float) -> ArmSample:
        if self.due:
            t, q = zip(*self.due, strict=True)
            self.q = np.array([np.interp(now, t, column) for column in np.transpose(q)])
        return ArmSample(now, None, 0.0, self.q, np.zeros(6))

    def _states(self, after: float) -> list[ArmSample]:  # a link keeps them for a late machine
        ends = (np.floor(t * self.rate + 1e-6) + 1 for t in (after, time.monotonic()))  # rounding
        return [self._at(tick / self.rate) for tick in np.arange(*ends)]


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
    taken, add = [], live_base.Resampler.add
    monkeypatch.setattr(
        live_base.Resampler, "add", lambda even, arm: (taken.append(arm.t), add(even, arm))
    )
    monkeypatch.setattr(live_base, "_POLL_S", 0.008)
    monkeypatch.setattr(Ahead, "rate", 500.0)
    with Ahead() as arm:
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


def test_a_motion_that_is_left_or_interrupted_stops_the_arm():
    with Arm() as arm:
        rows = arm.track(STANDING, 125.0)
        next(rows)
        rows.close()
        assert arm.stops == ["soft"]
    with Arm({0: KeyboardInterrupt()}) as arm:
        with pytest.raises(KeyboardInterrupt):
            arm.move(arm.q + 0.01)
        assert arm.stops == ["soft"]


def fails(_):
    raise LinkError("no answer")


def test_a_gap_stops_the_arm_and_a_stop_that_fails_stands_beside_its_cause():
    with Arm() as arm:
        rows = arm.track(STANDING, 125.0)
        next(rows)
        arm.transducer._at = fails
        with pytest.raises(LinkError, match="no answer"):
            list(rows)
        assert arm.stops == ["hard"]
    with Arm() as arm:
        arm._stop = fails
        rows = arm.track(STANDING, 125.0)
        next(rows)
        arm.state = Health("stopped", "the program ended")
        with pytest.raises(DriverError, match="the program ended") as told:
            list(rows)
        assert told.value.__notes__ == ["the stop failed, too: no answer"]


OMEGA = 2 * np.pi * 0.7


def state(t: float, arrival: float) -> ArmSample:
    q = 0.8 * np.sin(OMEGA * t + np.arange(6))
    qd = 0.8 * OMEGA * np.cos(OMEGA * t + np.arange(6))
    return ArmSample(arrival, 50.0 + t, 0.0, q, qd)


def test_late_states_and_gaps_leave_no_trace_in_the_rows():
    rng = np.random.default_rng(0)
    even, rows = Resampler(125.0), []
    drift = 400e-6
    for k in range(1200):
        if k % 7 == 3 or 300 <= k < 304:
            continue  # lost on the way, once five in a row
        t = k * 0.008
        held = 0.03 - 0.008 * (k % 60) if k > 600 and k % 60 < 4 else 0.0  # four come at once
        even.add(state(t, 1000.0 + t * (1 + drift) + held + rng.exponential(1e-3)))
        rows += even.rows(10)
    t = np.array([r.t for r in rows])
    assert len(rows) > 1190
    assert np.abs(np.diff(t) - 0.008).max() < 1e-12
    own = np.arange(len(rows)) * 0.008
    wanted = 0.8 * np.sin(OMEGA * own[:, None] + np.arange(6))
    q, qd = np.array([r.q for r in rows]), np.array([r.qd for r in rows])
    gap = (own > 2.39) & (own < 2.45)
    assert np.abs(q - wanted)[~gap].max() < 1e-7
    assert np.abs(q - wanted)[gap].max() < 1e-5  # a fifth of a millidegree over 40 ms
    speed = 0.8 * OMEGA * np.cos(OMEGA * own[:, None] + np.arange(6))
    assert np.abs(qd - speed).max() < 1e-3
    host = np.array([r.host for r in rows])
    assert np.abs(host - (1000.0 + own * (1 + drift)))[400:].max() < 3e-4


def test_states_are_taken_once_in_order_and_not_too_far_apart():
    even = Resampler(100.0, begin=-0.01)
    for t in (-0.02, -0.01, 0.0, 0.01, 0.01, 0.005, 0.02):
        even.add(state(t, t))
    assert [round(r.t, 6) for r in even.rows(10)] == [0.0, 0.01, 0.02]
    even = Resampler(100.0)
    for t in (0.0, 0.01, 0.02, 0.25):
        even.add(ArmSample(t, None, 0.0, np.zeros(6), np.zeros(6)))
    assert len(even.rows(3)) == 3
    with pytest.raises(LinkError, match=r"gap of 0\.230 s"):
        even.rows(9)


def test_extra_columns_and_joints_lie_on_lines_and_cubics_between_states():
    even = Resampler(100.0)
    for k in range(4):
        t, still = 0.04 * k, np.zeros(1)
        current = {"i": np.array([float(k)])}
        even.add(ArmSample(t, t, 0.0, still, still, extra_columns=current))
    rows = even.rows(9)
    assert [row.extra_columns["i"][0] for row in rows] == pytest.approx(0.25 * np.arange(9))
    ends = np.array([[1.0], [1.5]])
    for s in (0.0, 0.3, 1.0):
        q, qd = hermite(tuple(ends**3 - ends), tuple(3 * ends * ends - 1), 0.5, s)
        t = 1.0 + 0.5 * s
        assert q[0] == pytest.approx(t**3 - t)
        assert qd[0] == pytest.approx(3 * t * t - 1)


def test_calm_is_within_three_and_a_half_standard_errors():
    half = np.tile([[1.0], [-1.0]], (8, 6))  # 16 rows, variance 16 / 15
    error = np.sqrt(2.0 * (16.0 / 15.0) / 16.0)
    for step, expected in ((3.4, True), (3.6, False), (-3.6, False)):
        moved = half.copy()
        moved[:, 2] += step * error
        assert settled(np.concatenate([half, moved])) is expected
    assert not settled(np.zeros((7, 6))) and settled(np.zeros((8, 6)))


def test_ticks_are_even_and_a_missed_one_is_not_made_up_for(monkeypatch):
    slept = []
    monkeypatch.setattr(time, "sleep", slept.append)
    monkeypatch.setattr(time, "monotonic", lambda: 10.0)
    assert pace(10.3, 0.1) == pytest.approx(10.4)
    assert slept == [pytest.approx(0.3)]
    assert pace(9.95, 0.1) == pytest.approx(10.05)  # late by half a period: caught up
    assert pace(9.5, 0.1) == pytest.approx(10.1)  # by five: from now on
    assert len(slept) == 1


def test_the_least_late_of_many_readings_tells_how_clocks_stand():
    fit = ClockFit(0.25)
    assert fit.ppm is None
    for k in range(300):
        t = 0.01 * k
        fit.add(t, t * (1.0 + 1e-3) + 0.5 + (0.0 if k % 25 == 0 else 0.02))
    assert fit.host(3.0) == pytest.approx(3.503, abs=1e-6)
    assert fit.ppm == pytest.approx(-1e3, abs=1e-3)
    fit.clear()
    for k in range(60):  # too few for a slope
        fit.add(0.01 * k, 0.01 * k + 0.5 + (0.02 if k % 7 else 0.0))
    assert fit.host(9.0) == pytest.approx(9.5) and fit.ppm is None


def past(*readings):
    """Readings that came one by one: (time [s], force [N], status, saturated)."""
    kept = Past()
    for t, force, *flags in readings:
        kept.add(t, [force, 0.0, 0.0, 0.0, 0.0, 0.0], *flags)
    return kept


def test_readings_between_two_have_the_flags_of_both_and_the_nearer_counts():
    between = past((1.00, 1.0, 1), (1.04, 3.0, 2, 4)).at(1.01)
    assert between.wrench[0] == pytest.approx(1.5)
    assert (between.status, between.saturated) == (3, 4)
    assert between.age == pytest.approx(0.01)
    close = past((1.0, 1.0), (1.0005, 3.0), (1.0025, 5.0))
    forces = [close.at(t).wrench[0] for t in (1.0, 1.0002, 1.0003, 1.0005, 1.0015)]
    assert forces == pytest.approx([1.0, 1.0, 3.0, 3.0, 4.0])
    batch = Past()
    batch.add([1.0, 1.0005, 1.0025], np.outer([1.0, 3.0, 5.0], np.ones(6)))
    assert batch.at(1.0015).wrench == pytest.approx(np.full(6, 4.0))
    some = past((1.0, 0.0), (1.04, 0.0), (1.2, 0.0))
    assert some.at(0.99) is None and some.at(1.21) is None and some.at(1.1) is None
    assert some.at(1.0) is not None and some.at(1.2).age == 0.0 and Past().at(1.0) is None
    some.add(5.0, np.ones(6))
    assert some.at(1.02) is None
