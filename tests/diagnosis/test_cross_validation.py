"""The second vote is the exact predictive density; learnt reliability tempers what is claimed."""

import json
from dataclasses import replace

import numpy as np
import pytest

from wrenchbed import registry
from wrenchbed.benchmark.lookalikes import ExperimentDesign, draw, recording
from wrenchbed.benchmark.scoring import cases as at_design
from wrenchbed.diagnosis.evidence.likelihood import BackgroundLevel
from wrenchbed.diagnosis.explain.finalist import Finalist
from wrenchbed.diagnosis.explain.reliability import (
    NAMES,
    RIGHT_ELSEWHERE,
    Reliability,
    learnt,
    shipped,
)
from wrenchbed.diagnosis.explain.structures import prediction_errors
from wrenchbed.errors import DiagnosisError
from wrenchbed.planning import choose


@pytest.mark.parametrize("columns", [5, 60], ids=["many rows", "many columns"])
def test_each_block_is_predicted_from_all_others(columns):
    rng = np.random.default_rng(columns)
    rows = 24
    E = rng.standard_normal((rows, columns))
    level = BackgroundLevel(
        E, np.tile(rng.uniform(0.5, 2.0, 6), rows // 6), rng.uniform(0.1, 1.0, columns)
    )
    design, spread = rng.standard_normal((rows, 3)), np.array([1.0, 0.5, 2.0])
    y = rng.standard_normal(rows)
    f = Finalist((), 0, np.zeros(3), np.eye(3), y, y, design, spread, 0.0)
    block = np.array([0, 0, 1, 2])
    K = np.diag(level.v0) + (E * level.V) @ E.T + (design * spread**2) @ design.T
    errors = np.empty(rows)
    for b in range(3):
        own = np.repeat(block, 6) == b
        gain = K[np.ix_(own, ~own)] @ np.linalg.inv(K[np.ix_(~own, ~own)])
        mean = gain @ y[~own]
        errors[own] = y[own] - mean
    assert prediction_errors(level, f, block) == pytest.approx(errors, rel=1e-6)


def test_reliability_learns_what_tells_right_claims_from_wrong():
    rng = np.random.default_rng(0)
    truth = np.zeros(len(NAMES))
    truth[:3] = 1.0, 3.0, -2.0
    x = np.column_stack([np.ones(4000), rng.uniform(0, 1, (4000, len(NAMES) - 1))])
    right = rng.random(4000) < 1.0 / (1.0 + np.exp(-x @ truth))
    claims = list(zip(x.tolist(), right.tolist(), strict=True))
    model = learnt(claims, (9, 10), (8, 10), "a test")
    assert np.abs(np.array(model.claim)[:3] - truth[:3]).max() < 0.6
    assert model.none == pytest.approx(10 / 12)
    told = np.array([model.of(f) for f in x])
    for low in (0.2, 0.4, 0.6, 0.8):
        inside = (told >= low) & (told < low + 0.2)
        if inside.sum() > 100:
            assert abs(told[inside].mean() - right[inside].mean()) < 0.06
    with pytest.raises(DiagnosisError, match="nothing to learn"):
        learnt([], (1, 1), (1, 1), "nothing")


def still(seed=0, poses=24):
    robot = registry.load("robots", "ur5")
    design = ExperimentDesign.of_plan(choose.poses(robot, poses, seed), robot, samples=30)
    return recording(design, draw(design, 5, "none"))


def test_look_alikes_are_kept_and_not_computed_twice(tmp_path):
    """Another seed or another design has a cache of its own."""
    rows = still()
    key, *others = (
        at_design._key(ExperimentDesign.of(r), of)
        for r, of in ((rows, 0), (rows, 1), (still(1), 0))
    )
    assert len({key, *others}) == 3
    features = [1.0] + [0.1] * (len(NAMES) - 1)
    judged = {"kind": "single", "raw": "identified", "named": True, "features": features}
    known = [judged | {"index": k, "right": k % 4 > 0} for k in range(20)]
    text = "".join(json.dumps(r) + "\n" for r in known)
    (tmp_path / f"look-alikes-{key}.jsonl").write_text(text + '{"index": 20, "ki')
    told = []
    model = at_design.reliability_at_design(rows, 20, cache=tmp_path, report=told.append)
    assert told == [20]
    assert isinstance(model, Reliability)
    assert 0.5 < model.of(features) < 0.999
    with pytest.raises(DiagnosisError, match="at least 20"):
        at_design.reliability_at_design(rows, 3, cache=tmp_path)


def test_one_look_alike_is_drawn_and_judged():
    at_design._in_process(ExperimentDesign.of(still(poses=30)), 0)
    row = at_design._row_of(6)  # a case without a gap
    assert (row["kind"], row["raw"], row["right"]) == ("none", "none", True)
    assert len(row["features"]) == len(NAMES)


# ---- what ships ----------------------------------------------------------------------------------


def test_a_model_for_recordings_unlike_its_cases_knows_only_the_share_that_was_right():
    known = learnt([((1.0,) * len(NAMES), k % 10 > 0) for k in range(100)], (9, 10), (9, 10), "me")
    assert known.right == pytest.approx(91 / 102)
    odd = (1.0, *(5.0,) * (len(NAMES) - 1))
    assert known.plain().of(odd) == pytest.approx(RIGHT_ELSEWHERE)
    poor = replace(known, right=0.6)
    assert poor.plain().of(odd) == pytest.approx(0.6)
    assert known.plain().spread == known.spread


def test_what_ships_was_learnt_from_many_cases_most_of_them_right():
    """Other robots get what all robots taught."""
    for robot, moving in (("ur5", False), ("medrue", False), ("ur5", True), ("other", False)):
        known = shipped(robot, moving)
        assert known is not None
        assert known.cases >= 60 and len(known.claim) == len(NAMES)
        assert 0.8 < known.right < 1.0 <= known.spread < 2.5
    assert shipped("another", False) == shipped("yet another", False)
    assert shipped("another", False).cases > shipped("ur5", False).cases
