"""Causes that show only between rows, on look-alikes and from scatters whose numbers are stated."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

import wrenchbed as wb
from altered import at_point, with_added, with_columns, with_rows, with_wrench, without_noise_stated
from wrenchbed import registry
from wrenchbed.benchmark.lookalikes import ExperimentDesign, draw, recording
from wrenchbed.data.plan import Plan
from wrenchbed.diagnosis.between_rows import row_effects as module
from wrenchbed.diagnosis.between_rows.row_effects import RowFinding, find_row_effects
from wrenchbed.diagnosis.prepare.configured_simulator import configured
from wrenchbed.diagnosis.prepare.quantisation_and_repeats import Step, at_limits, step
from wrenchbed.diagnosis.result import cause
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.reports.claim import Claim

ROBOT, MEDRUE = (registry.load("robots", name) for name in ("ur5", "medrue"))
STD = np.array(registry.load("sensors", "ati-gamma").noise.row_std)
EFFECTS = ("sensor.noise", "sensor.quantization", "base.vibration", "timing.stale")


@pytest.mark.parametrize("words", ["no measurements of it", "those of the move before"])
def test_rows_that_are_no_repeats_of_their_pose_are_no_vibration(words):
    rng = np.random.default_rng(5)
    design = ExperimentDesign.of_plan(Plan.of("ur5", ROBOT.sample(50, rng)), ROBOT, samples=20)
    sound = recording(design, draw(design, 3, "none"))
    late = np.roll(sound.wrench, 1, axis=0)
    lost = sound.wrench * (rng.random(len(sound)) > 0.05)[:, None]
    d = wb.diagnose(with_wrench(sound, lost if words.startswith("no") else late)).diagnosis
    assert (d.verdict, list(d.which), list(d.between)) == ("unknown", [], [])
    assert any(words in note for note in d.notes)


def test_a_limit_is_where_readings_pile_up_at_an_end():
    """Coarse counts come back everywhere, rows that are sent again too, and noise nowhere."""
    y = np.random.default_rng(2).standard_normal((400, 6))
    y[:, 1] = np.clip(y[:, 1], -1.8, 1.5)
    y[:, 2] = np.minimum(y[:, 2], 2.0)
    y[:, 3] = 0.5 * np.round(y[:, 3] / 0.5)
    y[1::2, 4] = y[::2, 4]
    at = at_limits(y)
    assert at.any(axis=0).tolist() == [False, True, True, False, False, False]
    assert at[:, 1].tolist() == np.isin(y[:, 1], (-1.8, 1.5)).tolist()
    assert np.count_nonzero(at[:, 2]) == np.count_nonzero(y[:, 2] == 2.0) < 20


@pytest.mark.parametrize("seed", range(6))
def test_a_count_shows_in_72_readings_of_276_counts(seed):
    """One row a pose: hardly two that follow each other are a few counts apart."""
    y = 0.0027 * np.round(np.random.default_rng(seed).uniform(-138.0, 138.0, 72))
    assert step(y) == Step(pytest.approx(0.0027), pytest.approx(0.0, abs=1e-9))
    assert step(np.random.default_rng(seed).uniform(-0.4, 0.4, 72)) is None


def row_effects(rows):
    """Effects between rows, on the robot that a recording names."""
    return find_row_effects(rows, configured(rows))[0]


def static(robot=ROBOT, poses=80, seed=3):
    return ExperimentDesign.of_plan(wb.poses(robot, poses, seed), robot, samples=60)


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
def test_a_shaking_base_coarse_counts_and_repeated_rows_are_measured(mode):
    found = {f.effect: f for f in row_effects(shaken(quiet(mode), 0.06, 17.3))}
    assert set(found) == {"base.vibration"}
    told = found["base.vibration"].parameters
    assert told["frequency"]["value"] == pytest.approx(17.3, abs=0.1)
    assert told["frequency"]["std"] < 0.1
    mass = float(ROBOT.tool(ROBOT.parameters.nominal).mass)
    assert 0.2 < told["amplitude.fx"]["value"] / (mass * 0.06) < 1.1
    rec, step = quiet(mode), 4.0 * STD[0]
    coarse = with_columns(rec, {"fx": np.round(step * np.round(rec.columns["fx"] / step), 3)})
    (found,) = row_effects(coarse)  # printed with few digits
    assert found.effect == "sensor.quantization" and found.channels == ("fx",)
    told = found.parameters["step.fx"]
    assert told["value"] == pytest.approx(step, abs=max(3 * told["std"], 1e-5))
    assert named(row_effects(without_noise_stated(coarse))) == {"sensor.quantization"}
    (found,) = row_effects(with_wrench(rec, rec.wrench[stale_rows(rec, 0.1)]))
    assert found.effect == "timing.stale" and found.channels == CHANNELS
    told = found.parameters["share"]
    assert told["value"] == pytest.approx(0.1, abs=4 * told["std"] + 0.005)


def test_a_mains_line_is_noise_and_repeats_are_of_one_device():
    rec = quiet("static")
    line = 2.0 * STD * np.eye(6)[2] * np.sin(2 * np.pi * 31.0 * rec.t)[:, None]
    (found,) = row_effects(with_added(rec, line))
    assert found.effect == "sensor.noise" and found.channels == ("fz",)
    assert "electrical" in found.sentence and " Hz" in found.sentence
    wrench = rec.wrench + 1e-3 * noise(rec, 2)
    wrench[:, 3:] = wrench[stale_rows(rec, 0.2), 3:]
    (found,) = row_effects(with_wrench(rec, wrench))
    assert found.effect == "timing.stale" and found.channels == CHANNELS[3:]


@pytest.mark.parametrize("rows", [5, 20])
def test_counts_of_many_noises_repeat_rows_by_chance(rows):
    rec = with_rows(quiet("static"), np.arange(len(quiet("static"))) % 60 < rows)
    coarse = 8.0 * STD * np.round(rec.wrench / (8.0 * STD))
    assert named(row_effects(with_wrench(rec, coarse))) == {"sensor.quantization"}


@pytest.mark.parametrize("noises", [4.0, 12.0, 25.0])
def test_coarse_counts_of_a_motion_are_neither_repeats_nor_a_shaking(noises):
    rec, step = quiet("dynamic"), noises * STD
    coarse = with_wrench(rec, step * np.round(rec.wrench / step))
    assert named(row_effects(coarse)) == {"sensor.quantization"}


def test_clipped_fine_or_single_rows_are_no_finding():
    wrench = np.round(quiet("static").wrench, 6)
    wrench[:, 1] = np.clip(wrench[:, 1], -8.0, 3.0)
    assert row_effects(with_wrench(quiet("static"), wrench)) == ()
    assert row_effects(with_rows(quiet("static"), slice(None, None, 60))) == ()
    assert RowFinding("timing.stale", 0.9, 0.1, ("fx",), {}, "").active(None) is None
    assert module.find_row_effects([1, 2], None) == ((), None)


def test_noise_beside_shaking_and_without_a_statement():
    rec = shaken(quiet("static"), 0.06, 12.0)
    noisy = with_added(rec, 2.0 * noise(rec, 5) * np.eye(6)[5])
    assert named(row_effects(noisy)) == {"sensor.noise", "base.vibration"}
    rec = quiet("static")
    assert row_effects(without_noise_stated(with_added(rec, 3.0 * noise(rec)))) == ()
    assert named(row_effects(without_noise_stated(shaken(rec, 0.08, 12.0)))) == {"base.vibration"}


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


def noisier(rec, rise):
    return with_added(rec, np.sqrt(rise) * noise(rec, 5) * np.eye(6)[4])


def counted(rec, rise):
    size = np.sqrt(12.0 * rise) * STD[0]
    return with_columns(rec, {"fx": size * np.round(rec.columns["fx"] / size)})


def repeating(rec, share):
    return with_wrench(rec, rec.wrench[stale_rows(rec, share)])


def harder(rec, rise):
    """Shaken so that the largest rise of a channel is this much."""
    once = np.square(shaken(rec, 1.0, 17.3).wrench - rec.wrench).mean(axis=0) / STD**2
    return shaken(rec, np.sqrt(rise / once.max()), 17.3)


def said_of(finding):
    entry = cause(finding.effect, finding.probability, finding.parameters)
    return Claim(entry | {"size": finding.size}).sentence()


@pytest.mark.parametrize(
    ("effect", "make", "too_little", "enough", "told"),
    [
        ("sensor.noise", noisier, 0.28, 0.5, "a row of ty has"),
        ("sensor.quantization", counted, 0.43, 0.47, "in coarse steps of fx"),
        ("timing.stale", repeating, 0.02, 0.05, "% of the rows repeat exactly"),
        ("base.vibration", harder, 0.36, 0.6, "shakes at 17.3"),
    ],
)
def test_a_cause_counts_from_somewhat_less_than_half_of_a_rows_variance(
    effect, make, too_little, enough, told
):
    assert row_effects(make(quiet("static"), too_little)) == ()
    (found,) = row_effects(make(quiet("static"), enough))
    assert found.effect == effect and found.probability > 0.75 and told in found.sentence
    assert found.rise == pytest.approx(0.0 if effect == "timing.stale" else enough, rel=0.15)


def test_noise_and_shaking_are_said_in_numbers_that_people_know():
    (found,) = row_effects(noisier(quiet("static"), 0.5))
    std, row = found.parameters["std.ty"], found.size["row_noise.ty"]
    assert std["value"] == pytest.approx(np.sqrt(0.5) * STD[4], abs=3.0 * std["std"])
    assert row["value"] == pytest.approx(np.sqrt(1.5) * STD[4], rel=0.05)
    assert row["stated"] == STD[4] and "row noise ty" in said_of(found)
    hard = harder(quiet("static"), 0.6)
    for rec in (hard, without_noise_stated(hard)):
        (found,) = row_effects(rec)
        assert found.rise == pytest.approx(0.6, rel=0.15)
    amplitude = found.parameters["amplitude.tx"]
    assert amplitude["value"] == pytest.approx(np.sqrt(1.2) * STD[3], abs=3.0 * amplitude["std"])
    assert amplitude["std"] < 0.05 * amplitude["value"]
    assert "acceleration rms" in said_of(found) and "amplitude" not in said_of(found)


@pytest.mark.parametrize("device", [slice(0, 6), slice(0, 3)])
def test_a_repeat_is_late_by_what_moved_meanwhile(device):
    """And told though few repeat, where much moved."""
    rec, last = quiet("dynamic"), stale_rows(quiet("dynamic"), 0.3)
    wrench = rec.wrench + 1e-3 * noise(rec, 2)
    wrench[:, device] = wrench[last, device]
    late = np.square((rec.wrench - wrench) / STD).mean(axis=0)
    (found,) = row_effects(with_wrench(rec, wrench))
    noise_of_two = 2.0 * np.mean(last != np.arange(len(last)))
    assert found.channels == CHANNELS[device]
    assert found.rise == pytest.approx(late.max() - noise_of_two, rel=0.1)
    fast = with_added(rec, np.outer(np.sin(3.0 * rec.t), 180.0 * STD))
    assert named(row_effects(repeating(fast, 0.027))) == {"timing.stale"}


def test_a_noisy_sensor_is_so_in_channels_too_whose_rise_does_not_count():
    rows = np.random.default_rng(3).standard_normal((600, 6)) * np.sqrt([2.2, 1.7, 1, 1, 1, 1])
    s = SimpleNamespace(
        stated=True, rows=rows, variance=lambda: (np.array([2.0, 1.3, 1, 1, 1, 1]), None),
        means=lambda x: x.reshape(12, 50, 6).mean(axis=1),
    )  # fmt: skip
    found = RowFinding("sensor.noise", 0.9, 1.0, ("fx",), {}, "")
    assert module.unexplained(s, [found]) == ""
    assert "rows of fy scatter" in module.unexplained(s, [replace(found, effect="other")])
