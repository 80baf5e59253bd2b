"""Figures of a benchmark, against numbers computed by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest

from wrenchbed import registry
from wrenchbed.benchmark.lookalikes import ExperimentDesign, draw, recording
from wrenchbed.benchmark.lookalikes.imperfection import ImperfectRobot
from wrenchbed.benchmark.scoring import metrics
from wrenchbed.benchmark.scoring.metrics import METRICS, figure, probability, right
from wrenchbed.benchmark.scoring.truth_and_claims import OURS, Answer, CaseRow, Claim, Fact, Oracle
from wrenchbed.benchmark.sealed.baselines import BASELINES, lasso_path
from wrenchbed.diagnosis.prepare.prepare_recording import prepare
from wrenchbed.effects.chain import ActiveEffect, effects, respond
from wrenchbed.planning.choose import poses

NONE = Claim("none", (), {"none": 0.9, "base.tilt": 0.1})
UNKNOWN = Claim("unknown", (), {"unknown": 0.8, "none": 0.2})


def named(*classes, p=0.95):
    key = "|".join(classes[0])
    presence = (p,) * len(classes)
    return Claim("identified", tuple(classes), {key: p, "none": 1 - p}, presence)


def row(kind, claim, *effects, gap=4.0, true=(), closed=None):
    """A case of 60 rows."""
    facts = tuple(Fact(effect, 1.0, gap, 0.0, dict(true), ()) for effect in effects)
    oracle = Oracle("none", (), closed)
    return CaseRow(Answer("a", "ur5", "static", kind, facts, 0.1, 60, oracle, ""), {OURS: claim})


TILT = row("single", named(("base.tilt",)), "base.tilt")
RIVAL = row("single", named(("joint.offset", "base.tilt")), "base.tilt")
MISSED = row("single", replace(NONE, subsystem="base"), "sensor.gain")
TWO = replace(named(("base.tilt",), ("x.y",)), subsystem="tool")
ROWS = [
    TILT, RIVAL, MISSED,
    row("none", NONE),
    row("none", named(("cable.pull",), p=0.7)),
    row("outside", UNKNOWN, "magnet"),
    row("outside", named(("cable.pull",), p=0.99), "magnet"),
    row("pair", TWO, "base.tilt", "tool.mass"),
]  # fmt: skip


def value(key, rows=ROWS):
    return figure(METRICS[key], rows, draws=50).value


def test_shares_are_counted_over_their_own_kind_and_from_three_sigma():
    assert value("isolation") == pytest.approx(2 / 3)
    assert value("false_alarm") == value("unknown") == value("misnamed") == 0.5
    # a, b right, g wrong, h right in its first class; e is not sure
    assert value("sure") == pytest.approx(3 / 4)
    # base; joint is the first choice of a class that holds the truth; base is not sensor; tool
    assert value("where") == pytest.approx(3 / 4)
    weak = row("single", NONE, "sensor.gain", gap=2.9**2 / 6 / 60)
    assert figure(METRICS["isolation"], [weak]) is None
    assert value("isolation", [*ROWS, weak]) == pytest.approx(2 / 3)
    healthy, outside = ROWS[3].truth, ROWS[5].truth
    assert right(healthy, NONE) and not right(healthy, UNKNOWN)
    assert right(outside, UNKNOWN) and not right(outside, NONE)
    assert not right(TILT.truth, Claim())


def test_a_cause_of_a_joint_is_named_with_that_joint():
    """Minor offsets of other joints are no joint of the cause."""
    true = {"offset.q1": 1e-4, "offset.q3": -4e-3}
    claims = [named(("base.tilt", "joint.offset")), named(("joint.offset",))]
    each = [replace(c, elements={"joint.offset": e}) for c in claims for e in (("joint 3",), ())]
    rows = [row("single", c, "joint.offset", true=true) for c in each]
    assert [value("joint", [r]) for r in rows] == [1.0, 0.0, 1.0, 0.0]
    assert figure(METRICS["joint"], [TILT]) is None


def test_calibration_error_and_log_score_by_hand():
    stated = 3 * 0.95 + 0.99 + 2 * 0.9
    expected = (abs(stated - 4) + 0.7 + abs(0.8 - 1)) / 8
    assert value("ece") == pytest.approx(expected)
    told = [0.95, 0.95, 1e-4, 0.9, 0.3, 0.8, 1e-4, 0.95]
    assert [probability(r.truth, r.claims[OURS]) for r in (ROWS[0], ROWS[4])] == [0.95, 1 - 0.7]
    assert value("log_score") == pytest.approx(-sum(map(math.log, told)) / 8)


@pytest.mark.parametrize(("joint", "expected"), [(2, 0.95), (3, 0.0)])
def test_probabilities_and_sets_name_effects_without_their_joints(joint, expected):
    odds = {"drive.coulomb": 0.95, "none": 0.05}
    claim = replace(
        named((f"drive.coulomb.{joint}",)), probabilities=odds, set90=("drive.coulomb",)
    )
    case = row("single", claim, "drive.coulomb.2")
    assert probability(case.truth, claim) == expected
    assert value("sets", [case]) == 1.0


def test_two_effects_coverage_and_closure_by_hand():
    assert metrics.matched(ROWS[-1].truth, TWO) == (1, 1, 1)
    assert value("pairs") == pytest.approx(0.5)
    both = row("pair", named(("x.y", "base.tilt"), ("tool.mass",)), "base.tilt", "tool.mass")
    assert value("pairs", [ROWS[-1], both]) == pytest.approx(2 * 3 / (2 * 3 + 1 + 1))
    x, y = ({"value": 1.0, "std": 0.1} for _ in range(2))
    both, one = (replace(NONE, parameters={"base.tilt": p}) for p in ({"x": x, "y": y}, {"y": y}))
    true = {"x": 1.16, "y": 1.17}  # inside, outside
    told = [row("single", claim, "base.tilt", true=true) for claim in (both, one)]
    assert value("coverage", told) == pytest.approx(1 / 3)
    gaps = {"calibrated": 1.1, "floor": 0.1}
    told = [
        row("single", replace(TILT.claims[OURS], gap=gaps | {"with_effects": after}), "base.tilt",
            closed=oracle)
        for after, oracle in ((0.2, 1.0), (6.1, 0.8), (0.1, None))
    ]  # fmt: skip
    assert value("of_oracle", told) == pytest.approx(-0.1 / 1.8)


def test_intervals_hold_the_value_and_shrink():
    claims = [named(("base.tilt",)), NONE]
    rows = [row("single", claims[k % 2], "base.tilt") for k in range(400)]
    wide, tight = (figure(METRICS["isolation"], rows[:n]) for n in (20, 400))
    assert wide.low < 0.5 < wide.high and tight.low < 0.5 < tight.high
    assert tight.high - tight.low == pytest.approx(4 * math.sqrt(0.25 / 400), rel=0.15)
    assert wide.high - wide.low > 3 * (tight.high - tight.low)


def test_tables_say_what_was_scored():
    isolation = metrics.figures(ROWS, [OURS])[OURS]["isolation"]
    assert METRICS["isolation"].text(isolation) == "67 % (9–99)" and isolation.counted == "2 of 3"
    joint = row("single", named(("drive.viscous.3",)), "drive.coulomb.2")
    lines = metrics.effect_cells([*ROWS, joint])[1]
    assert ["base.tilt", "2", "4", "2", "0", "0", "–"] in lines
    assert ["drive.coulomb", "1", "4", "0", "0", "0", "drive.viscous 1"] in lines
    assert ["4–8", "3", "67 %", "67 %"] in metrics.size_cells(ROWS)[1]


@pytest.mark.parametrize("effect", ["base.tilt", "mount.rotation", "joint.offset", "sensor.gain"])
def test_true_parameters_have_the_published_names_and_signs(effect):
    """The library's effect at the true parameters reads as the look-alike does."""
    robot = registry.load("robots", "ur5")
    design = ExperimentDesign.of_plan(poses(robot, 30, 3), robot, samples=20)
    case = draw(design, 5, "single", effect, 2.0)
    true = case.true_parameters(effect)
    own = effects()[effect]
    scene = prepare(recording(design, case)).scene
    active = [ActiveEffect(own, own.values(robot, true))]
    here = respond(scene, active) - respond(scene)
    items = [(i, k) for i, k in case.items if i.name == effect]
    there = ImperfectRobot(design).reading(items) - design.nominal
    scale = np.abs(there).max(axis=0)
    np.testing.assert_allclose(here[scene.held], there, atol=0.04 * scale.max(), rtol=0.05)


