"""Causes that show only between rows are found, and nothing is claimed on ordinary noise."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchbed import registry
from wrenchbed.benchmark.lookalikes import ExperimentDesign, draw, recording
from wrenchbed.data.metadata import Metadata, SensorInfo, ToolInfo
from wrenchbed.diagnosis.between_rows.row_effects import find_row_effects
from wrenchbed.diagnosis.prepare.configuration import configured
from wrenchbed.physics.wrench import CHANNELS

ROBOT = registry.load("robots", "ur5")
STD = np.array(registry.load("sensors", "ati-gamma").noise.row_std)
TOOL = ROBOT.tool(ROBOT.parameters.nominal)
EFFECTS = ("sensor.noise", "sensor.quantization", "base.vibration", "timing.stale")


def row_effects(rows):
    """Effects between rows, on the robot that a recording names."""
    return find_row_effects(rows, configured(rows))


def metadata(mode, rate):
    tool = ToolInfo(float(TOOL.mass), tuple(map(float, TOOL.cog)), (0.002, 0.002, 0.001, 0, 0, 0))
    sensor = SensorInfo("ati-gamma", tuple(map(float, STD)), 0.0, (0, 0, 0, 1.0, 0, 0, 0))
    return Metadata("ur5", mode, "sim", rate, tool, sensor, {}, tuple(ROBOT.gravity))


def static():
    q = ROBOT.sample(80, np.random.default_rng(3))
    t = np.arange(80) * 3.0 + 0.3
    return ExperimentDesign(ROBOT, "static", q, t, 60, 100.0, metadata("static", 100.0), STD, None)


def dynamic():
    rng = np.random.default_rng(4)
    t = np.arange(7500) / 125.0
    q = np.tile([0.0, -1.2, 1.2, -1.5, -1.5, 0.0], (len(t), 1))
    for j in range(6):
        for f in (0.05, 0.1, 0.15, 0.25):
            size = (0.4 if j in (1, 2) else 1.0) * rng.uniform(0.1, 0.4)
            q[:, j] += size * np.sin(2 * np.pi * f * t + rng.uniform(0, 6.28))
    return ExperimentDesign(ROBOT, "dynamic", q, t, 1, 125.0, metadata("dynamic", 125.0), STD, None)


DESIGNS = {"static": static(), "dynamic": dynamic()}


def quiet(mode, seed=40):
    """Look-alike rows with nothing wrong."""
    return recording(DESIGNS[mode], draw(DESIGNS[mode], seed, "none"))


def changed(rec, wrench):
    return replace(rec, columns=dict(rec.columns) | dict(zip(CHANNELS, wrench.T, strict=True)))


def unstated(rec):
    meta = rec.metadata
    return replace(rec, metadata=replace(meta, sensor=replace(meta.sensor, noise_std=None)))


def named(findings):
    return {f.effect for f in findings}


def shaken(rec, acceleration, frequency):
    """The tool's inertia on the sensor, from an acceleration of the base along x [m/s²]."""
    rotation = np.asarray(ROBOT.sensor_pose(rec.q, ROBOT.parameters.nominal)[0])
    wave = acceleration * np.sin(2 * np.pi * frequency * rec.t + 0.3)
    force = float(TOOL.mass) * wave[:, None] * rotation[:, 0, :]
    torque = np.cross(np.asarray(TOOL.cog), force)
    return changed(rec, rec.wrench + np.hstack([force, torque]))


@pytest.mark.sampled
@pytest.mark.parametrize("mode", DESIGNS)
@pytest.mark.parametrize("kind", ["none", "single"])
def test_nothing_is_claimed_without_a_cause_between_rows(mode, kind):
    for seed in range(40, 60) if mode == "static" else range(52, 60):
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
    assert 0.2 < told["amplitude.fx"]["value"] / (float(TOOL.mass) * 0.06) < 1.1


