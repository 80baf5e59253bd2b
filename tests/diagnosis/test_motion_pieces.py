"""A motion that jerks: what happens within an average counts, above all for delays and filters."""

from pathlib import Path

import numpy as np
import pytest

import wrenchbed as wb
from mutated import turning
from wrenchbed import registry
from wrenchbed.data.plan import Plan
from wrenchbed.diagnosis.diagnose import diagnose
from wrenchbed.diagnosis.gap.result import named_by
from wrenchbed.diagnosis.prepare.prepare_recording import prepare
from wrenchbed.diagnosis.prepare.prepared import Prepared
from wrenchbed.effects.chain import ActiveEffect, respond

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
    options = wb.SimOptions("ur5", effects=("timing.delay:delay=0.03",), seed=3)
    with wb.SimDriver(options) as driver:
        wb.record(driver, jerky(30.0, jerks, seed=3), folder / "rec.parquet")
    return wb.Recording.read(folder / "rec.parquet")


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


def test_stretches_and_averages_begin_at_the_same_rows(late):
    whole = prepare(late)
    begins = np.flatnonzero(np.diff(whole.block)) + 1
    assert len(begins) == 23
    assert not (begins % whole.stride).any()
    assert np.array_equal(whole.coarse.block_rows, whole.block_rows)


@pytest.mark.slow
def test_a_delay_is_told_from_a_filter_in_a_motion_that_jerks(tmp_path):
    told = diagnose(recorded(tmp_path, 60)).diagnosis
    assert told.which[0]["effect"] == "timing.delay"
    assert told.which[0]["probability"] > 0.8
    assert "timing.lowpass" not in named_by(told.which[0])
    assert told.which[0]["parameters"]["delay"]["value"] == pytest.approx(0.03, abs=1e-3)


# ---- a sensor that reads late on a robot of which only its orientation is recorded ---------------


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