@pytest.fixture(scope="module")
def tilted():
    robot = registry.load("robots", "ur5")
    design = ExperimentDesign.of_plan(poses(robot, 60, 2), robot, samples=30)
    return recording(design, draw(design, 1, "single", "base.tilt", 4.0))


def test_one_large_effect_is_named_first_and_none_never_claims(tilted):
    claim = BASELINES["bic"](tilted)
    assert claim.verdict == "identified" and claim.causes == (("base.tilt",),)
    assert claim.sure > 0.99 and min(claim.probabilities.values()) >= 0.0
    assert sum(claim.probabilities.values()) == pytest.approx(1.0)
    assert BASELINES["bic"](tilted) == claim
    assert BASELINES["none"](tilted) == Claim("none", (), {"none": 1.0})


@pytest.mark.parametrize("method", ["lasso", "everything"])
def test_fits_of_all_effects_name_a_large_one_as_surely_as_halves_of_the_rows_do(method):
    robot = registry.load("robots", "ur5")
    design = ExperimentDesign.of_plan(poses(robot, 60, 2), robot, samples=30)
    bending = recording(design, draw(design, 1, "single", "tool.flexure", 4.0))
    claim = BASELINES[method](bending)
    assert claim.verdict == "identified" and claim.causes[0] == ("tool.flexure",)
    assert claim.sure > 0.7 and sum(claim.probabilities.values()) == pytest.approx(1.0)


def test_the_path_of_lasso_meets_the_conditions_of_an_optimum():
    rng = np.random.default_rng(5)
    columns = rng.normal(size=(200, 12)) * np.geomspace(1.0, 30.0, 12)
    y = columns[:, [2, 7]] @ [1.0, -0.1] + rng.normal(size=200)
    gram, score, size = columns.T @ columns, columns.T @ y, np.linalg.norm(columns, axis=0)
    penalties = np.array([1.0, 0.5, 0.1, 0.01])
    path = lasso_path(gram, score, penalties)
    assert not path[0].any() and set(np.flatnonzero(path[1])) <= {2, 7}
    for x, penalty in zip(path, np.abs(score / size).max() * penalties, strict=True):
        slope, there = (score - gram @ x) / size, x != 0.0
        assert (np.abs(slope) <= penalty * 1.001).all()
        np.testing.assert_allclose(slope[there], penalty * np.sign(x[there]), rtol=1e-3)


def test_a_black_box_sees_a_gap_and_names_nothing(tilted):
    robot = registry.load("robots", "ur5")
    design = ExperimentDesign.of_plan(poses(robot, 60, 2), robot, samples=30)
    healthy = recording(design, draw(design, 3, "none"))
    gap, without = (BASELINES["black-box"](r) for r in (tilted, healthy))
    assert gap.verdict == "unknown" and gap.causes == () and gap.sure > 0.99
    assert without.probabilities["unknown"] < gap.sure
