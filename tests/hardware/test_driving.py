"""Campaigns run through the simulated driver: what is recorded, refused and calibrated."""

import json
from pathlib import Path

import numpy as np
import pytest

from wrenchbed import registry
from wrenchbed.calibration.calibrate import calibrate
from wrenchbed.campaigns import run as recording_run
from wrenchbed.data.plan import Plan
from wrenchbed.data.recording import Recording
from wrenchbed.errors import (
    CalibrationError,
    NotFoundError,
    ParameterError,
    PlanError,
    WrenchbedWarning,
)
from wrenchbed.hardware.drivers import sim
from wrenchbed.hardware.drivers.base import Driver
from wrenchbed.physics.taylor_jets import Jet
from wrenchbed.physics.wrench import wrench
from wrenchbed.planning import choose
from wrenchbed.sensors.base import STATUS_SATURATED
from wrenchbed.simulation.closed_form import Model

MODELS = Path(__file__).parents[2] / "models"
TABLE1 = json.loads((MODELS / "medrue" / "table1.json").read_text())
EXAMPLE = json.loads((MODELS / "ur5" / "example.json").read_text())


def sim_driver(robot: str, **options) -> Driver:
    return sim.SimDriver(sim.SimOptions(robot, **options))


def test_what_does_not_exist_is_refused_by_name():
    for error, words, robot, options in (
        (NotFoundError, "no robot 'ur6'", "ur6", {}),
        (NotFoundError, "'oriented' has no MuJoCo model", "oriented", {}),
        (ParameterError, "no parameter 'L99'", "medrue", {"parameters": {"L99": 1.0}}),
        (ParameterError, "no noise 'loud'", "ur5", {"noise": "loud"}),
    ):
        with pytest.raises(error, match=words):
            sim_driver(robot, **options)


@pytest.mark.parametrize(("robot", "truth"), [("ur5", EXAMPLE), ("medrue", TABLE1)])
def test_a_noise_free_campaign_reads_the_true_robots_wrench(tmp_path, robot, truth):
    with sim_driver(robot, parameters=truth, noise="off") as driver:
        plan = choose.poses(driver.robot, 5, seed=2)
        recording_run.record(driver, plan, tmp_path / "rec.parquet", samples=3)
    rec = Recording.read(tmp_path / "rec.parquet")
    assert len(rec) == 15
    assert list(rec.columns["segment"]) == [0] * 3 + [1] * 3 + [2] * 3 + [3] * 3 + [4] * 3
    assert np.abs(rec.q - np.repeat(plan.q, 3, axis=0)).max() < 2e-12
    model = Model.of(registry.load("robots", robot))
    wanted = model.predict(plan.q, model.parameters.vector(truth))
    assert np.abs(rec.wrench[::3] - wanted).max() < 1e-10
    stated = rec.metadata
    assert stated.source == "sim"
    assert stated.sensor.noise_std == (0.0,) * 6
    assert stated.sensor.mass == model.robot.values(model.robot.parameters.nominal)["sensor.mass"]
    assert stated.sensor.pose_flange == ((0, 0, 0, 1, 0, 0, 0) if robot == "ur5" else None)
    nominal = model.robot.tool(model.robot.parameters.nominal)
    assert stated.tool.mass == float(nominal.mass)  # the truth does not leak into the metadata
    assert stated.gravity == model.robot.gravity


@pytest.mark.parametrize("robot", ["ur5", "medrue"])
def test_the_wrench_in_a_motion_is_that_of_its_own_kinematics(tmp_path, robot):
    """Servo dynamics in MuJoCo against Newton–Euler on the measured joints' derivatives."""
    with sim_driver(robot, noise="off") as driver:
        plan = choose.multisine(driver.robot, 8.0, 500.0, seed=5)
        recording_run.record(driver, plan, tmp_path / "rec.parquet")
    rec = Recording.read(tmp_path / "rec.parquet")
    arm = registry.load("robots", robot)
    theta = arm.parameters.nominal
    speed = np.stack([rec.columns[f"qd{j}"] for j in range(1, 7)], axis=-1)
    acceleration = np.gradient(speed, rec.t, axis=0, edge_order=2)
    g = np.array(arm.gravity)
    moving = wrench(*arm.sensor_pose(Jet(rec.q, speed, acceleration), theta), arm.tool(theta), g)
    at_rest = wrench(*arm.sensor_pose(rec.q, theta), arm.tool(theta), g)
    inner = slice(50, -50)
    rms = np.sqrt(((rec.wrench - moving)[inner, :3] ** 2).mean())
    inertial = np.sqrt(((rec.wrench - at_rest)[inner, :3] ** 2).mean())
    assert inertial > 0.05
    assert rms < 0.05 * inertial
    assert rms < 0.018  # what stepping MuJoCo at 0.1 ms instead of 2 ms changes


