"""What ordinary noise does not have: held values, episodes, a narrow peak, outliers."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from arm_gaps import case

from altered import with_columns
from wrenchbed.diagnosis.efforts.diagnose_efforts import diagnose_efforts
from wrenchbed.diagnosis.efforts.options import facts_of
from wrenchbed.diagnosis.efforts.signs import episode, held, outliers, peak
from wrenchbed.diagnosis.explain.verdict import Cause, Part, Verdict
from wrenchbed.diagnosis.gap.gaps import Interval

RATE, ROWS = 125.0, 5000
T = np.arange(ROWS) / RATE
USE = np.ones(ROWS, dtype=bool)


def noise(seed):
    """White noise (N,), heavier tailed than a Gaussian."""
    return np.random.default_rng(seed).standard_t(6.0, ROWS)


@pytest.mark.parametrize("seed", range(5))
def test_ordinary_noise_has_no_sign(seed):
    left = noise(seed)
    steps = np.round(3.0 * left) / 3.0
    assert held(T, steps, np.ones(ROWS)) == ""
    assert episode(T, left, USE) == "" and peak(left, RATE) == "" and outliers(T, left, USE) == ""


def test_each_sign_is_found_and_dated():
    effort, speed = noise(1), np.ones(ROWS)
    effort[1000:1050] = effort[1000]
    assert "from 8.0 s to 8.4 s" in held(T, effort, speed)
    speed[990:1060] = 0.0
    assert held(T, effort, speed) == ""  # a held value counts only while the joint moves
    left = noise(2)
    left[2500:2625] *= 3.0
    assert "from 20.0 s to 21.0 s" in episode(T, left, USE)
    ringing = noise(3) + 1.5 * np.sin(2.0 * np.pi * 9.3 * T)
    assert "9.3 Hz" in peak(ringing, RATE)
    left = noise(4)
    left[1250] = 40.0
    assert "at 10.0 s" in outliers(T, left, USE)


@pytest.mark.slow
def test_a_hit_once_a_turn_is_unknown_and_says_when():
    healthy = case(seed=31)
    hits = np.zeros(len(healthy.t))
    hits[:: len(hits) // 12] = 1.0
    age = np.arange(125) / 125.0
    ring = np.exp(-5.0 * age) * np.sin(2.0 * np.pi * 10.0 * age)
    tau3 = healthy.columns["tau3"] + 8.0 * np.convolve(hits, ring)[: len(hits)]
    d = diagnose_efforts(with_columns(healthy, {"tau3": tau3})).diagnosis
    assert d.verdict == "unknown" and not d.which
    assert d.where[0]["detail"] == "joint 3" and " s " in d.where[0]["sentence"]


@pytest.mark.parametrize(
    ("closed", "after", "right"), [(0.9, 0.1, 1.0), (0.5, 0.1, 0.85), (0.9, 3.0, 0.85)]
)
def test_a_cause_that_leaves_much_or_a_gap_in_its_joint_is_less_sure(closed, after, right):
    cause = Cause((("drive.load", 2),), 1.0, Part("drive.load", 6.0, index=1, joint=2))
    verdict = Verdict("identified", (cause,), (), {"drive.load": 1.0})
    channels = {"tau1": {"before": 9.0, "after": 5.0}, "tau2": {"before": 9.0, "after": after}}
    share = Interval(closed, closed - 0.1, closed + 0.1)
    gap = SimpleNamespace(closed=share, per_channel=channels)
    facts = facts_of(SimpleNamespace(d=SimpleNamespace(blocks=[])), (), 0)
    assert facts.right(verdict, gap) == right
    assert facts.right(replace(verdict, word="none", causes=()), gap) == 0.85
