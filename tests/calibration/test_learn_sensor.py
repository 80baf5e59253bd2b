"""A sensor's noise is learnt from a rest; data are drawn by other code than `NoiseStream`."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import wrenchbed as wb
from altered import by_name
from recorded import METADATA
from rest_noise import WHITE, Rest, recorded
from wrenchbed.cli import main
from wrenchbed.data.metadata import Metadata, SensorInfo
from wrenchbed.data.recording import QUATERNION, Recording
from wrenchbed.errors import CalibrationError, NotFoundError
from wrenchbed.physics.wrench import CHANNELS

NTNU = Path(__file__).parents[1] / "data" / "ntnu_kuka_ati_gamma" / "0-steady-state_wrench.csv"
COLOURED = Rest(flicker=(0.1, 0.2, 0.05, 0.4, 0.3, 0.1))
CORRELATED = np.eye(6)
CORRELATED[[0, 4], [4, 0]], CORRELATED[[1, 3], [3, 1]] = 0.9, -0.8
RESTS = {
    "mains": replace(COLOURED, hum=0.3),
    "mains of 60 Hz": replace(COLOURED, hum=0.3, hum_hz=59.9),
    "coloured": COLOURED,
    "white": Rest(),
    "steps": replace(COLOURED, step=1.0),
    "correlated": replace(COLOURED, flicker=(0.1,) * 6, correlation=CORRELATED),
    "drifting": replace(COLOURED, drift=3.0, flicker=(0.05, 0.02, 0.05, 0.02, 0.0, 0.02)),
}


def learnt(rest, first, count=3):
    """What is learnt of a rest with each of some seeds."""
    return [wb.learn_sensor(rest.recording(first + k)) for k in range(count)]


@pytest.mark.sampled
@pytest.mark.parametrize("name", RESTS)
def test_what_is_learnt_lies_within_its_intervals(name):
    """5 sigmas never; the mean square of a normal number is 1 ± 0.33 for 18 of them, four times."""
    rest, z = RESTS[name], []
    for found in learnt(rest, 100, 12 if name == "coloured" else 3):
        noise = found.sensor.noise
        for s, w, f in zip(found.rest.spectra, WHITE, rest.flicker, strict=True):
            z.append([(s.white - w) / s.white_std, (s.flicker - f * w) / s.flicker_std])
            most = 0.1 if rest.drift else 2.0 * f or 0.03  # no drift is 1/f noise
            assert s.flicker < most * w
        off = found.rest.drift - rest.drift * WHITE / 60.0
        assert np.abs(off / found.rest.drift_std).max() < 5.0
        sure = noise.warmup_drift != 0.0
        assert sure.sum() >= 5 if rest.drift else not sure.any()
        slope = noise.warmup_drift[sure] / noise.warmup_time
        assert slope == pytest.approx(found.rest.drift[sure])
        off = np.abs(noise.correlation - rest.correlation).max()
        assert found.rest.correlation_std < 0.02 and off < 5.0 * found.rest.correlation_std
        np.testing.assert_allclose(noise.resolution, rest.step * WHITE, rtol=1e-5)
        if rest.hum:
            assert noise.mains_frequency == pytest.approx(rest.hum_hz, abs=0.01)
            error = (noise.mains_amplitude - rest.hum * WHITE) / found.rest.mains_std
            assert np.abs(error).max() < 4.5
        else:
            assert not noise.mains_amplitude.any()
        assert not found.rest.lines
        if rest.step:  # its rounding is taken off, in part
            np.testing.assert_allclose(noise.white, WHITE, rtol=0.06)
    z = np.array(z)[:, : 2 if name == "coloured" else 1]
    square = np.mean(z**2, axis=0)
    sound = np.abs(z).max() < 5.0 and (square > 0.2).all() and (square < 2.3).all()
    assert sound or rest.step, np.round(z, 1)


@pytest.fixture(scope="module")
def ntnu() -> Recording:
    rows = np.loadtxt(NTNU, delimiter=",", skiprows=1)
    n = len(rows)
    columns = {"t": np.arange(n) / 698.1} | by_name(CHANNELS, rows)
    columns |= by_name(QUATERNION, np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)))
    return Recording(Metadata("kuka", "static", sensor=SensorInfo("ati-gamma")), columns, "ntnu")


def test_the_real_gamma_gets_about_the_published_numbers(ntnu):
    """The published ones were read off by hand; lines of the arm are named, not fitted."""
    found, published = wb.learn_sensor(ntnu), wb.load("sensors", "ati-gamma").noise
    noise = found.sensor.noise
    np.testing.assert_allclose(noise.white, published.white, rtol=0.04)
    np.testing.assert_allclose(noise.flicker[:5], published.flicker[:5], rtol=0.08)
    assert noise.flicker[5] == 0.0 and found.rest.spectra[5].flicker_most < published.flicker[5]
    np.testing.assert_allclose(noise.correlation, published.correlation, atol=0.02)
    np.testing.assert_allclose(noise.row_std, published.row_std, rtol=0.03)
    assert not noise.mains_amplitude.any() and not noise.warmup_drift.any()
    np.testing.assert_allclose(noise.resolution[3:], 1e-6)
    assert {3, 9, 13, 16, 72} <= {round(f) for f in found.rest.lines}
    said = " ".join(found.cannot_tell)
    coloured = said.split("colour of")[1].split(":")[0]
    assert "slower than 1 s" in said and "fx, fy, fz, tx, ty" in said and "tz" not in coloured


def moved(columns: dict[str, np.ndarray], **more: np.ndarray) -> Recording:
    return Recording(METADATA, columns | more, "rest.parquet")


def test_what_is_no_rest_is_refused_by_its_true_reason():
    rest = Rest(seconds=20.0)
    columns = dict(rest.recording(180).columns)
    n = len(columns["t"])
    half = np.arange(n) >= n // 2
    ramp = np.clip(np.arange(n) - n // 2, 0, 500) * 1e-3
    wave = np.sin(np.arange(n) / 300.0)
    gap = columns["t"] + 3.0 * half
    rng = np.random.default_rng(0)
    uneven = np.sort(columns["t"] + rng.uniform(0, 3.8e-3, n))
    clipped = np.zeros(n, dtype=np.uint32)
    clipped[77] = 1
    cases = {
        r"robot moves, for instance in row 2\d\d\d .*record a minute at rest": {
            "q2": columns["q2"] + ramp},
        "robot moves all the time": {"q2": columns["q2"] + wave},
        "column 'fy' jumps by .* near row 24..": {"fy": columns["fy"] + 2.0 * half},
        "row 2500 comes 3 s after the one before.*missing": {"t": gap},
        "clock is uneven": {"t": uneven},
        "column 'tz' is 0.5 in all rows": {"tz": np.full(n, 0.5)},
        "row 77: the sensor is saturated in 1 rows": {"status": clipped},
    }  # fmt: skip
    for words, change in cases.items():
        with pytest.raises(CalibrationError, match=r"rest\.parquet: .*" + words):
            wb.learn_sensor(moved(columns, **change))
    short = {k: v[:200] for k, v in columns.items()}
    with pytest.raises(CalibrationError, match=r"200 rows in 0\.796 s are too short"):
        wb.learn_sensor(moved(short))
    wb.learn_sensor(moved(columns))


def test_a_coarse_step_and_a_slow_rate_are_said():
    found = wb.learn_sensor(replace(COLOURED, step=4.0, rate=100.0).recording(190))
    said = " ".join(found.cannot_tell)
    assert "below the step of the output" in said
    assert "A mains line of 50 and 60 Hz: the rate of 100 Hz is too low." in said
    assert "mains line" not in " ".join(wb.learn_sensor(COLOURED.recording(190)).cannot_tell)


def test_range_and_mass_are_those_of_another_sensor(tmp_path):
    rest = Rest(seconds=4.0).recording(200)
    stated = wb.learn_sensor(rest)
    assert stated.like == "ati-gamma" and stated.sensor.calibration().range[0] == 65.0
    unknown = wb.learn_sensor(Rest(seconds=4.0).recording(200, sensor="home-made"))
    assert unknown.like == "generic" and "those of generic" in " ".join(unknown.cannot_tell)
    other = wb.learn_sensor(rest, like="ati-mini45", name="mine")
    assert other.sensor.mass == 0.0917
    assert other.sensor.mass_source.startswith("taken from ati-mini45")
    other.write(tmp_path / "mine.toml")
    again = wb.learn_sensor(rest, like=str(tmp_path / "mine.toml"))
    assert again.sensor.mass == 0.0917 and "taken from taken" not in again.text
    with pytest.raises(NotFoundError, match="did you mean 'ati-mini45'"):
        wb.learn_sensor(rest, like="ati-mini-45")
    heavy = recorded(Rest(seconds=4.0).rows(201) + 100.0 * np.eye(6)[0], 250.0)
    with pytest.raises(CalibrationError, match=r"column 'fx' reads 1.*beyond the range 80 of ati"):
        wb.learn_sensor(heavy, like="ati-mini40")
    assert wb.learn_sensor(heavy, like="ati-gamma").sensor.default == "SI-130-10"


def test_the_verb_writes_what_loads_again(tmp_path, capsys):
    rec, out = tmp_path / "rest.parquet", tmp_path / "mine.toml"
    rest = replace(COLOURED, seconds=20.0, hum=0.3, step=0.2).recording(210)
    rest.write(rec)
    assert main(["sensor", str(rec), "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "white" in printed and re.search(r"50\.0\d Hz", printed) and "±" in printed
    assert "It cannot tell:" in printed and "slower than 20 s" in printed
    sensor, learnt = wb.load("sensors", str(out)), wb.learn_sensor(rest, name="mine").sensor
    for name in ("white", "flicker", "correlation", "mains_amplitude", "resolution", "range"):
        np.testing.assert_array_equal(getattr(sensor.noise, name), getattr(learnt.noise, name))
    assert main(["sensor", str(rec), "--out", str(out), "--like", "ati-delta", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["like"] == "ati-delta" and result["mains_hz"] == pytest.approx(50.03, abs=0.02)
    assert result["channels"]["fx"]["white"] == pytest.approx(WHITE[0], rel=0.05)
    assert wb.load("sensors", str(out)).mass == 0.913
    assert main(["sensor", str(rec), "--out", str(rec)]) == 1
    assert "rest.parquet" in capsys.readouterr().err
