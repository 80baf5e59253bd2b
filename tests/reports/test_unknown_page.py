"""A diagnosis that is really unknown: a fault that other code made and no effect of the library."""

import re
from dataclasses import replace

import numpy as np
import pytest

import consistent
import wrenchbed as wb
from wrenchbed.benchmark.referee.case import make
from wrenchbed.diagnosis.diagnose import Findings, diagnose
from wrenchbed.pages import numbers
from wrenchbed.reports.robot_chart import robot_chart
from wrenchbed.reports.simulators import Evidence


@pytest.fixture(scope="module")
def found() -> Findings:
    """Readings that drop out now and then, and a hundred small imperfections."""
    case = make("ur5", "static", "outside", (41, 3))
    assert case.causes[0].fault.name == "dropout"
    return diagnose(case.recording)


@pytest.mark.slow
def test_page_terminal_json_and_rerun_say_that_it_is_unknown(found):
    told = found.diagnosis.to_json()
    assert told["verdict"] == "unknown" and told["which"] == []
    assert consistent.violations(found) == []
    faces = consistent.faces(found)
    assert set(faces) == {"page", "terminal", "rerun"}
    gap = numbers.gap(told["gap"]["calibrated"])
    for name, text in faces.items():
        assert "unknown" in text and gap in text, name
        for step in told["next"]:
            assert step["sentence"] in text, name


def test_a_page_that_claimed_a_cause_all_the_same_would_be_noticed(found):
    texts = consistent.faces(found)
    texts["page"] = texts["page"].replace(numbers.gap(found.diagnosis.gap.calibrated.value), "0.31")
    assert consistent.violations_of(found, texts) != []


def test_the_robot_stands_where_most_is_left_with_the_poses_to_do_next(found):
    assert found.plans
    e = Evidence(found)
    chart = robot_chart(found, e)
    side = {s.name: s for s in chart.panels[0].series}
    above = {s.name: s for s in chart.panels[1].series}
    p = e.prepared
    left = p.y - e.before
    worst = int(np.argmax(((left / e.std) ** 2).sum(axis=1)))
    body = next(n for n in side if n.startswith("the robot in pose"))
    sensor = np.array([side[body].x[-2], above[body].y[-2], side[body].y[-2]]) / 1e3
    robot = wb.load("robots", "ur5")
    q = p.scene.joints[p.scene.held]
    rotation, position = robot.sensor_pose(q, robot.parameters.nominal)
    assert sensor == pytest.approx(np.asarray(position)[worst], abs=1e-6)  # by the closed form
    unit, length = re.search(r"1 (m?N) is ([\d.]+) mm long", chart.caption).groups()
    scale = float(length) * (1e3 if unit == "mN" else 1.0)
    arrows = np.stack([side["residual force"].x, above["residual force"].y,
                       side["residual force"].y], axis=1).reshape(-1, 3, 3)  # fmt: skip
    assert np.isnan(arrows[:, 2]).all()
    force = np.einsum("kij,kj->ki", np.asarray(rotation), left[:, :3])
    lengths = np.linalg.norm(arrows[:, 1] - arrows[:, 0], axis=1)
    known = scale * np.linalg.norm(force, axis=1)
    assert len(lengths) >= 30 and 100.0 <= lengths.max() <= 250.0
    assert all(np.abs(known - v).min() < 1e-6 * v + 1e-9 for v in lengths)
    plan = next(iter(found.plans.values()))
    assert f"5 of {len(plan)} poses of the next experiment" in chart.caption
    assert np.isnan(side["poses to do next"].x).sum() > 5


def test_without_a_plan_no_next_pose_is_drawn(found):
    chart = robot_chart(replace(found, plans={}), Evidence(found))
    names = {s.name for panel in chart.panels for s in panel.series}
    assert "poses to do next" not in names and "next experiment" not in chart.caption
