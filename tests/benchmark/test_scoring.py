"""Figures of a benchmark, against numbers computed by hand."""

import math

import numpy as np
import pytest

from wrenchbed import registry
from wrenchbed.benchmark.lookalikes import ExperimentDesign, draw, recording
from wrenchbed.benchmark.lookalikes.imperfection import ImperfectRobot
from wrenchbed.benchmark.scoring.baselines import BASELINES
from wrenchbed.benchmark.scoring.case_rows import OURS, CaseRow, Claim, Number
from wrenchbed.benchmark.scoring.metrics import (
    METRICS,
    effect_cells,
    figure,
    figure_cells,
    matched,
    probability,
    right,
    size_cells,
)
from wrenchbed.data.plan import Plan
from wrenchbed.diagnosis.prepare.prepare_recording import prepare
from wrenchbed.effects.chain import ActiveEffect, effects, respond

NONE = Claim("none", (), {"none": 0.9, "base.tilt": 0.1})
UNKNOWN = Claim("unknown", (), {"unknown": 0.8, "none": 0.2})


def named(*classes, p=0.95):
    key = "|".join(classes[0])
    presence = (p,) * len(classes)
    return Claim("identified", tuple(classes), {key: p, "none": 1 - p}, presence)


def row(name, kind, claim, *effects, **more):
    shown = {"size": dict.fromkeys(effects, 4.0), "detectability": dict.fromkeys(effects, 40.0)}
    return CaseRow(name, kind, effects, answers={OURS: claim}, **(shown | more))


TILT = row("a", "single", named(("base.tilt",)), "base.tilt", where="base")
RIVAL = row("b", "single", named(("joint.offset", "base.tilt")), "base.tilt", where="joint")
MISSED = row("c", "single", NONE, "sensor.gain", where="base")
ROWS = [
    TILT, RIVAL, MISSED,
    row("d", "none", NONE),
    row("e", "none", named(("cable.pull",), p=0.7)),
    row("f", "outside", UNKNOWN, outside="magnet"),
    row("g", "outside", named(("cable.pull",), p=0.99), outside="magnet"),
    row("h", "pair", named(("base.tilt",), ("x.y",)), "base.tilt", "tool.mass", where="tool"),
]  # fmt: skip


def value(key, rows=ROWS):
    return figure(METRICS[key], rows, draws=50).value


def test_shares_are_counted_over_their_own_kind():
    assert value("isolation") == pytest.approx(2 / 3)
    assert value("first") == pytest.approx(1 / 3)
    assert value("false_alarm") == value("unknown") == value("misnamed") == 0.5
    # a, b right, g wrong, h right in its first class; e is not sure
    assert value("sure") == pytest.approx(3 / 4)
    # base; joint is the first choice of a class that holds the truth; base is not sensor; tool
    assert value("where") == pytest.approx(3 / 4)


def test_effects_below_three_sigma_do_not_count():
    weak = row("w", "single", NONE, "sensor.gain", detectability={"sensor.gain": 2.9})
    assert figure(METRICS["isolation"], [weak]) is None
    assert value("isolation", [*ROWS, weak]) == pytest.approx(2 / 3)


def test_calibration_error_by_hand():
    # stated 0.95, 0.95, 0.95, 0.99 | 0.9 (none) twice: all in the last bin: 5.64 stated, right
    # are a, b, h, d; 0.7 wrong in its bin; 0.8 right in its bin
    stated = 3 * 0.95 + 0.99 + 2 * 0.9
    expected = (abs(stated - 4) + 0.7 + abs(0.8 - 1)) / 8
    assert value("ece") == pytest.approx(expected)


def test_log_score_by_hand():
    told = [0.95, 0.95, 1e-4, 0.9, 0.3, 0.8, 1e-4, 0.95]
    assert [probability(r, r.answers[OURS]) for r in (ROWS[0], ROWS[4])] == [0.95, 1 - 0.7]
    assert value("log_score") == pytest.approx(-sum(map(math.log, told)) / 8)


def test_two_effects_by_hand():
    assert matched(ROWS[-1], ROWS[-1].answers[OURS]) == (1, 1, 1)
    assert value("pairs") == pytest.approx(0.5)
    both = row("i", "pair", named(("x.y", "base.tilt"), ("tool.mass",)), "base.tilt", "tool.mass")
    assert value("pairs", [ROWS[-1], both]) == pytest.approx(2 * 3 / (2 * 3 + 1 + 1))


