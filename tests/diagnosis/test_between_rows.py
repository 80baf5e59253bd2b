"""Causes that show only between rows, on look-alikes and from scatters whose numbers are stated."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import ndtr

import wrenchbed as wb
from altered import at_point, with_added, with_columns, with_rows, with_wrench, without_noise_stated
from wrenchbed import registry
from wrenchbed.benchmark.lookalikes import ExperimentDesign, draw, recording
from wrenchbed.data.plan import Plan
from wrenchbed.diagnosis.between_rows import row_effects as module
from wrenchbed.diagnosis.between_rows.row_effects import RowFinding, find_row_effects
from wrenchbed.diagnosis.prepare.configured_simulator import configured
from wrenchbed.diagnosis.prepare.quantisation_and_repeats import Repeats, Step, at_limits, step
from wrenchbed.diagnosis.result import cause
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.reports.claim import claim

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


ALL = (0, 1, 2, 3, 4, 5)
ONES = np.ones(6)


def scatter(variance=ONES, std=0.01, stated=True, scale=2.0, steady=True):
    """Scatter of known variance (6,) in units of its scale."""
    return SimpleNamespace(
        variance=lambda: (variance * ONES, std * ONES),
        scale=scale * ONES,
        stated=stated,
        rows=np.zeros((40, 6)),
        steady=lambda _: np.full(6, steady),
    )


def rising(mode="static", noise=None, n=10):
    """Readings that rise by 1 a row."""
    metadata = SimpleNamespace(mode=mode, sensor=SimpleNamespace(noise_std=noise))
    rows = np.arange(float(n))
    return SimpleNamespace(metadata=metadata, t=0.1 * rows, wrench=np.outer(rows, ONES))


def repeats(share, expected=0.0, std=0.005, channels=ALL, stale=None):
    stale = np.zeros(10, dtype=bool) if stale is None else stale
    return Repeats(stale, share, std, expected, 2.0, channels)


@pytest.fixture
def no_line(monkeypatch):
    monkeypatch.setattr(module, "line", lambda *_: None)


@pytest.mark.parametrize(("rise", "told"), [(0.44, False), (0.46, True)])
def test_a_coarse_count_is_told_from_a_rise_of_0_45(rise, told):
    steps = [Step(0.2, 0.001), None, None, Step(0.3, 0.002), None, None]
    counted = np.array([0.46, 0, 0, rise, 0, 0]) * 4.0
    found = module._coarse(steps, counted, 4.0 * ONES)
    assert found.effect == "sensor.quantization"
    assert found.channels == (("fx", "tx") if told else ("fx",))
    assert found.rise == pytest.approx(0.46)
    assert found.probability == pytest.approx(0.99 * ndtr(0.01 / 0.02))
    assert found.parameters["step.fx"] == {"value": 0.2, "std": 0.001, "unit": "N"}
    assert module._coarse(steps, counted * 0.9, 4.0 * ONES) is None


def test_repeats_are_told_from_a_share_of_three_hundredths_or_if_late_by_enough(monkeypatch):
    rec = rising()
    assert module._stale(rec, repeats(0.029), None) is None
    found = module._stale(rec, repeats(0.031), None)
    assert (found.effect, found.rise, found.channels) == ("timing.stale", 0.0, CHANNELS)
    assert found.probability == pytest.approx(0.99 * ndtr((0.031 - 0.015) / 0.005))
    assert found.parameters["share"]["value"] == 0.031
    assert "3.1 % of the rows repeat" in found.sentence and "2.0 in a run" in found.sentence
    assert module._stale(rec, repeats(0.05, expected=0.025), None) is None  # counts make half
    forces = module._stale(rec, repeats(0.05, channels=(0, 1, 2)), None)
    assert "rows of fx, fy, fz repeat" in forces.sentence
    for late, told in ((0.34, None), (0.36, 0.36)):
        monkeypatch.setattr(module, "_late", lambda *_, late=late: late)
        found = module._stale(rec, repeats(0.02), None)
        assert (found and found.rise) == told


def test_a_repeat_is_late_by_what_moved_meanwhile():
    """One row of ten shows the one before: late by 1."""
    rec, stale = rising("dynamic"), np.arange(10) == 4
    rec.wrench[4] = rec.wrench[3]
    some, s = repeats(0.1, stale=stale), scatter(0.3, scale=0.5)

    def expected(square):
        return pytest.approx((square / 10 - 2.0 / 3.0 * 0.25 * 0.3 * 0.1) / 0.25)

    assert module._late(rec, some, s) == expected(1.0)
    rec.wrench[:, 3] *= 2.0  # a channel that moves twice as fast
    assert module._late(rec, some, s) == expected(4.0)
    assert module._late(rec, repeats(0.1, stale=stale, channels=(0,)), s) == expected(1.0)
    assert module._late(rec, some, None) == module._late(rising("static"), some, s) == 0.0
    assert module._late(rec, repeats(0.0), s) == module._late(rec, some, scatter(90.0)) == 0.0


def test_noise_is_told_from_a_rise_of_0_35_that_nothing_else_explains(no_line):
    variance = np.array([1.6, 1.2, 1.0, 1.0, 1.36, 1.3])
    found = module._noise(scatter(variance), 0.0 * ONES)
    assert (found.effect, found.channels) == ("sensor.noise", ("fx", "ty"))
    assert found.rise == pytest.approx(0.6)
    slack = np.hypot(0.01, 0.05)
    assert found.probability == pytest.approx(0.995 * ndtr(0.25 / slack))
    told = found.parameters["std.fx"]
    assert told["value"] == pytest.approx(np.sqrt(0.6) * 2.0)
    assert told["std"] == pytest.approx(0.5 * slack * 4.0 / (np.sqrt(0.6) * 2.0))
    assert "a row of fx has 2.53 N instead of 2 N" in found.sentence
    said = claim(cause(found.effect, 1.0, found.parameters) | {"size": found.size}).sentence
    assert "row noise fx 2.53 ± 0.04 N instead of 2 N" in said
    assert module._noise(scatter(variance), np.array([0.4, 0, 0, 0, 0, 0])) is None  # 1.3 · 0.4
    assert module._noise(scatter(variance, steady=False), 0.0 * ONES) is None
    for rise, sure in ((0.38, False), (0.39, True)):  # Φ((rise − 0.35) / 0.05): 0.73 and 0.79
        assert (module._noise(scatter(1.0 + rise, std=0.0), 0.0 * ONES) is not None) == sure


def test_a_noisy_sensor_is_so_in_channels_too_whose_rise_does_not_count(no_line):
    s = scatter(np.array([2.0, 1.3, 1.0, 1.0, 1.0, 1.0]))
    s.means = lambda _: np.tile([2.2, 1.7, 1.0, 1.0, 1.0, 1.0], (12, 1))  # with tails
    found = module._noise(s, 0.0 * ONES)
    assert found.channels == ("fx",) and module.unexplained(s, [found]) == ""
    assert "rows of fy scatter" in module.unexplained(s, [replace(found, effect="other")])


def shaking(rise, seen=0.0, line=None):
    return SimpleNamespace(
        rise=np.array(rise, dtype=float), std=0.02 * ONES, seen=seen * ONES, line=line, rms=0.1,
        direction=(1.0, 0.0, 0.0),
    )  # fmt: skip


@pytest.mark.parametrize(("rise", "told"), [(0.46, False), (0.48, True), (0.9, True)])
def test_a_shaking_base_is_told_when_surely_above_0_45(rise, told):
    found = module._vibration(scatter(), shaking([0.1, rise, 0.46, 0.0, 0.0, 0.0]))
    assert (found is not None) == told
    if found is not None:
        slack = np.hypot(0.02, 0.05 * rise)
        assert found.probability == pytest.approx(0.995 * ndtr((rise - 0.45) / slack))
        assert found.channels == ("fy", "fz")
        assert found.rise == pytest.approx(rise)
        amplitude = found.parameters["amplitude.fy"]
        assert amplitude["value"] == pytest.approx(np.sqrt(2.0 * rise) * 2.0)
        assert amplitude["std"] == pytest.approx(0.02 * 4.0 / (np.sqrt(2.0 * rise) * 2.0))
        assert "frequency" not in found.parameters and "over a broad band" in found.sentence
        said = claim(cause(found.effect, 1.0, found.parameters) | {"size": found.size}).sentence
        assert "acceleration rms 0.1" in said and "amplitude" not in said


def test_a_line_has_a_frequency_and_without_a_stated_noise_the_rest_is_the_measure():
    tone, rise = SimpleNamespace(frequency=12.3, std=0.1), [0.4, 0, 0, 0, 0, 0]
    found = module._vibration(scatter(stated=False), shaking(rise, 0.5, tone))
    assert found.rise == pytest.approx(0.8)
    assert found.parameters["frequency"] == {"value": 12.3, "std": 0.1, "unit": "Hz"}
    assert "at 12.30 Hz" in found.sentence
    most = module._vibration(scatter(stated=False), shaking(rise, 2.0))
    assert most.rise == pytest.approx(0.4 / 0.05)
