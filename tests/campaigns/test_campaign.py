"""Campaigns of many robots: rows follow from seed and number, and none is lost or doubled."""

import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import wrenchbed as wb
from wrenchbed.campaigns import summary
from wrenchbed.campaigns.monte_carlo import (
    SECONDS,
    SETTING,
    Fleet,
    campaign,
    recorded,
    robot_row,
    schema,
    varied,
)
from wrenchbed.errors import FleetError, ParameterError

SMALL = {"poses": 24, "samples": 8}


def small(robots=4, vary=("noise", "parameters"), robot="ur5", **more) -> Fleet:
    return Fleet(robot, robots, vary, **{**SMALL, **more})


def same(a: pa.Table, b: pa.Table) -> bool:
    """Whether two tables are equal bit for bit, but for what time they took."""
    a, b = (x.drop_columns(list(SECONDS)) for x in (a, b))
    assert a.schema == b.schema
    for name in a.column_names:
        left, right = (x[name].to_numpy(zero_copy_only=False) for x in (a, b))
        if left.dtype.kind == "f":
            left, right = left.view("i8"), right.view("i8")
        if not np.array_equal(left, right):
            return False
    return True


def bare(row):
    return {k: v for k, v in row.items() if k not in SECONDS}


def test_a_row_follows_from_its_number_and_seed_alone():
    here, there = robot_row(small(4), 3), robot_row(small(9), 3)
    assert bare(here) == bare(there)
    assert here["error"] == "" and here["rank"] == 24
    assert here["fit.tool.mass"] != robot_row(small(4, seed=1), 3)["fit.tool.mass"]
    quiet = robot_row(small(4, ("parameters",)), 3)
    assert quiet["true.tool.mass"] == here["true.tool.mass"]  # noise is drawn apart
    assert quiet["fit.tool.mass"] != here["fit.tool.mass"]


@pytest.mark.parametrize("robot", ["ur5", "medrue"])
def test_calibration_brings_robots_close_to_their_truth(robot):
    fleet = Fleet(robot, 3, ("noise", "parameters"), poses=60, samples=20)
    model = wb.Model.of(fleet.model_robot())
    for row in (robot_row(fleet, k) for k in range(3)):
        assert row["error"] == ""
        assert row["force.after"] < 0.05 * row["force.before"]
        assert row["torque.after"] < 0.05 * row["torque.before"]
        if robot == "medrue":
            assert row["position.after"] < 0.1 * row["position.before"]
        for i in varied(model):
            p = model.parameters[i]
            assert abs(row[f"true.{p.name}"] - p.nominal) <= p.tolerance
            assert row[f"true.{p.name}"] != p.nominal


def test_what_does_not_vary_is_the_same_for_all():
    still = [bare(robot_row(small(3, ()), k)) for k in range(2)]
    assert {**still[0], "robot": 1} == still[1]
    assert still[0]["force.before"] == 0.0
    (a, _), (b, _) = (recorded(small(3, ("poses",)), k) for k in range(2))
    assert np.abs(a.q - b.q).max() > 0.1
    (a, _), (b, _) = (recorded(small(3, ("noise",)), k) for k in range(2))
    assert np.array_equal(a.q, b.q) and not np.array_equal(a.wrench, b.wrench)


def test_a_plan_is_run_by_all_robots_at_rest_and_in_motion():
    plan = wb.multisine(wb.load("robots", "ur5"), 8.0, 60.0, 1)
    recording, _ = recorded(fleet := Fleet("ur5", 2, ("noise",), plan=plan), 1)
    assert recording.metadata.mode == "dynamic" and np.array_equal(recording.q, plan.q)
    assert robot_row(fleet, 0)["error"] == ""
    with pytest.raises(ParameterError, match="the plan is for robot 'ur5'"):
        Fleet("medrue", 2, plan=plan)


def test_settings_that_make_no_sense_are_named(tmp_path):
    with pytest.raises(ParameterError, match="no model"):
        Fleet("oriented", 2)
    with pytest.raises(ParameterError, match="--robots 1000000000: give 1 to 1,000,000"):
        Fleet("ur5", 10**9)
    (tmp_path / SETTING).write_text(json.dumps(small(1).to_json()))
    with pytest.raises(FleetError, match="seed = 0, not 5"):
        campaign(small(1, seed=5), tmp_path)
    row = robot_row(Fleet("ur5", 1, poses=2, samples=2), 0)  # too few poses: a row says so
    assert "Error" in row["error"] and row["robot"] == 0


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    return campaign(small(6), folder, workers=1)


@pytest.mark.slow
def test_rows_of_workers_are_those_of_one(whole, tmp_path):
    table = campaign(small(6), tmp_path / "c", workers=2)
    assert same(table, whole)
    assert table["robot"].to_pylist() == list(range(6))
    assert pq.read_table(tmp_path / "c" / "robots.parquet").num_rows == 6
    assert sorted(p.name for p in (tmp_path / "c").iterdir()) == [
        "campaign.json", "parts", "robots.parquet",
    ]  # fmt: skip
    assert not list((tmp_path / "c" / "parts").iterdir())


@pytest.mark.slow
def test_a_stopped_campaign_goes_on_and_may_grow(whole, tmp_path):
    told = []

    def stop(n):
        told.append(n)
        if sum(told) == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        campaign(small(6), tmp_path, workers=1, progress=stop)
    begun = list((tmp_path / "parts").iterdir())
    assert 3 <= len(begun) < 6
    table = campaign(small(5), tmp_path, workers=1)
    assert same(table, whole.slice(0, table.num_rows))
    assert same(campaign(small(6), tmp_path, workers=1), whole)
    again = []
    assert same(campaign(small(6), tmp_path, workers=1, progress=again.append), whole)
    assert sum(again) == 6


def test_the_summary_tells_errors_and_failures(tmp_path):
    fleet = small(40, ("noise", "parameters"))
    figures = {"force.before": 1.0, "force.after": 0.1, "inside95": 0.95}
    rows = [{"robot": k, "error": ""} | figures for k in range(39)]
    rows.append({"robot": 39, "error": "CalibrationError: too few poses"})
    page = summary.page(fleet, pa.Table.from_pylist(rows, schema=schema(fleet)), tmp_path)
    card, intervals = page.cards
    assert card.figure == "100.0 mN" and "1000 mN" in card.text and intervals.figure == "95.0 %"
    assert "log scale" in page.figures[0].chart.panels[0].x.text
    assert page.sections[-1].parts[-1].rows == (("39", "CalibrationError: too few poses"),)
    assert page.summary["failed"] == 1 and page.summary["force_after_median [mN]"] == 100.0
