"""MedRUE against the golden configurations and the facts of its paper."""

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest

import wrenchbed as wb
from wrenchbed.calibration.observability import Observability
from wrenchbed.errors import PlanError
from wrenchbed.physics.wrench import wrench
from wrenchbed.robots.checked_moves import minimum_jerk
from wrenchbed.robots.medrue import inverse_kinematics, kinematics
from wrenchbed.robots.medrue.kinematics import IDENTIFIED, PAPER
from wrenchbed.simulation.mujoco_wrench import Simulation, loop_sites
from wrenchbed.simulation.servo_motion import ServoDrivenRobot

DATA = Path(__file__).parents[1] / "data"
GOLDEN = json.loads((DATA / "medrue_golden.json").read_text())
TABLE = json.loads((DATA / "medrue_parameters.json").read_text())["params"]
ROBOT = wb.load("robots", "medrue")
UNIT = np.array([{"m": 1e-3, "rad": np.pi / 180, "kg": 1.0}[p.unit] for p in PAPER])
CASES = [(c, w) for c in GOLDEN["cases"] for w in ("nominal", "actual")]


def theta_of(which: str) -> np.ndarray:
    theta = ROBOT.parameters.nominal
    theta[: len(PAPER)] = np.array(GOLDEN[which]) * UNIT
    return theta


def joints_of(psi: list[float]) -> np.ndarray:
    return np.concatenate([[psi[0] * 1e-3], np.deg2rad(psi[1:])])[None]


def test_the_49_parameters_are_the_papers_and_joints_come_back():
    assert list(PAPER.names) == GOLDEN["param_order"]
    assert np.array_equal(PAPER.nominal, np.array(GOLDEN["nominal"]) * UNIT)
    identified = [p["name"] for p in TABLE if not p["starred"] and not p["frozen_unstarred"]]
    assert set(IDENTIFIED) == set(identified) - {"dq1", "d31", "d32"}
    for case, which in CASES:
        theta, q = theta_of(which), joints_of(case["psi_mm_deg"])
        back = inverse_kinematics.joints(ROBOT.values(theta), *ROBOT.tool_pose(q, theta))
        assert np.abs(back - q).max() < 1e-12


@pytest.mark.parametrize(
    ("case", "which"), CASES, ids=lambda x: x if isinstance(x, str) else x["label"]
)
def test_golden_poses_and_wrenches(case, which):
    theta, q, wanted = theta_of(which), joints_of(case["psi_mm_deg"]), case[which]
    rotation, position = ROBOT.tool_pose(q, theta)
    assert np.abs(position[0] * 1e3 - wanted["tool_position_mm"]).max() < 1e-9
    assert np.abs(rotation[0].ravel() - wanted["tool_R_world_rowmajor"]).max() < 1e-12
    pose = ROBOT.sensor_pose(q, theta)
    closed = wrench(*pose, ROBOT.tool(theta), np.array(ROBOT.gravity))[0]
    assert np.abs(closed - wanted["wrench_N_Nm"]).max() < 1e-11
    simulated = Simulation(ROBOT, theta).wrench(q)[0]
    assert np.abs(simulated - wanted["wrench_N_Nm"]).max() < 1e-11
    p = ROBOT.values(theta)
    hand = kinematics.solved(p, q)
    left = hand.bars[0]
    for found, name in (
        (hand.e1, "E1_base_mm"),
        (hand.e2, "E2_base_mm"),
        (hand.origin, "T_wrist_base_mm"),
        (left.B, "B1_yz"),
        (left.D, "D1_yz"),
    ):
        assert np.abs(found[0] * 1e3 - wanted[name]).max() < 1e-9, name
    assert np.abs(hand.u[0] - wanted["u_base"]).max() < 1e-12


def test_rows_of_the_golden_infeasible_configuration_are_counted_with_their_reason():
    bad = joints_of(GOLDEN["infeasible_psi"])
    q = np.concatenate([np.tile(ROBOT.home, (3, 1)), bad, bad, ROBOT.home[None], bad])
    words = r"row 3: five-bar 1 cannot close: its elbows are 1100.2 mm.* \(3 such rows\)"
    with pytest.raises(PlanError, match=words):
        ROBOT.check(q, ROBOT.parameters.nominal, "plan")


