"""Probabilities hold on arms that taught none of them; what is unlike those that taught is said."""

from concurrent.futures import Future
from dataclasses import replace

import numpy as np
import pytest

from wrenchbed import registry
from wrenchbed.benchmark.lookalikes import ExperimentDesign, draw, recording
from wrenchbed.benchmark.scoring import learn_reliability
from wrenchbed.diagnosis.explain import familiarity
from wrenchbed.diagnosis.explain.familiarity import LEAST_P, p_value
from wrenchbed.diagnosis.explain.reliability import (
    CONFIDENT,
    COVERED,
    NAMES,
    RIGHT_ELSEWHERE,
    SPREAD_ELSEWHERE,
    UNLEARNT,
    Lesson,
    conformal,
    credible,
    learnt,
    lessons,
    shipped,
)
from wrenchbed.errors import DiagnosisError
from wrenchbed.planning import choose

CLAIM = {"joint.offset": 0.9, "none": 0.04, "unknown": 0.06}


def taught(features, right, arm="a", weight=1.0):
    truth = ("joint.offset",) if right else ("unknown",)
    found = tuple(float(v) for v in features)
    return Lesson(arm, "static", "1", found, "joint.offset", truth, CLAIM, (), (0.0,), weight)


def claims(truth, count, rng):
    x = np.column_stack([np.ones(count), rng.uniform(0, 1, (count, len(NAMES) - 1))])
    right = rng.random(count) < 1.0 / (1.0 + np.exp(-x @ truth))
    return [taught(f, r) for f, r in zip(x, right, strict=True)]


def test_the_map_learns_what_speaks_for_a_claim_and_never_takes_more_of_it_for_less():
    rng = np.random.default_rng(0)
    model = learnt(claims([-1.0, 3.0, -2.0, 1.0, 0.0], 4000, rng), "")
    _, evidence, closed, complete, _ = model.claim
    assert evidence == pytest.approx(3.0, abs=0.4)
    assert closed == 0.0  # the truth falls with it, a monotone map does not
    assert complete == pytest.approx(1.0, abs=0.4)
    free = learnt(claims([-1.0, 3.0, 2.0, 1.0, 1.0], 4000, rng), "")
    assert free.claim == pytest.approx([-1.0, 3.0, 2.0, 1.0, 1.0], abs=0.4)
    with pytest.raises(DiagnosisError, match="nothing to learn"):
        learnt([], "")


def test_a_case_that_stands_for_three_counts_as_three():
    few = [taught((1, 0.5, 0.5, 0.5, 1), k > 0, weight=3.0) for k in range(9)]
    many = [replace(x, weight=1.0) for x in few for _ in range(3)]
    assert learnt(few, "").claim == pytest.approx(learnt(many, "").claim, rel=1e-9)


@pytest.mark.parametrize("count", [40, 150])
def test_sets_hold_the_truth_nine_times_in_ten_in_19_of_20_draws_of_few_cases(count):
    """A share below the level is covered; shares are uniform, so the level is the coverage."""
    rng = np.random.default_rng(count)
    levels = [conformal(rng.random(count), np.ones(count)) for _ in range(4000)]
    assert np.mean(np.array(levels) >= COVERED) >= CONFIDENT - 0.01
    assert np.median(levels) < 0.99


def test_too_few_cases_make_a_set_of_everything_possible():
    assert conformal([0.5] * 28, [1.0] * 28) == 1.0
    assert conformal([0.5] * 29, [1.0] * 29) == 0.5
    assert conformal([0.5] * 50, [1.0, *[1e-3] * 49]) == 1.0  # weighs as much as one case
    assert set(credible(CLAIM, 1.0)) == set(CLAIM)


def test_p_values_of_exchangeable_points_are_uniform_and_of_a_strange_one_small():
    rng = np.random.default_rng(1)
    drawn = rng.standard_t(4.0, (600, 100, 5)) * [1.0, 10.0, 0.1, 1.0, 1.0]
    found = np.array([p_value(points[0], points[1:]) for points in drawn])
    for level in (0.05, 0.2, 0.5, 0.8):
        assert np.mean(found <= level) == pytest.approx(level, abs=0.06)
    strange = p_value([0.0, 0.0, 4.0, 0.0, 0.0], drawn[0])
    assert strange < LEAST_P


