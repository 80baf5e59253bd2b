"""A motion that jerks: what happens within an average counts, above all for delays and filters."""

from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation

import wrenchbed as wb
from wrenchbed import registry
from wrenchbed.data.metadata import Metadata, SensorInfo, ToolInfo
from wrenchbed.data.plan import Plan
from wrenchbed.data.recording import Recording
from wrenchbed.diagnosis.diagnose import diagnose
from wrenchbed.diagnosis.prepare.prepare_recording import prepare
from wrenchbed.diagnosis.prepare.prepared import Prepared
from wrenchbed.effects.chain import ActiveEffect, respond
from wrenchbed.physics.wrench import CHANNELS

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
    assert "timing.lowpass" not in told.which[0]["rivals"]
    assert told.which[0]["parameters"]["delay"]["value"] == pytest.approx(0.03, abs=1e-3)


# ---- a sensor that reads late on a robot of which only its orientation is recorded ---------------

MASS, COG = 1.2, np.array([0.004, -0.006, 0.07])
INERTIA = np.diag([1.5e-3, 1.5e-3, 8e-4])
NOISE = np.array([0.05, 0.05, 0.05, 2e-3, 2e-3, 2e-3])
STEP = 1e-3
"""Of the simulation [s]."""


def turned(lag, seconds=60.0, rate=100.0, noise=NOISE):
    """A rigid tool turned about the sensor's origin; the wrench is as old as the lag [s] says."""
    rng, t = np.random.default_rng(0), np.arange(-1.0, seconds + 1.0, STEP)
    hertz, size = rng.uniform(0.03, 0.1, (3, 4)), rng.uniform(0.3, 0.9, (3, 4))
    phase = rng.uniform(0.0, 6.28, (3, 4))
    waves = size * np.sin(2.0 * np.pi * hertz * t[:, None, None] + phase)
    turn = Rotation.from_euler("xyz", waves.sum(axis=2))
    spin = np.zeros((len(t), 3))
    spin[1:-1] = (turn[:-2].inv() * turn[2:]).as_rotvec() / (2.0 * STEP)
    spin[[0, -1]] = spin[[1, -2]]
    rate_of_spin = np.gradient(spin, STEP, axis=0)
    centre = np.cross(rate_of_spin, COG) + np.cross(spin, np.cross(spin, COG))
    force = MASS * (turn.inv().apply([0.0, 0.0, -9.80665]) - centre)
    couple = rate_of_spin @ INERTIA + np.cross(spin, spin @ INERTIA)
    wrench = np.concatenate([force, np.cross(COG, force) - couple], axis=1)
    now = np.arange(0.0, seconds, 1.0 / rate)
    y = make_interp_spline(t, wrench, k=3)(now - lag) + noise * rng.standard_normal((len(now), 6))
    q = turn[np.round((now - t[0]) / STEP).astype(int)].as_quat(scalar_first=True)
    columns = {"t": now} | dict(zip(("qw", "qx", "qy", "qz"), q.T, strict=True))
    columns |= dict(zip(CHANNELS, y.T, strict=True))
    tool = ToolInfo(MASS, tuple(COG), (1.5e-3, 1.5e-3, 8e-4, 0.0, 0.0, 0.0))
    sensor = SensorInfo(noise_std=tuple(NOISE))
    return Recording(
        Metadata("oriented", "dynamic", "recorded", rate, tool, sensor), columns, "turn"
    )


@pytest.mark.parametrize("lag", [0.04, 0.1])
def test_late_averages_of_a_motion_are_those_of_a_late_wrench(lag):
    prepared = prepare(turned(0.0, 20.0, noise=0.0 * NOISE))
    late = ActiveEffect.of(registry.load("robots", "oriented"), "timing.delay", {"delay": lag})
    change = respond(prepared.scene, [late]) - respond(prepared.scene)
    measured = prepare(turned(lag, 20.0, noise=0.0 * NOISE)).y - prepared.y
    inside = slice(5, -5)  # before the first row nothing is known
    off = np.sqrt(np.mean((change - measured)[inside] ** 2, axis=0))
    assert (off < 0.05 * np.sqrt(np.mean(measured[inside] ** 2, axis=0))).all()


@pytest.mark.slow
def test_a_lag_of_40_ms_is_a_delay_or_a_filter():
    found = diagnose(turned(0.04, 30.0)).diagnosis
    (lead,) = found.which
    names = {lead["effect"], *lead["rivals"]}
    assert "timing.delay" in names and names <= {"timing.delay", "timing.lowpass", "timing.skew"}
    assert lead["probability"] > 0.8
    time = lead["parameters"].get("delay") or lead["parameters"]["tau"]
    assert time["value"] == pytest.approx(0.04, abs=4.0 * time["std"])
    assert time["value"] == pytest.approx(0.04, rel=0.25)
