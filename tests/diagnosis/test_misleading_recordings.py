"""Recordings on which other diagnoses were sure and wrong: right here, or unknown."""

from dataclasses import replace

import numpy as np
import pytest

import consistent
import wrenchbed as wb
from altered import with_added, with_columns, with_metadata, with_wrench
from simulated import UR5_TRUTH, WHITE, driven, recording, static, with_tool
from wrenchbed import registry
from wrenchbed.data.metadata import ToolInfo
from wrenchbed.diagnosis.diagnose import diagnose
from wrenchbed.diagnosis.result import named_by
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.planning import choose
from wrenchbed.simulation.closed_form import Model
from wrenchbed.simulation.mujoco_wrench import Simulation

LOAD = {"tool.mass": 1.374, "tool.cog.x": 0.0031, "tool.cog.y": -0.0042, "tool.cog.z": 0.0712}
POSES, ROWS = 60, 20
"""Of a tool that changes."""


def stated(rec):
    return with_tool(rec, *LOAD.values())


def answer(rec):
    """The diagnosis, of which no two statements contradict."""
    found = diagnose(rec)
    assert consistent.violations(found) == []
    return found.diagnosis


@pytest.mark.sampled
@pytest.mark.parametrize("seed", range(3))
def test_twelve_poses_of_a_sensor_that_bends_are_no_three_causes(seed):
    rec = static("ur5", LOAD, poses=12, samples=30, noise=WHITE, seed=seed)
    bent = {
        c: y + 0.004 * y * np.abs(y) + 1e-4 * y**3
        for c, y in ((c, rec.columns[c]) for c in CHANNELS[:3])
    }
    told = answer(with_columns(stated(rec), bent))
    assert told.verdict != "none"
    sure = [w for w in told.which if w["probability"] > 0.9]
    assert len(sure) <= 1
    for w in sure:
        assert told.gap.closed.low > 0.0
        assert set(named_by(w)) & {"sensor.nonlinearity", "sensor.gain"}


@pytest.mark.slow
@pytest.mark.parametrize("level", [0.01, 0.02, 0.03])
def test_a_small_gap_names_nothing_whatever_the_stated_noise(level):
    """Single rows, so that only the statement tells the noise; a real noise of 0.02 of it."""
    noise = 0.4 * WHITE
    rec = static("ur5", LOAD, poses=60, samples=1, noise=noise, seed=5)
    lag = 0.6 * noise[2] * np.sin(rec.t / 17.0)
    rec = with_columns(stated(rec), {"fz": rec.columns["fz"] + lag})
    sensor = replace(rec.metadata.sensor, noise_std=tuple(level / 0.02 * noise))
    told = answer(with_metadata(rec, sensor=sensor))
    if told.gap.calibrated.value < 0.5:
        assert told.which == []
    else:
        assert level == 0.01


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_what_flows_after_gravity_is_no_part_that_slides(seed):
    """A liquid that follows in 25 s, thicker where it is deep; poses are 2.2 s apart."""
    rec = stated(static("ur5", LOAD, poses=POSES, samples=ROWS, noise=WHITE, seed=seed))
    force, flow, before = rec.wrench[:, :3], np.zeros(3), 0.0
    shift = np.zeros_like(force)
    for k, (t, f) in enumerate(zip(rec.t, force, strict=True)):
        target = 8e-3 * f / np.linalg.norm(f)
        flow = flow + (target - flow) * -np.expm1((before - t) / (25.0 + 1e3 * flow[2]))
        before, shift[k] = t, flow
    change = np.concatenate([np.zeros_like(force), np.cross(shift, force)], axis=1)
    told = answer(with_added(rec, change))
    assert told.gap.calibrated.value > 2.0
    assert [w for w in told.which if w["probability"] > 0.9] == []


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_a_wrong_mass_on_a_tilted_base_is_no_cable(seed):
    arm = registry.load("robots", "ur5")
    truth = LOAD | {"tool.mass": 1.45}
    plain = static("ur5", truth, poses=60, samples=30, noise=WHITE, seed=seed)
    q = plain.q[::30]
    theta = Model.of(arm).parameters.vector(truth)
    tilted = 9.80665 * np.array([np.sin(0.0122), np.sin(-0.007), 0.0])
    tilted[2] = -np.sqrt(9.80665**2 - tilted @ tilted)
    load = Simulation(arm, theta[: len(arm.parameters)], tilted).wrench(q)
    read, rng = Model.of(arm).read(load, theta), np.random.default_rng(seed)
    rec = recording("ur5", q, read, 30, WHITE, 0.0, rng)
    told = answer(stated(rec))
    numbers = {w["effect"]: w["parameters"] for w in told.which}
    assert numbers.keys() == {"tool.mass", "base.tilt"}
    assert numbers["tool.mass"]["mass"]["stated"] == pytest.approx(stated(rec).metadata.tool.mass)