def test_coverage_counts_parameters():
    inside, outside = Number("x", 1.0, 0.1, 1.16), Number("y", 1.0, 0.1, 1.17)
    told = [
        row("n", "single", NONE, "base.tilt", numbers=(inside, outside)),
        row("o", "single", NONE, "base.tilt", numbers=(outside,)),
    ]
    assert value("coverage", told) == pytest.approx(1 / 3)


def test_closure_against_the_oracle():
    told = [
        row("p", "single", NONE, "base.tilt", closed=0.9, oracle=1.0),
        row("q", "single", NONE, "base.tilt", closed=-5.0, oracle=0.8),
        row("r", "single", NONE, "base.tilt"),
    ]
    assert value("closed", told) == pytest.approx(-0.05)
    assert value("of_oracle", told) == pytest.approx(-0.1 / 1.8)


def test_only_none_is_right_where_nothing_is_wrong():
    assert right(ROWS[3], NONE) and not right(ROWS[3], UNKNOWN)
    assert right(ROWS[5], UNKNOWN) and not right(ROWS[5], NONE)
    assert not right(TILT, Claim("error", (), {}))


def test_intervals_hold_the_value_and_shrink():
    claims = [named(("base.tilt",)), NONE]
    rows = [row(str(k), "single", claims[k % 2], "base.tilt") for k in range(400)]
    wide, tight = (figure(METRICS["isolation"], rows[:n]) for n in (20, 400))
    assert wide.low < 0.5 < wide.high and tight.low < 0.5 < tight.high
    assert tight.high - tight.low == pytest.approx(4 * math.sqrt(0.25 / 400), rel=0.15)
    assert wide.high - wide.low > 3 * (tight.high - tight.low)


def test_tables_say_what_was_scored():
    head, lines = figure_cells(ROWS, [OURS], METRICS, "ours")
    assert head == ["", "target", "ours (95 %)", "n"]
    title = "isolation: a claimed class holds the effect"
    assert lines[0] == [title, "≥ 95 %", "67 % (9–99)", "2 of 3"]
    joint = row("j", "single", named(("drive.viscous.3",)), "drive.coulomb.2")
    lines = effect_cells([*ROWS, joint])[1]
    assert ["base.tilt", "2", "4", "2", "0", "0", "–"] in lines
    assert ["drive.coulomb", "1", "4", "0", "0", "0", "drive.viscous 1"] in lines
    assert ["4–8", "3", "67 %", "67 %"] in size_cells(ROWS, [OURS])[1]


@pytest.mark.parametrize("effect", ["base.tilt", "mount.rotation", "joint.offset", "sensor.gain"])
def test_true_parameters_have_the_published_names_and_signs(effect):
    """The library's effect at the true parameters reads as the look-alike does."""
    robot = registry.load("robots", "ur5")
    q = robot.sample(30, np.random.default_rng(3))
    design = ExperimentDesign.of_plan(Plan.of("ur5", q), robot, samples=20)
    case = draw(design, 5, "single", effect, 2.0)
    true = case.true(effect)
    own = effects()[effect]
    scene = prepare(recording(design, case)).scene
    active = [ActiveEffect(own, own.values(robot, true))]
    here = respond(scene, active) - respond(scene)
    items = [(i, k) for i, k in case.items if i.name == effect]
    there = ImperfectRobot(design).reading(items) - design.nominal
    scale = np.abs(there).max(axis=0)
    np.testing.assert_allclose(here[scene.held], there, atol=0.04 * scale.max(), rtol=0.05)


# ---- simple methods beside the diagnosis


@pytest.fixture(scope="module")
def tilted():
    robot = registry.load("robots", "ur5")
    q = robot.sample(60, np.random.default_rng(2))
    design = ExperimentDesign.of_plan(Plan.of("ur5", q), robot, samples=30)
    return recording(design, draw(design, 1, "single", "base.tilt", 4.0))


def test_one_large_effect_is_named_first_and_alone(tilted):
    claim = BASELINES["bic"](tilted)
    assert claim.verdict == "identified" and claim.causes == (("base.tilt",),)
    assert claim.sure > 0.99 and min(claim.probabilities.values()) >= 0.0
    assert sum(claim.probabilities.values()) == pytest.approx(1.0)
    assert BASELINES["bic"](tilted) == claim


def test_none_never_claims(tilted):
    assert BASELINES["none"](tilted) == Claim("none", (), {"none": 1.0})
