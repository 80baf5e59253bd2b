"""Recordings on which other diagnoses were sure and wrong: right here, or unknown.

Each is made in MuJoCo, its fault by formulas that the library lacks.
"""

from dataclasses import replace

import numpy as np
import pytest

import consistent
from simulated import WHITE, recording, static
from wrenchbed import registry
from wrenchbed.campaigns.recording.run import record
from wrenchbed.data.metadata import ToolInfo
from wrenchbed.data.recording import Recording
from wrenchbed.diagnosis.diagnose import diagnose
from wrenchbed.hardware.drivers.sim import SimDriver, SimOptions
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.planning import choose
from wrenchbed.simulation.closed_form import Model
from wrenchbed.simulation.simulation import Simulation

LOAD = {"tool.mass": 1.374, "tool.cog.x": 0.0031, "tool.cog.y": -0.0042, "tool.cog.z": 0.0712}
COG = tuple(LOAD[f"tool.cog.{k}"] for k in "xyz")


def stated(rec, mass=LOAD["tool.mass"], cog=COG):
    return replace(rec, metadata=replace(rec.metadata, tool=ToolInfo(mass, cog)))


def changed(rec, **channels):
    return replace(rec, columns=dict(rec.columns) | channels)


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
    told = answer(changed(stated(rec), **bent))
    assert told.verdict != "none"
    sure = [w for w in told.which if w["probability"] > 0.9]
    assert len(sure) <= 1
    for w in sure:
        assert told.gap.closed.low > 0.0
        assert {w["effect"], *w["rivals"]} & {"sensor.nonlinearity", "sensor.gain"}


@pytest.mark.sampled
@pytest.mark.parametrize("level", [0.01, 0.02, 0.03])
def test_a_small_gap_names_nothing_whatever_the_stated_noise(level):
    """Single rows, so that only the statement tells the noise; a real noise of 0.02 of it."""
    noise = 0.4 * WHITE
    rec = static("ur5", LOAD, poses=60, samples=1, noise=noise, seed=5)
    lag = 0.6 * noise[2] * np.sin(rec.t / 17.0)
    rec = changed(stated(rec), fz=rec.columns["fz"] + lag)
    sensor = replace(rec.metadata.sensor, noise_std=tuple(level / 0.02 * noise))
    told = answer(replace(rec, metadata=replace(rec.metadata, sensor=sensor)))
    if told.gap.calibrated.value < 0.5:
        assert told.which == []
    else:
        assert level == 0.01


@pytest.mark.sampled
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
    rec = recording("ur5", q, Model.of(arm).read(load, theta), 30, WHITE, 0.0,
                    np.random.default_rng(seed))  # fmt: skip
    told = answer(stated(rec))
    assert {w["effect"] for w in told.which} == {"tool.mass", "base.tilt"}


@pytest.mark.slow
def test_bursts_of_zero_mean_in_a_motion_are_not_none(tmp_path):
    plan = choose.multisine(registry.load("robots", "ur5"), 30.0, 125.0, seed=3)
    path = tmp_path / "motion.parquet"
    with SimDriver(SimOptions("ur5", noise="white", seed=3)) as driver:
        record(driver, plan, path)
    rec = Recording.read(path)
    assert answer(rec).verdict == "none"
    noise = np.array(rec.metadata.sensor.noise_std)
    kicks = np.zeros((len(rec.t), 6))
    for begin in np.linspace(2.0, 27.0, 6):
        rows = np.flatnonzero((rec.t >= begin) & (rec.t < begin + 0.3))
        kicks[rows] = 5.0 * noise * np.where(np.arange(len(rows)) % 2, 1.0, -1.0)[:, None]
    torn = {c: rec.columns[c] + kicks[:, k] for k, c in enumerate(CHANNELS)}
    told = answer(changed(rec, **torn))
    assert told.verdict != "none"
    assert not [w for w in told.which if w["effect"] != "sensor.noise"]


def test_a_healthy_robot_whose_tool_is_stated_in_round_numbers_is_none():
    rec = static("ur5", LOAD, poses=60, samples=30, noise=WHITE)
    told = answer(stated(rec, 1.4, (0.0, 0.0, 0.07)))
    assert (told.verdict, told.which) == ("none", [])


def test_rivals_without_a_stated_tool_have_a_next_experiment():
    rec = static("ur5", LOAD, poses=40, samples=30, noise=WHITE, seed=2)
    drifting = {c: rec.columns[c] + 8.0 * WHITE[k] * rec.t / rec.t[-1]
                for k, c in enumerate(CHANNELS[:3])}  # fmt: skip
    rec = changed(rec, **drifting)
    told = answer(replace(rec, metadata=replace(rec.metadata, tool=ToolInfo())))
    assert told.verdict in ("identified", "ambiguous")
    if told.verdict == "ambiguous":
        assert told.next
    assert "sensor.drift" in {n for w in told.which for n in (w["effect"], *w["rivals"])}
