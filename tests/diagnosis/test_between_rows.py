"""Causes that show only between rows are found, and nothing is claimed on ordinary noise."""

from functools import cache

import numpy as np
import pytest

from altered import at_point, with_added, with_columns, with_rows, with_wrench, without_noise_stated
from wrenchbed import registry
from wrenchbed.benchmark.lookalikes import ExperimentDesign, draw, recording
from wrenchbed.data.plan import Plan
from wrenchbed.diagnosis.between_rows.row_effects import find_row_effects
from wrenchbed.diagnosis.prepare.configuration import configured
from wrenchbed.physics.wrench import CHANNELS

ROBOT, MEDRUE = (registry.load("robots", name) for name in ("ur5", "medrue"))
STD = np.array(registry.load("sensors", "ati-gamma").noise.row_std)
EFFECTS = ("sensor.noise", "sensor.quantization", "base.vibration", "timing.stale")


def row_effects(rows):
    """Effects between rows, on the robot that a recording names."""
    return find_row_effects(rows, configured(rows))


def static(robot=ROBOT, poses=80, seed=3):
    plan = Plan.of(robot.name, robot.sample(poses, np.random.default_rng(seed)))
    return ExperimentDesign.of_plan(plan, robot, samples=60)


def dynamic():
    """Half a minute of a slow multisine."""
    rng = np.random.default_rng(4)
    t = np.arange(3750) / 125.0
    q = np.tile([0.0, -1.2, 1.2, -1.5, -1.5, 0.0], (len(t), 1))
    for j in range(6):
        for f in (0.05, 0.1, 0.15, 0.25):
            size = (0.4 if j in (1, 2) else 1.0) * rng.uniform(0.1, 0.4)
            q[:, j] += size * np.sin(2 * np.pi * f * t + rng.uniform(0, 6.28))
    return ExperimentDesign.of_plan(Plan.of("ur5", q, rate_hz=125.0), ROBOT)


DESIGNS = {"static": static(), "dynamic": dynamic()}


def quiet(mode, seed=40):
    """Look-alike rows with nothing wrong."""
    return recording(DESIGNS[mode], draw(DESIGNS[mode], seed, "none"))


def named(findings):
    return {f.effect for f in findings}


def shaken(rec, acceleration, frequency, robot=ROBOT):
    """The tool's inertia on the sensor, from an acceleration of the base along x [m/s²]."""
    theta = robot.parameters.nominal
    rotation, tool = np.asarray(robot.sensor_pose(rec.q, theta)[0]), robot.tool(theta)
    wave = acceleration * np.sin(2 * np.pi * frequency * rec.t + 0.3)
    force = float(tool.mass) * wave[:, None] * rotation[:, 0, :]
    return with_added(rec, at_point(force, np.asarray(tool.cog)))


def noise(rec, seed=0):
    return STD * np.random.default_rng(seed).standard_normal((len(rec), 6))


def stale_rows(rec, share):
    """The row that each row shows (N,), of a robot that repeats some."""
    stale = np.random.default_rng(1).random(len(rec)) < share
    return np.maximum.accumulate(np.where(stale, 0, np.arange(len(rec))))


@pytest.mark.sampled
@pytest.mark.parametrize("mode", DESIGNS)
@pytest.mark.parametrize("kind", ["none", "single"])
def test_nothing_is_claimed_without_a_cause_between_rows(mode, kind):
    for seed in range(40, 48) if mode == "static" else range(52, 56):
        case = draw(DESIGNS[mode], seed, kind)
        if not set(case.causes) & set(EFFECTS):
            assert row_effects(recording(DESIGNS[mode], case)) == (), (seed, case.causes)


@pytest.mark.sampled
@pytest.mark.parametrize("mode", DESIGNS)
@pytest.mark.parametrize("effect", EFFECTS)
def test_each_cause_is_found(mode, effect):
    if (mode, effect) == ("static", "timing.stale"):
        pytest.skip("look-alikes show stale rows in motion only")
    design = DESIGNS[mode]
    for seed in range(60, 64):
        found = row_effects(recording(design, draw(design, seed, "single", effect)))
        assert found and found[0].effect == effect, seed
        assert found[0].rise > 0.3
        assert found[0].sentence.endswith(".")


@pytest.mark.parametrize("mode", DESIGNS)
def test_frequency_and_amplitude_of_a_shaking_base(mode):
    found = {f.effect: f for f in row_effects(shaken(quiet(mode), 0.06, 17.3))}
    assert set(found) == {"base.vibration"}
    told = found["base.vibration"].parameters
    assert told["frequency"]["value"] == pytest.approx(17.3, abs=0.1)
    assert told["frequency"]["std"] < 0.1
    mass = float(ROBOT.tool(ROBOT.parameters.nominal).mass)
    assert 0.2 < told["amplitude.fx"]["value"] / (mass * 0.06) < 1.1