def test_a_mains_line_is_noise_not_a_shaking_base():
    rec = quiet("static")
    wrench = np.array(rec.wrench)
    wrench[:, 2] += 2.0 * STD[2] * np.sin(2 * np.pi * 31.0 * rec.t)
    (found,) = row_effects(changed(rec, wrench))
    assert found.effect == "sensor.noise" and found.channels == ("fz",)
    assert "electrical" in found.sentence and " Hz" in found.sentence


@pytest.mark.parametrize("mode", DESIGNS)
def test_added_noise_is_measured(mode):
    rec = quiet(mode)
    extra = 1.2 * STD * np.random.default_rng(0).standard_normal(rec.wrench.shape)
    (found,) = row_effects(changed(rec, rec.wrench + extra))
    assert found.effect == "sensor.noise" and found.channels == CHANNELS
    for c, s in zip(CHANNELS, STD, strict=True):
        assert found.parameters[f"std.{c}"]["value"] == pytest.approx(1.2 * s, rel=0.15)


@pytest.mark.parametrize("mode", DESIGNS)
def test_a_coarse_count_is_measured_even_when_printed_with_few_digits(mode):
    rec = quiet(mode)
    step = 4.0 * STD[0]
    wrench = np.array(rec.wrench)
    wrench[:, 0] = np.round(step * np.round(wrench[:, 0] / step), 3)
    (found,) = row_effects(changed(rec, wrench))
    assert found.effect == "sensor.quantization" and found.channels == ("fx",)
    told = found.parameters["step.fx"]
    assert told["value"] == pytest.approx(step, abs=max(3 * told["std"], 1e-5))
    assert named(row_effects(unstated(changed(rec, wrench)))) == {"sensor.quantization"}


def test_a_clipped_channel_or_a_fine_count_is_no_coarse_one():
    rec = quiet("static")
    wrench = np.round(rec.wrench, 6)
    wrench[:, 1] = np.clip(wrench[:, 1], -8.0, 3.0)
    assert row_effects(changed(rec, wrench)) == ()


@pytest.mark.parametrize("mode", DESIGNS)
def test_repeated_rows_are_counted(mode):
    rec = quiet(mode)
    stale = np.random.default_rng(1).random(len(rec)) < 0.1
    kept = np.maximum.accumulate(np.where(stale, 0, np.arange(len(rec))))
    (found,) = row_effects(changed(rec, rec.wrench[kept]))
    assert found.effect == "timing.stale" and found.channels == CHANNELS
    told = found.parameters["share"]
    assert told["value"] == pytest.approx(0.1, abs=4 * told["std"] + 0.005)


def test_repeats_of_one_device_channel():
    rec = quiet("static")
    noise = 1e-3 * STD * np.random.default_rng(2).standard_normal(rec.wrench.shape)
    wrench = rec.wrench + noise
    stale = np.random.default_rng(1).random(len(rec)) < 0.2
    kept = np.maximum.accumulate(np.where(stale, 0, np.arange(len(rec))))
    wrench[:, 3:] = wrench[kept, 3:]
    (found,) = row_effects(changed(rec, wrench))
    assert found.effect == "timing.stale" and found.channels == CHANNELS[3:]


def test_noise_and_a_shaking_base_together():
    rec = shaken(quiet("static"), 0.06, 12.0)
    wrench = np.array(rec.wrench)
    wrench[:, 5] += 2.0 * STD[5] * np.random.default_rng(5).standard_normal(len(rec))
    assert named(row_effects(changed(rec, wrench))) == {"sensor.noise", "base.vibration"}


def test_without_a_stated_noise_only_its_pattern_can_be_judged():
    rec = quiet("static")
    noisy = rec.wrench + 3.0 * STD * np.random.default_rng(0).standard_normal(rec.wrench.shape)
    assert row_effects(unstated(changed(rec, noisy))) == ()
    assert named(row_effects(unstated(shaken(rec, 0.08, 12.0)))) == {"base.vibration"}


def test_single_rows_a_pose_say_nothing():
    rec = quiet("static")
    thin = replace(rec, columns={k: v[::60] for k, v in rec.columns.items()})
    assert row_effects(thin) == ()