def test_the_papers_workspace_is_reached_and_link_lengths_hold():
    p = ROBOT.values(ROBOT.parameters.nominal)
    rotation, position = inverse_kinematics.random_poses(40_000, np.random.default_rng(0))
    q = inverse_kinematics.joints(p, rotation, position)
    reached = np.isfinite(q).all(axis=1)
    assert reached.mean() > 0.998
    q = q[reached]
    found, at = ROBOT.tool_pose(q, ROBOT.parameters.nominal)
    assert np.abs(at - position[reached]).max() < 1e-13
    assert np.abs(found - rotation[reached]).max() < 1e-12
    for i in (1, 2):
        bar = kinematics.five_bar(p, i, q[:, 2 * i - 1], q[:, 2 * i])
        for a, b, link in ((bar.B, bar.E, f"L{i}2"), (bar.D, bar.E, f"L{i}4")):
            assert np.abs(np.linalg.norm(a - b, axis=1) / p[link] - 1).max() < 1e-14


@pytest.mark.parametrize("which", ["nominal", "actual"])
def test_rank_is_27_and_the_redundancies_have_names(which):
    model = wb.Model.of(ROBOT)
    theta = model.parameters.nominal
    theta[: len(PAPER)] = theta_of(which)[: len(PAPER)]
    q = ROBOT.sample(100, np.random.default_rng(0))
    jacobian = model.jacobian(q, theta, range(49)).reshape(-1, 49)
    found = Observability(
        jacobian, PAPER.names, PAPER.tolerance, ROBOT.symmetries(theta[: len(ROBOT.parameters)])
    )
    assert found.rank == 27
    assert len(found.no_effect) + len(found.redundancies) == 22
    told = " / ".join(r.sentence for r in found.redundancies)
    for words in (
        "d41 and d42 enter only as their sum",
        "xS and xG enter only as their difference",
        "yS and yG enter only as their difference",
        "zS and zG enter only as their difference",
        "common shift of all anchors along y",
        "common shift of all anchors along z",
        "overall scale",
        "rotation of all anchors about x0 against the base's tilt",
    ):
        assert words in told
    if which == "nominal":
        zero = "d5 xT yT zT alphaT betaT gammaT x0 y0 z0 alpha0 dq1 d31 d32".split()
        assert sorted(found.no_effect) == sorted(zero)
    for redundancy in found.redundancies:
        direction = np.zeros(49)
        direction[[PAPER.index(n) for n in redundancy.names]] = redundancy.direction
        size = np.linalg.norm(direction / PAPER.tolerance)
        assert np.linalg.norm(jacobian @ direction) < 1e-9 * np.linalg.norm(jacobian) * size


def closure(plant: ServoDrivenRobot) -> float:
    """Largest gap between the two sides of a loop now [m]."""
    mujoco.mj_kinematics(plant.model, plant.data)
    at = plant.data.site_xpos
    return max(float(np.linalg.norm(at[a] - at[b])) for a, b in loop_sites(plant.model))


def test_loops_stay_closed_at_rest_and_at_one_radian_a_second():
    theta = ROBOT.parameters.nominal
    plant = ServoDrivenRobot(Simulation(ROBOT, theta), ROBOT.home)
    target = ROBOT.home + np.array([0.0, 0.5, 0.4, 0.5, 0.4, -0.5])
    moving = fastest = 0.0
    steps = int(1.875 * 0.5 / 0.002)
    start = plant.q
    for share in minimum_jerk(np.arange(1, steps + 1) / steps):
        plant.advance(start + share * (target - start), 0.002)
        moving = max(moving, closure(plant))
        fastest = max(fastest, float(np.abs(plant.qd).max()))
    plant.settle(target)
    assert fastest > 0.95
    assert moving < 2e-6
    assert closure(plant) < 1e-7
