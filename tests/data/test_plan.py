"""Plans: written and read back, refused by row where the robot cannot go."""

import numpy as np
import pytest

from recorded import save
from wrenchbed import registry
from wrenchbed.data.plan import Plan
from wrenchbed.errors import PlanError
from wrenchbed.planning import choose
from wrenchbed.robots.checked_moves import Limits

UR5 = registry.load("robots", "ur5")
MEDRUE = registry.load("robots", "medrue")


LEAST = {"format": 1, "robot": "ur5"}


def columns(n=5):
    return {f"q{j}": np.linspace(0, 1, n) for j in range(1, 7)}


@pytest.mark.parametrize("rate", [None, 125.0])
def test_a_plan_returns_as_written(tmp_path, rate):
    plan = Plan.of("ur5", np.random.default_rng(0).normal(size=(7, 6)), rate_hz=rate)
    plan.write(tmp_path / "plan.parquet")
    again = Plan.read(tmp_path / "plan.parquet")
    assert np.array_equal(again.q, plan.q)
    assert np.array_equal(again.segment, plan.segment)
    assert (again.robot, again.mode, again.rate_hz) == ("ur5", plan.mode, rate)


def test_the_contracts_minimum_is_a_plan_and_dwell_and_segment_are_kept(tmp_path):
    plan = Plan.read(save(tmp_path / "plan.parquet", columns(), LEAST))
    assert (plan.mode, plan.segment.tolist()) == ("static", [0, 1, 2, 3, 4])
    data = columns() | {"segment": np.array([3, 3, 1, 1, 0]), "dwell": np.full(5, 0.5)}
    plan = Plan.read(save(tmp_path / "plan.parquet", data, LEAST))
    assert list(plan.segment) == [3, 3, 1, 1, 0]
    plan.write(tmp_path / "again.parquet")
    assert np.array_equal(Plan.read(tmp_path / "again.parquet").dwell, np.full(5, 0.5))


@pytest.mark.parametrize(
    ("data", "metadata", "words"),
    [
        ({"x": np.zeros(3)}, LEAST, "column 'q1' is missing; found x"),
        ({k: v[:0] for k, v in columns().items()}, LEAST, "0 rows"),
        (columns() | {"q2": np.full(5, np.nan)}, LEAST, "column 'q2', row 0: nan"),
        (columns() | {"q2": np.array(list("abcde"))}, LEAST, "column 'q2' holds"),
        (columns() | {"dwell": np.array([1, 1, -1, 1, 1.0])}, LEAST, "'dwell', row 2: -1.0 s"),
        (columns() | {"segment": np.full(5, 0.5)}, LEAST, "'segment' must hold whole"),
        (columns(), {"format": 1}, "robot is missing: it must be"),
        (columns(), {"format": 1, "robot": "ur5", "mode": "x"}, "mode = 'x'"),
        (columns(), {"format": 1, "robot": "ur5", "rate_hz": -5}, "rate_hz = -5"),
        (columns(), {"format": 9, "robot": "ur5"}, "format is 9"),
    ],
)
def test_bad_plans_name_file_column_and_row(tmp_path, data, metadata, words):
    path = save(tmp_path / "plan.parquet", data, metadata)
    with pytest.raises(PlanError, match=words) as caught:
        Plan.read(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("robot", [UR5, MEDRUE], ids=lambda r: r.name)
def test_a_multisine_starts_and_ends_at_rest_within_limits(robot):
    plan = choose.multisine(robot, 20.0, 125.0, seed=1)
    assert (len(plan), plan.mode, plan.rate_hz) == (2500, "dynamic", 125.0)
    Limits().check_motion(robot, plan.q, 125.0, "plan")
    speed = np.diff(plan.q, axis=0) * 125.0
    assert np.abs(speed[[0, -1]]).max() < 1e-3 * np.abs(speed).max()
    assert np.abs(speed).max(axis=0).min() > 0.01
    assert np.array_equal(plan.q, choose.multisine(robot, 20.0, 125.0, seed=1).q)


def test_what_cannot_be_planned_says_why():
    with pytest.raises(PlanError, match="0 poses is empty"):
        choose.poses(UR5, 0, seed=0)
    with pytest.raises(PlanError, match="no joints to plan"):
        choose.poses(registry.load("robots", "oriented"), 5, seed=0)
    with pytest.raises(PlanError, match="at least 5 s"):
        choose.multisine(UR5, 1.0, 125.0, seed=0)