def motion(tmp_path, rate: float, seconds: float, seed: int, noise: str) -> Recording:
    with sim_driver("ur5", parameters=EXAMPLE, noise=noise, seed=seed) as driver:
        plan = choose.multisine(driver.robot, seconds, rate, seed=seed)
        recording_run.record(driver, plan, tmp_path / "rec.parquet")
    return Recording.read(tmp_path / "rec.parquet")


def with_encoder_noise(rec: Recording, std: float) -> Recording:
    rng = np.random.default_rng(0)
    noisy = {
        f"q{j}": rec.columns[f"q{j}"] + std * rng.standard_normal(len(rec)) for j in range(1, 7)
    }
    return Recording(rec.metadata, dict(rec.columns) | noisy)


@pytest.mark.sampled
@pytest.mark.parametrize("rate", [125.0, 500.0])
def test_encoder_noise_in_motion_is_smoothed_or_refused(tmp_path, rate):
    rec = motion(tmp_path, rate, 12.0, 3, "white")
    for std in (2e-6, 2e-4) if rate > 125.0 else (2e-6,):  # a wider window at the high rate
        fit = calibrate(with_encoder_noise(rec, std))
        for name in ("tool.mass", "tool.cog.z", "sensor.bias.fz", "mount.rotation.z"):
            assert abs(fit[name].value - EXAMPLE[name]) < 4.5 * fit[name].std, name
    with pytest.raises(CalibrationError, match=r"q\d is rough .* calibrate at rest"):
        calibrate(with_encoder_noise(rec, 2e-4 if rate == 125.0 else 2e-3))


def test_a_motion_is_played_at_its_own_rate_by_its_own_robot(tmp_path):
    with sim_driver("ur5") as driver:
        plan = choose.multisine(driver.robot, 6.0, 125.0, seed=0)
        with pytest.raises(PlanError, match="sampled at 125 Hz, not 250"):
            recording_run.record(driver, plan, tmp_path / "rec.parquet", rate=250.0)
        with pytest.raises(PlanError, match="for robot 'medrue', not 'ur5'"):
            recording_run.record(driver, Plan.of("medrue", plan.q), tmp_path / "rec.parquet")


def test_an_overloaded_sensor_saturates_and_says_so(tmp_path):
    with sim_driver("ur5", parameters={"sensor.bias.fz": 195.0}) as driver:
        plan = choose.poses(driver.robot, 8, seed=0)
        recording_run.record(driver, plan, tmp_path / "rec.parquet", samples=2)
    rec = Recording.read(tmp_path / "rec.parquet")
    full = registry.load("sensors", "ati-gamma").calibration().range[2]
    over = rec.columns["fz"] >= full
    assert over.any()
    assert not over.all()
    assert np.array_equal((rec.columns["status"] & STATUS_SATURATED) == 4, over)


def test_dwell_sets_the_rows_of_a_pose(tmp_path):
    with sim_driver("ur5") as driver:
        q = driver.robot.sample(2, np.random.default_rng(0))
        plan = Plan("ur5", q, np.array([7, 9]), np.array([0.25, 0.0]))
        steps, out = [], tmp_path / "rec.parquet"
        done = recording_run.record(
            driver, plan, out, samples=10, rate=200.0, progress=steps.append
        )
    assert (done.visited, done.rows, steps) == (2, 60, [1, 1])
    segment = Recording.read(out).columns["segment"]
    assert list(np.unique(segment, return_counts=True)[1]) == [50, 10]


def test_an_effect_that_cannot_show_in_the_plan_says_so():
    with sim_driver("ur5", effects=("timing.delay",)) as driver:
        plan = driver.robot.sample(3, np.random.default_rng(0))
        with pytest.warns(WrenchbedWarning, match=r"timing\.delay does not show in a static plan"):
            driver.expect(plan, "static")