@pytest.mark.slow
def test_bursts_of_zero_mean_in_a_motion_are_not_none(tmp_path):
    plan = choose.multisine(registry.load("robots", "ur5"), 30.0, 125.0, seed=3)
    rec = driven(plan, tmp_path / "motion.parquet", noise="white", seed=3)
    assert answer(rec).verdict == "none"
    noise = np.array(rec.metadata.sensor.noise_std)
    kicks = np.zeros((len(rec.t), 6))
    for begin in np.linspace(2.0, 27.0, 6):
        rows = np.flatnonzero((rec.t >= begin) & (rec.t < begin + 0.3))
        kicks[rows] = 5.0 * noise * np.where(np.arange(len(rows)) % 2, 1.0, -1.0)[:, None]
    told = answer(with_added(rec, kicks))
    assert told.verdict != "none"
    assert not [w for w in told.which if w["effect"] != "sensor.noise"]


def test_a_healthy_robot_whose_tool_is_stated_in_round_numbers_is_none():
    rec = static("ur5", LOAD, poses=60, samples=30, noise=WHITE)
    told = answer(with_tool(rec, 1.4, 0.0, 0.0, 0.07))
    assert (told.verdict, told.which, list(told.outliers)) == ("none", [], [])


def test_rivals_without_a_stated_tool_have_a_next_experiment():
    rec = static("ur5", LOAD, poses=40, samples=30, noise=WHITE, seed=2)
    drift = -8.0 * WHITE * [1, 1, 1, 0, 0, 0] * (rec.t / rec.t[-1])[:, None]
    told = answer(with_metadata(with_added(rec, drift), tool=ToolInfo()))
    assert told.verdict in ("identified", "ambiguous")
    if told.verdict == "ambiguous":
        assert told.next
    (cause,) = (w for w in told.which if "sensor.drift" in named_by(w))
    sizes = [x for x in {**cause["size"], **cause["parameters"]}.values() if "over" in x]
    assert sizes and all(x["value"] < 0.0 < x["over"] <= rec.t[-1] for x in sizes)


def recorded(name, mass):
    """60 poses at rest; the mass of each is the stated one times this (60,)."""
    robot, rng = registry.load("robots", name), np.random.default_rng(4)
    q, theta = robot.sample(POSES, rng), robot.parameters.nominal
    tool = robot.tool(theta)
    load = np.empty((POSES, 6))
    for i in range(POSES):
        by_now = robot.theta_of_tool(theta, mass[i] * tool.mass, tool.cog.tolist())
        load[i] = Simulation(robot, by_now).wrench(q[i : i + 1])[0]
    return with_tool(recording(name, q, load, ROWS, WHITE / 2.0, 0.0, rng), tool.mass, *tool.cog)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ur5", "medrue"])
