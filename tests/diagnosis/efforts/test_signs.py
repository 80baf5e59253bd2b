"""What ordinary noise does not have: held values, episodes, a narrow peak, outliers."""

from dataclasses import replace

import numpy as np
import pytest
from arm_gaps import case

from altered import with_columns
from wrenchbed.diagnosis.efforts.diagnose_efforts import diagnose_efforts
from wrenchbed.diagnosis.efforts.signs import episode, held, outliers, peak
from wrenchbed.diagnosis.efforts.verdict import Cause, Verdict, upheld
from wrenchbed.diagnosis.gap.gaps import Closure, Interval

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


TEN = Interval(10.0, 9.0, 11.0)


def gap(first, second, after=0.1, calibrated=TEN, closed=0.9):
    """A gap, what two causes close, and what is left in the second one's joint."""
    before = min(10.0, calibrated.value)
    share = Interval(closed, closed - 0.1, closed + 0.05) if isinstance(closed, float) else closed
    left = {f"tau{j}": {"before": before, "after": a} for j, a in ((1, 0.1), (2, after))}
    rest, members = Interval(1.0, 0.5, 1.5), {"0": first, "1": second}
    return Closure(10.0, calibrated, rest, 0.0, share, None, 1000, 20, left, members, None, {})


def two(other=("drive.load", 2)):
    """Two causes."""
    causes = (Cause(0, ("drive.coulomb", 1), (), 1.0, 0.7), Cause(1, other, (), 1.0, 0.3))
    return Verdict("identified", causes, {"drive.coulomb": 1.0})


CLEAR, SMALL, LOOSE = Interval(6.0, 5.0, 7.0), Interval(0.5, 0.4, 0.6), Interval(2.0, 0.1, 3.9)


def imitated(closed, second=CLEAR):
    """A gap that ordinary errors explain, of which causes close so much."""
    return gap(CLEAR, second, calibrated=Interval(0.1, 0.0, 0.2), closed=closed)


@pytest.mark.parametrize(("second", "count"), [(CLEAR, 2), (SMALL, 1), (LOOSE, 1)])
def test_a_further_cause_needs_a_gap_of_its_own(second, count):
    assert len(upheld(two(), gap(CLEAR, second)).causes) == count


def test_two_causes_of_one_joint_are_a_or_b():
    found = upheld(two(("drive.load", 1)), gap(CLEAR, Interval(7.0, 6.0, 8.0)))
    assert [(c.key, c.rivals) for c in found.causes] == [
        (("drive.load", 1), (("drive.coulomb", 1),))
    ]
    assert found.word == "ambiguous"


def test_two_causes_of_the_whole_arm_are_two_causes():
    v = two(("tool.mass", None))
    v = replace(v, causes=(replace(v.causes[0], key=("base.tilt", None)), v.causes[1]))
    found = upheld(v, gap(CLEAR, CLEAR))
    assert found.word == "identified" and len(found.causes) == 2


def test_a_cause_that_leaves_a_gap_in_its_joint_is_not_sure():
    found = upheld(two(), gap(CLEAR, CLEAR, after=3.0))
    sure = {c.key[1]: c.probability for c in found.causes}
    assert sure[1] == 1.0 and sure[2] < 0.9


def test_an_answer_that_held_out_rows_refute_leaves_nothing_sure():
    found = upheld(two(), imitated(Interval(0.0, -1.0, 1.0)))
    assert found.word == "none" and found.probabilities["none"] < 0.9
    assert sum(found.probabilities.values()) == pytest.approx(1.0)


SOME, NEUTRAL, LESS = Interval(0.1, 0.05, 0.2), Interval(0.0, -0.1, 0.1), Interval(-0.3, -0.4, -0.1)


@pytest.mark.parametrize(
    ("closed", "stated", "kept"),
    [
        (SOME, None, True),
        (NEUTRAL, None, False),
        (NEUTRAL, Interval(0.9, 0.8, 0.95), True),
        (NEUTRAL, Interval(0.1, -0.1, 0.3), False),
        (LESS, Interval(0.9, 0.8, 0.95), False),
    ],
)
def test_a_cause_that_ordinary_errors_imitate_is_named_less_surely_unless_rows_refute_it(
    closed, stated, kept
):
    found = upheld(two(), imitated(closed), stated=stated)
    assert bool(found.causes) == kept == found.imitated
    assert sum(found.probabilities.values()) == pytest.approx(1.0)
    assert all(c.probability <= 0.85 for c in found.causes)
    assert found.of_configured == (kept and closed is NEUTRAL)


def test_a_cause_that_rows_refute_by_itself_is_not_named_beside_one_that_they_do_not():
    assert upheld(two(), imitated(SOME)).imitated
    assert upheld(two(), imitated(SOME, LESS)).word == "none"


def test_weak_evidence_of_what_ordinary_errors_imitate_is_none():
    weak = two()
    weak = replace(weak, causes=(replace(weak.causes[0], probability=0.6),))
    assert upheld(weak, imitated(SOME)).word == "none"
