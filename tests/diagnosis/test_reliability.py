"""How often claims are right, as learnt and as applied."""

from dataclasses import replace

import pytest

from wrenchbed.diagnosis.explain.reliability import NAMES, RIGHT_ELSEWHERE, learnt, shipped


def test_a_model_for_recordings_unlike_its_cases_knows_only_the_share_that_was_right():
    known = learnt([((1.0,) * len(NAMES), k % 10 > 0) for k in range(100)], (9, 10), (9, 10), "me")
    assert known.right == pytest.approx(91 / 102)
    odd = (1.0, *(5.0,) * (len(NAMES) - 1))
    assert known.plain().of(odd) == pytest.approx(RIGHT_ELSEWHERE)
    poor = replace(known, right=0.6)
    assert poor.plain().of(odd) == pytest.approx(0.6)
    assert known.plain().spread == known.spread


@pytest.mark.parametrize(("robot", "moving"), [("ur5", False), ("medrue", False), ("ur5", True)])
def test_what_ships_was_learnt_from_many_cases_most_of_them_right(robot, moving):
    known = shipped(robot, moving)
    assert known is not None
    assert known.cases >= 60
    assert 0.8 < known.right < 1.0


def test_other_robots_get_what_all_robots_taught():
    assert shipped("another", False) == shipped("yet another", False)
    assert shipped("another", False).cases > shipped("ur5", False).cases
