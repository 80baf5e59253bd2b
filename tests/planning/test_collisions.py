"""Collisions on the way, ways around them, and the limits that are checked before a move."""

from itertools import pairwise

import numpy as np
import pytest

import wrenchbed as wb
from wrenchbed.campaigns.moves import itinerary
from wrenchbed.errors import PlanError
from wrenchbed.planning.collisions import Clearance
from wrenchbed.robots.checked_moves import Limits

UR5 = wb.load("robots", "ur5")
INTO_BENCH = np.array([0.0, 0.35, 0.0, 0.0, 1.5708, 0.0])  # the arm points 20° below the horizon


@pytest.fixture(scope="module")
def clearance():
    return Clearance(UR5)


def test_arms_are_named_in_their_bench_and_against_themselves_alone(clearance):
    assert clearance.hit(UR5.home) == ""
    assert [clearance.hit(q) for q in UR5.sample(40, np.random.default_rng(0))] == [""] * 40
    assert "would touch" in clearance.hit(INTO_BENCH)
    assert "what stands around it" in clearance.hit(INTO_BENCH)
    # Elbow folded to 170° and wrist turned in: flange and tool lie on the upper arm.
    folded = np.array([0.0, -1.5708, 2.8, 0.3, -1.5708, 0.0])
    hits = {clearance.hit(folded + np.array([0, 0, 0, w, 0, 0])) for w in np.linspace(-3, 3, 25)}
    assert any("upper_arm" in what and "would touch" in what for what in hits)


@pytest.mark.slow
def test_blocked_ways_go_around_and_each_leg_is_free_on_a_finer_grid(clearance):
    rng = np.random.default_rng(3)
    drawn = rng.uniform([-3, -3.1, 2.2, -3, -3, -3], [3, 0, 2.9, 3, 3, 3], (60, 6))
    free = [q for q in drawn if not clearance.hit(q)]
    around = 0
    for start, end in pairwise(free[:24]):
        if not clearance.blocked(start, end):
            continue
        way = clearance.path(start, end, "test")
        assert len(way) > 1
        assert np.array_equal(way[-1], end)
        for a, b in pairwise([start, *way]):
            for share in np.linspace(0, 1, 400):
                hit = clearance.hit(a + share * (b - a))
                assert not hit, hit
        around += 1
    assert around >= 3


@pytest.mark.slow
def test_where_there_is_no_way_the_pose_or_the_place_of_the_robot_is_refused(clearance):
    under = UR5.home.copy()
    under[1] += 2 * np.pi  # the same pose, one turn on: the upper arm would go through the bench
    assert clearance.hit(under) == ""
    with pytest.raises(PlanError, match=r"pose 7: .* no way around was found: leave this pose"):
        clearance.path(UR5.home, under, "pose 7")
    with pytest.raises(PlanError, match=r"no way around was found: move the robot .* by hand"):
        clearance.path(INTO_BENCH + np.array([0, 0.2, 0, 0, 0, 0]), UR5.home, "row 0")


def test_an_itinerary_is_refused_by_row():
    plan = wb.Plan.of("ur5", np.stack([UR5.home, INTO_BENCH]))
    with pytest.raises(PlanError, match=r"row 1: .* would touch"):
        itinerary(UR5, plan, UR5.home, Limits(), [0, 1], clear=True)
    free = itinerary(UR5, plan, UR5.home, Limits(), [0, 1], clear=False)
    assert [len(leg.via) for leg in free] == [1, 1]


@pytest.mark.parametrize("name", ["ur5", "medrue"])
def test_a_joint_that_stands_past_its_limit_may_come_back_but_go_no_further(name):
    robot = wb.load("robots", name)
    past, other = robot.home.copy(), robot.home.copy()
    past[1] = robot.joints[1].lower - 0.02
    other[1] = robot.joints[1].lower + 0.02
    plan = wb.Plan.of(name, np.stack([other]))
    (leg,) = itinerary(robot, plan, past, Limits(), [0], clear=False)
    assert np.array_equal(leg.via[-1], other)
    with pytest.raises(PlanError, match=r"q2 = .* is outside its limits"):
        itinerary(
            robot, wb.Plan.of(name, np.stack([past - 0.01])), past, Limits(), [0], clear=False
        )


def test_slower_limits_take_longer_in_proportion():
    plan = wb.Plan.of("ur5", UR5.sample(3, np.random.default_rng(1)))
    fast, slow = (
        sum(leg.seconds for leg in itinerary(UR5, plan, UR5.home, Limits(s), range(3), clear=True))
        for s in (0.4, 0.1)
    )
    assert slow == pytest.approx(4 * fast)
