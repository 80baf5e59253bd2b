"""Rows on an even clock from states that come unevenly, late and with gaps."""

import numpy as np
import pytest

from wrenchbed.hardware.drivers.base.live import settled
from wrenchbed.hardware.drivers.base.samples import ArmSample
from wrenchbed.hardware.drivers.base.timing import Resampler, hermite

OMEGA = 2 * np.pi * 0.7


def state(t: float, arrival: float) -> ArmSample:
    q = 0.8 * np.sin(OMEGA * t + np.arange(6))
    qd = 0.8 * OMEGA * np.cos(OMEGA * t + np.arange(6))
    return ArmSample(arrival, 50.0 + t, 0, 0.0, True, q, qd)


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


def test_repeated_and_older_states_are_left_out():
    even = Resampler(100.0)
    for t in (0.0, 0.01, 0.01, 0.005, 0.02):
        even.add(state(t, t))
    assert [round(r.t, 6) for r in even.rows(10)] == [0.0, 0.01, 0.02]


def test_evidence_lies_on_a_line_between_two_states():
    even = Resampler(100.0)
    for k in range(4):
        t, still = 0.04 * k, np.zeros(1)
        current = {"i": np.array([float(k)])}
        even.add(ArmSample(t, t, 0, 0.0, True, still, still, evidence=current))
    rows = even.rows(9)
    assert [row.evidence["i"][0] for row in rows] == pytest.approx([0.25 * k for k in range(9)])


def test_a_cubic_is_followed_exactly():
    def cubic(t):
        return ArmSample(t, t, 0, 0.0, True, np.array([t**3 - t]), np.array([3 * t * t - 1]))

    for s in (0.0, 0.3, 1.0):
        q, qd = hermite(cubic(1.0), cubic(1.5), 0.5, s)
        t = 1.0 + 0.5 * s
        assert q[0] == pytest.approx(t**3 - t)
        assert qd[0] == pytest.approx(3 * t * t - 1)


def test_noise_is_calm_and_a_swinging_load_is_not():
    rng = np.random.default_rng(1)
    noise = 0.05 * rng.standard_normal((200, 6))
    assert settled(noise)
    decay = np.exp(-np.arange(200) / 60.0)[:, None]
    assert not settled(noise + 0.3 * decay)
    assert not settled(noise[:5])
    quiet = sum(settled(0.05 * rng.standard_normal((60, 6))) for _ in range(300))
    assert quiet > 290