def test_a_payload_that_leaks_3_percent_steadily_is_a_leak(name):
    rec = recorded(name, 1.0 - 0.03 * np.linspace(0.0, 1.0, POSES))
    found = diagnose(rec).diagnosis
    lead = found.which[0]
    assert lead["effect"] == "tool.leak" and lead["probability"] > 0.8
    assert "sensor.temperature" not in found.probabilities
    robot = registry.load("robots", name)
    stated = 0.03 * float(robot.tool(robot.parameters.nominal).mass) / np.ptp(rec.t)
    rate = lead["parameters"]["rate"]
    assert rate["value"] == pytest.approx(stated, abs=4.0 * rate["std"])
    assert rate["value"] == pytest.approx(stated, rel=0.2)


HOLDS, EACH = 40, 10
"""Of a sensor that slips or is zeroed: poses, and rows in each."""
STEP = np.array([1.0, 1.0, 1.0, 0.05, 0.05, 0.05])
"""Standard deviation of a slip of the zero [N, N·m]."""


def of_holds(seed):
    truth = {k: v for k, v in UR5_TRUTH.items() if k.startswith("tool")}
    rec = static("ur5", truth, poses=HOLDS, samples=EACH, noise=WHITE, seed=seed)
    return with_tool(rec, *truth.values())


def slipped(rec, row, rng):
    """The recording with a slip of the zero from a row on, and the step (6,)."""
    step = np.where(rng.random(6) < 0.5, -1.0, 1.0) * rng.uniform(0.6, 1.4, 6) * STEP
    return with_added(rec, np.outer(np.arange(len(rec)) >= row, step)), step


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(10))
def test_a_sensor_that_was_zeroed_twice_jumps_twice(seed):
    rec, rows = of_holds(seed), [13 * EACH, 27 * EACH]
    wrench = rec.wrench.copy()
    for k in rows:
        wrench[k:] -= wrench[k]
    answer = wb.diagnose(with_wrench(rec, wrench)).diagnosis.to_json()
    (cause,) = answer["which"]
    assert cause["effect"] == "sensor.jump" and cause["probability"] > 0.9
    found = [cause["parameters"][name]["value"] for name in ("time", "time2")]
    between = rec.t[EACH] - rec.t[EACH - 1]
    for at, value in zip(rec.t[rows], found, strict=True):
        assert at - between <= value <= at
    stds = [cause["parameters"][name]["std"] for name in ("time", "time2")]
    assert min(stds) > between / 12.0**0.5
    assert answer["gap"]["with_effects"] < 0.5


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(10))
def test_three_slips_are_no_drift(seed):
    rec, rng = of_holds(seed), np.random.default_rng(seed)
    for k in np.sort(rng.choice(np.arange(6, HOLDS - 5, 5), 3, replace=False)):
        rec, _ = slipped(rec, k * EACH, rng)
    answer = wb.diagnose(rec).diagnosis.to_json()
    assert [w["effect"] for w in answer["which"]] == ["sensor.jump"]
    assert "time3" in answer["which"][0]["parameters"]


@pytest.mark.sampled
@pytest.mark.parametrize("seed", range(4))
def test_a_slip_in_the_middle_of_a_pose_is_one(seed):
    """The pose's mean has a part of the step: nothing jumps twice."""
    rng = np.random.default_rng(seed)
    row = int(rng.integers(8, HOLDS - 8)) * EACH + int(rng.integers(3, EACH - 3))
    rec, step = slipped(of_holds(seed), row, rng)
    (cause,) = wb.diagnose(rec).diagnosis.to_json()["which"]
    found = cause["parameters"]
    assert cause["effect"] == "sensor.jump" and cause["probability"] > 0.9
    assert "time2" not in found
    assert abs(found["part"]["value"] - 1.0 + row % EACH / EACH) < 0.1
    assert abs(found["time"]["value"] - rec.t[row]) < 2.0 * (rec.t[EACH] - rec.t[0])
    for k, c in enumerate(CHANNELS):
        error = found[f"step.{c}"]["value"] - step[k]
        assert abs(error) < max(4.0 * found[f"step.{c}"]["std"], 0.01 * STEP[k])