def test_recordings_that_taught_are_familiar_and_others_are_not():
    model = shipped()
    p = [model.p_value(x.mode, x.design) for x in lessons()]
    assert np.mean(np.array(p) < LEAST_P) <= LEAST_P
    surest = (1.0,) * len(NAMES)
    strange, usual = (model.believed_at(p, "static") for p in (0.009, 0.011))
    assert strange.of(surest) == RIGHT_ELSEWHERE < usual.of(surest)
    count = 40  # too few for a p-value of 0.01: less like than each
    few = replace(model, designs={"dynamic": model.designs["dynamic"][:count]})
    moving, likely = (few.believed_at(k / (count + 1), "dynamic") for k in (1, 2))
    assert UNLEARNT.believed_at(1.0, "dynamic") is UNLEARNT  # lessons are made with it
    assert model.believed_at(1.0, "other").spread == moving.spread == SPREAD_ELSEWHERE
    assert strange.spread == SPREAD_ELSEWHERE > usual.spread == likely.spread
    usual = np.median(model.designs["static"], axis=0)
    assert model.p_value("static", usual) > 0.2
    for feature, value in (("joints", 0.0), ("force", -1.0), ("orientations", -5.0)):
        strange = usual.copy()
        strange[familiarity.NAMES.index(feature)] = value
        assert model.p_value("static", strange) < LEAST_P


def scores(p, right, weight):
    log = -np.log(np.where(right, p, 1.0 - p))
    return np.average((p - right) ** 2, weights=weight), np.average(log, weights=weight)


def test_the_map_holds_on_arms_that_taught_none_of_it():
    """Every arm is left out once; one fraction of right claims stands beside the map."""
    every = lessons()
    arms = sorted({x.arm for x in every})
    assert len(arms) >= 6
    assert {round(x.design[0]) for x in every} == {6, 7}
    rows = []
    for arm in arms:
        others = learnt([x for x in every if x.arm != arm], "")
        claims = [x for x in every if x.arm == arm and x.features]
        rows += [(others.of(x.features), x.right, x.weight, x.mode == "dynamic") for x in claims]
    p, right, weight, moving = map(np.array, zip(*rows, strict=True))
    brier, log = scores(p, right, weight)
    flat_brier, flat_log = scores(np.full(len(p), RIGHT_ELSEWHERE), right, weight)
    assert brier < flat_brier
    assert log < flat_log
    assert abs(np.average(p, weights=weight) - np.average(right, weights=weight)) < 0.03
    sure = p > 0.9
    assert np.average(right[sure], weights=weight[sure]) > 0.95
    assert np.count_nonzero(sure & moving) >= 20  # a motion is not doubted as such


def still(seed=0, poses=24):
    robot = registry.load("robots", "ur5")
    design = ExperimentDesign.of_plan(choose.poses(robot, poses, seed), robot, samples=30)
    return recording(design, draw(design, 5, "none"))


def test_look_alikes_teach_beside_other_cases(monkeypatch):
    weak = (1.0, 0.1, 0.1, 0.1, 1.0)
    known = [taught(weak, k % 4 > 0) for k in range(20)]
    known = [replace(x, design=lessons()[0].design) for x in known]

    def at_once(work, items, finished, processes):
        for k in reversed(items):  # in any order; one of them cannot be drawn
            future = Future()
            future.set_result(known[k] if k < 20 else None)
            finished(k, future)

    monkeypatch.setattr(learn_reliability, "in_workers", at_once)
    asked = []
    model = learn_reliability.reliability_at_design(still(), 21, report=asked.append)
    assert sum(asked) == 21
    assert model.of(weak) == learnt([*lessons(), *known], "").of(weak) != shipped().of(weak)
    assert "20 look-alikes of this recording" in model.source
    with pytest.raises(DiagnosisError, match="at least 20"):
        learn_reliability.reliability_at_design(still(), 3)


def test_one_look_alike_is_drawn_and_judged():
    at = ExperimentDesign.of(still(poses=30))
    none, single = (learn_reliability.lesson_at(at, 0, k) for k in (6, 0))
    assert (none.lead, none.truth, none.features, single.case) == ("none", ("none",), (), "0-0")
    assert len(none.design) == len(lessons()[0].design)