def test_a_mains_line_is_noise_not_a_shaking_base():
    rec = quiet("static")
    line = 2.0 * STD * np.eye(6)[2] * np.sin(2 * np.pi * 31.0 * rec.t)[:, None]
    (found,) = row_effects(with_added(rec, line))
    assert found.effect == "sensor.noise" and found.channels == ("fz",)
    assert "electrical" in found.sentence and " Hz" in found.sentence


@pytest.mark.parametrize("mode", DESIGNS)
def test_added_noise_is_measured(mode):
    rec = quiet(mode)
    (found,) = row_effects(with_added(rec, 1.2 * noise(rec)))
    assert found.effect == "sensor.noise" and found.channels == CHANNELS
    for c, s in zip(CHANNELS, STD, strict=True):
        assert found.parameters[f"std.{c}"]["value"] == pytest.approx(1.2 * s, rel=0.15)


@pytest.mark.parametrize("mode", DESIGNS)
def test_a_coarse_count_is_measured_even_when_printed_with_few_digits(mode):
    rec, step = quiet(mode), 4.0 * STD[0]
    coarse = with_columns(rec, {"fx": np.round(step * np.round(rec.columns["fx"] / step), 3)})
    (found,) = row_effects(coarse)
    assert found.effect == "sensor.quantization" and found.channels == ("fx",)
    told = found.parameters["step.fx"]
    assert told["value"] == pytest.approx(step, abs=max(3 * told["std"], 1e-5))
    assert named(row_effects(without_noise_stated(coarse))) == {"sensor.quantization"}


def test_a_clipped_channel_or_a_fine_count_is_no_coarse_one():
    wrench = np.round(quiet("static").wrench, 6)
    wrench[:, 1] = np.clip(wrench[:, 1], -8.0, 3.0)
    assert row_effects(with_wrench(quiet("static"), wrench)) == ()


@pytest.mark.parametrize("mode", DESIGNS)
def test_repeated_rows_are_counted(mode):
    rec = quiet(mode)
    (found,) = row_effects(with_wrench(rec, rec.wrench[stale_rows(rec, 0.1)]))
    assert found.effect == "timing.stale" and found.channels == CHANNELS
    told = found.parameters["share"]
    assert told["value"] == pytest.approx(0.1, abs=4 * told["std"] + 0.005)


def test_repeats_of_one_device_channel():
    rec = quiet("static")
    wrench = rec.wrench + 1e-3 * noise(rec, 2)
    wrench[:, 3:] = wrench[stale_rows(rec, 0.2), 3:]
    (found,) = row_effects(with_wrench(rec, wrench))
    assert found.effect == "timing.stale" and found.channels == CHANNELS[3:]


def test_noise_and_a_shaking_base_together():
    rec = shaken(quiet("static"), 0.06, 12.0)
    noisy = with_added(rec, 2.0 * noise(rec, 5) * np.eye(6)[5])
    assert named(row_effects(noisy)) == {"sensor.noise", "base.vibration"}


def test_without_a_stated_noise_only_its_pattern_can_be_judged():
    rec = quiet("static")
    assert row_effects(without_noise_stated(with_added(rec, 3.0 * noise(rec)))) == ()
    assert named(row_effects(without_noise_stated(shaken(rec, 0.08, 12.0)))) == {"base.vibration"}


def test_single_rows_a_pose_say_nothing():
    assert row_effects(with_rows(quiet("static"), slice(None, None, 60))) == ()


# ---- a robot whose torques are quieter than its forces are ---------------------------------------


@cache
def medrue():
    return static(MEDRUE, 70, 5)


def test_a_shaking_is_no_noise_however_strong():
    """Its own products must not count as noise that hides how the poses differ."""
    for seed in range(3):
        case = draw(medrue(), seed, "single", "base.vibration", 12.0)
        assert case.rows["base.vibration"] > 50.0
        (found,) = row_effects(recording(medrue(), case))
        assert found.effect == "base.vibration", seed
        assert found.rise == pytest.approx(case.rows["base.vibration"], rel=0.25)
    rec = recording(medrue(), draw(medrue(), 7, "none"))
    shaking = shaken(rec, 1.0, 14.0, MEDRUE).wrench - rec.wrench
    fraction = (shaking.std(axis=0) / medrue().noise_std) ** 2
    faint = with_added(rec, shaking * np.sqrt(0.4 / fraction.max()))  # does not count
    assert "sensor.noise" not in named(row_effects(faint))
