"""Averages of a motion: their noise is what the data shows; what happens within one counts."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter
from test_between_rows import row_effects, shaken

import wrenchbed as wb
from altered import with_added, with_columns, with_wrench
from mutated import turning
from simulated import driven
from wrenchbed import registry
from wrenchbed.benchmark.lookalikes import ExperimentDesign, draw, recording
from wrenchbed.data.plan import Plan
from wrenchbed.diagnosis.between_rows.row_effects import RowFinding
from wrenchbed.diagnosis.diagnose import diagnose
from wrenchbed.diagnosis.gap import varies_with
from wrenchbed.diagnosis.gap.held_out import HeldOut
from wrenchbed.diagnosis.prepare.noise import noise_in_motion
from wrenchbed.diagnosis.prepare.prepare_recording import prepare
from wrenchbed.diagnosis.prepare.prepared import Prepared
from wrenchbed.diagnosis.result import named_by
from wrenchbed.effects.chain import ActiveEffect, respond
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.planning.choose import multisine

ROBOT = registry.load("robots", "ur5")
DESIGN = ExperimentDesign.of_plan(multisine(ROBOT, 60.0, 125.0, 11), ROBOT)
PERIOD, STRIDE, ROWS = 1.0 / 125.0, 12, 7488
T = PERIOD * np.arange(ROWS)


def averages(x):
    return STRIDE * x.reshape(-1, STRIDE, 6).mean(axis=1).var(axis=0)


def white(seed=0):
    return np.random.default_rng(seed).standard_normal((ROWS, 6))


def test_noise_is_measured_and_what_moves_slowly_or_jumps_is_none():
    kicks = np.random.default_rng(0).standard_normal((ROWS, 6))
    remembering = lfilter([0.8], [1.0, -0.6], kicks, axis=0)
    for x, near in ((white(), 0.1), (2.0 * white(1), 0.1), (remembering, 0.25)):
        row, mean = noise_in_motion(x, PERIOD, STRIDE)
        assert row == pytest.approx(x.var(axis=0), rel=near)
        assert mean == pytest.approx(averages(x), rel=0.4)
    # A gap of 0.7 Hz, reversals every 3 s and a jump.
    slow = 6.0 * np.sin(2 * np.pi * 0.7 * T) + 3.0 * (T > 31.0)
    back = 2.0 * np.sign(np.sin(2 * np.pi * T / 6.0))
    row, mean = noise_in_motion(white() + (slow + back)[:, None], PERIOD, STRIDE)
    assert row == pytest.approx(np.ones(6), rel=0.15)
    assert mean == pytest.approx(np.ones(6), rel=0.35)


@pytest.mark.parametrize("frequency", [7.3, 12.3, 31.0])
def test_a_line_counts_as_what_is_left_of_it_in_the_averages(frequency):
    line = np.outer(np.sin(2 * np.pi * frequency * T), np.ones(6))
    x = white() + 4.0 * line
    row, mean = noise_in_motion(x, PERIOD, STRIDE)
    assert row == pytest.approx(x.var(axis=0), rel=0.15)
    assert mean == pytest.approx(averages(x), rel=0.4)
    named = quiet().shaking(200.0 * quiet().sigma, frequency)
    assert named.noise == pytest.approx(1.0 + averages(200.0 * line), rel=0.02)
    assert quiet().shaking(200.0 * quiet().sigma, None).noise == pytest.approx(np.full(6, 20001.0))


@cache
def quiet():
    return prepare(recording(DESIGN, draw(DESIGN, 21, "none")))


@pytest.mark.sampled
@pytest.mark.parametrize("effect", ["sensor.noise", "base.vibration"])
def test_what_scatters_rows_raises_the_noise_not_the_gap(effect):
    loud = prepare(recording(DESIGN, draw(DESIGN, 21, "single", effect, 3.0)))
    assert (loud.noise >= 1.0).all() and (quiet().noise >= 1.0).all()
    assert loud.noise.max() > 1.3 * quiet().noise.max()
    assert HeldOut(loud).floor().mean() > 0.3 > abs(HeldOut(quiet()).floor().mean())


@pytest.mark.study  # half a minute
def test_a_base_that_shakes_and_a_zero_that_slips_for_half_a_second_are_both_named():
    """What shakes turns with the tool, so is not steady; no other rows tell when the zero slips."""
    rec = recording(DESIGN, draw(DESIGN, 21, "none"))
    loud = shaken(rec, 0.14, 33.0)
    added = (((loud.wrench - rec.wrench) / rec.metadata.sensor.noise_std) ** 2).mean()
    slip = np.clip((rec.t - rec.t[0] - 30.0) / 0.5, 0.0, 1.0)
    told = diagnose(with_added(loud, np.outer(slip, 0.5 * np.eye(6)[1]))).diagnosis
    assert [w["effect"] for w in told.which] == ["sensor.jump", "base.vibration"]
    assert told.gap.floor == pytest.approx(added, rel=0.15) and told.gap.left < 0.3
    assert min(w["probability"] for w in told.which) > 0.9 and added > 2.0


def test_the_floor_of_noise_with_memory_is_not_below_it():
    """A look-alike late by 8 ms whose noise has memory."""
    case = draw(DESIGN, 3, "single", "timing.delay")
    assert abs(HeldOut(prepare(recording(DESIGN, case))).floor().mean()) < 0.12


def test_rows_that_repeat_take_no_part():
    rec = recording(DESIGN, draw(DESIGN, 22, "none"))
    stale = np.random.default_rng(1).random(len(rec)) < 0.02
    for k in np.flatnonzero(stale):
        stale[k : k + 7] = True
    kept = np.maximum.accumulate(np.where(stale, 0, np.arange(len(rec))))
    late = with_wrench(rec, rec.wrench[kept])
    whole, held = prepare(rec), prepare(late)
    again = held.count == 0
    assert again.mean() == pytest.approx(stale.mean(), abs=0.005)
    off = ((held.y - whole.y) / whole.sigma)[again]
    raw = (late.columns["fx"] - rec.columns["fx"])[stale]
    assert np.sqrt(np.mean(off**2)) < 2.0
    assert np.sqrt(np.mean(raw**2)) / whole.sigma[0] > 2.0 * np.sqrt(np.mean(off[:, 0] ** 2))
    assert HeldOut(held).count.sum() == np.count_nonzero(~again & held.judged)
    for name in ("fx", "tz"):
        clipped = np.minimum(rec.columns[name], np.quantile(rec.columns[name], 0.95))
        found = row_effects(with_columns(rec, {name: clipped}))
        assert "timing.stale" not in {f.effect for f in found}


def test_what_shows_between_rows_says_so_and_becomes_part_of_the_twin():
    (entry,) = varies_with.entries((), (), [("base.vibration", "fx, tx", 0.68, 1e-3)])
    assert entry["subsystem"] == "base" and entry["share"] == 0.68
    assert "of the gap" not in entry["sentence"]
    assert "68 % of a row's variance" in entry["sentence"]
    stale = varies_with.entries((), (), [("timing.stale", "fx", 0.0, 1e-3)])[0]["sentence"]
    assert stale == "timing.stale acts on single rows of fx, not on their means."
    told = {"std.fx": {"value": 0.2, "std": 0.01, "unit": "N"}}
    noisy = RowFinding("sensor.noise", 0.99, 4.0, ("fx",), told, "fx scatters.")
    active = noisy.active(ROBOT)
    rows = active.effect.corrupt(
        np.zeros((4000, 6)), T[:4000], active.values, np.random.default_rng(0)
    )
    assert rows.std(axis=0) == pytest.approx([0.2, 0, 0, 0, 0, 0], abs=0.01)
    share = {"share": {"value": 0.1, "std": 0.01, "unit": "1"}}
    some = RowFinding("timing.stale", 0.99, 0.0, CHANNELS[3:], share, "Torques repeat.")
    assert some.active(ROBOT) is None and replace(some, channels=CHANNELS).active(ROBOT)


RATE = 125.0


def jerky(seconds: float, jerks: int, seed: int) -> Plan:
    """A multisine with fast small swings in it, as a stream of targets that was held up has."""
    smooth = wb.multisine(wb.load("robots", "ur5"), seconds, RATE, seed=seed)
    rng = np.random.default_rng(seed)
    q, age = np.array(smooth.q), np.arange(len(smooth)) / RATE
    for at in rng.uniform(2.0, seconds - 2.0, jerks):
        q += 6e-4 * rng.standard_normal(6) * np.exp(-0.5 * ((age[:, None] - at) / 0.03) ** 2)
    return Plan.of("ur5", q, rate_hz=RATE)


def recorded(folder: Path, jerks: int) -> wb.Recording:
    """Recorded in MuJoCo, its readings 30 ms late."""
    plan, late = jerky(30.0, jerks, seed=3), ("timing.delay:delay=0.03",)
    return driven(plan, folder / "rec.parquet", seed=3, effects=late)


@pytest.fixture(scope="module")
def late(tmp_path_factory) -> wb.Recording:
    return recorded(tmp_path_factory.mktemp("late"), 8)


def added(prepared: Prepared, effect: str, **values: float) -> np.ndarray:
    """What an effect adds to the rows of the analysis (R, 6)."""
    active = [ActiveEffect.of(prepared.model.robot, effect, values)]
    return prepared.rows(respond(prepared.scene, active) - respond(prepared.scene))


@pytest.mark.parametrize(
    ("effect", "values"),
    [
        ("timing.delay", {"delay": 0.03}),
        ("timing.lowpass", {"tau": 0.03}),
        ("timing.skew", {"channel": 0.03}),
        ("sensor.hysteresis", {"middle.fz": 0.02, "middle.tx": 0.02}),
        ("tool.mass", {"mass": 0.1}),
    ],
)
def test_an_effect_acts_on_pieces_as_on_the_rows(late, effect, values):
    whole = prepare(late)
    pieces = whole.coarse
    assert len(pieces.y) < len(whole.y) / 1.9
    wanted, found = added(whole, effect, **values), added(pieces, effect, **values)
    assert found.shape == wanted.shape
    assert np.sqrt(np.mean((found - wanted) ** 2)) < 0.03 * np.sqrt(np.mean(wanted**2))


@pytest.mark.slow
def test_a_delay_is_told_from_a_filter_in_a_motion_that_jerks(tmp_path):
    told = diagnose(recorded(tmp_path, 60)).diagnosis
    assert told.which[0]["effect"] == "timing.delay"
    assert told.which[0]["probability"] > 0.8
    assert "timing.lowpass" not in named_by(told.which[0])
    assert told.which[0]["parameters"]["delay"]["value"] == pytest.approx(0.03, abs=1e-3)


def turned(lag, seconds, noise=1.0):
    """A tool that is turned about; the wrench is as old as the lag [s] says."""
    return turning(np.random.default_rng(4), seconds, 100.0, lag, noise)


@pytest.mark.parametrize("lag", [0.04, 0.1])
def test_late_averages_of_a_motion_are_those_of_a_late_wrench(lag):
    prepared = prepare(turned(0.0, 20.0, 0.0))
    late = ActiveEffect.of(registry.load("robots", "oriented"), "timing.delay", {"delay": lag})
    change = respond(prepared.scene, [late]) - respond(prepared.scene)
    measured = prepare(turned(lag, 20.0, 0.0)).y - prepared.y
    inside = slice(5, -5)  # before the first row nothing is known
    off = np.sqrt(np.mean((change - measured)[inside] ** 2, axis=0))
    assert (off < 0.05 * np.sqrt(np.mean(measured[inside] ** 2, axis=0))).all()
