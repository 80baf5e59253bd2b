"""Every sensor keeps the contract; the Gamma's noise is that of the real recording.

The suite finds the sensors by itself: a new file is tested as soon as it lies there.
"""

import itertools
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from arm_files import CASES, TOOL_COG, TOOL_MASS
from wrenchbed import registry
from wrenchbed.cli import main
from wrenchbed.data import column_map
from wrenchbed.data.recording import Recording
from wrenchbed.errors import NotFoundError, ParameterError
from wrenchbed.physics.noise import NoiseStream, noise_model
from wrenchbed.sensors.base import Sensor
from wrenchbed.sensors.described import read, rebuilt, text

REST = Path(__file__).parents[1] / "data" / "ntnu_kuka_ati_gamma" / "0-steady-state_wrench.csv"
PAGE = Path(__file__).parents[2] / "docs" / "reference" / "sensors.md"
pytestmark = pytest.mark.usefixtures("fresh_registry")
RATE = 698.1
SENSORS = registry.names("sensors")


@pytest.fixture(params=SENSORS)
def sensor(request: pytest.FixtureRequest) -> Sensor:
    loaded = registry.load("sensors", request.param)
    assert isinstance(loaded, Sensor) and loaded.name == request.param
    return loaded


@pytest.fixture(scope="module")
def real() -> np.ndarray:
    return np.loadtxt(REST, delimiter=",", skiprows=1)


def test_the_sensors_of_the_field_exist() -> None:
    assert set(SENSORS) >= {
        "ati-gamma", "ati-mini40", "ati-mini45", "ati-nano17", "ati-delta", "ati-axia80",
        "robotiq-ft300s", "onrobot-hex-e", "bota-sensone", "ur-eseries", "franka", "generic",
    }  # fmt: skip


def test_ranges_and_resolutions_are_plausible_and_sourced(sensor: Sensor) -> None:
    assert len({c.name for c in sensor.calibrations}) == len(sensor.calibrations) > 0
    for c in sensor.calibrations:
        assert c.range.shape == c.resolution.shape == (6,)
        assert (c.range > 0).all() and (c.resolution > 0).all()
        steps = c.range / c.resolution  # a strain gauge resolves a thousandth
        assert (steps > (1000 if sensor.name.startswith("ati-") else 100)).all()
        assert (steps < 1e6).all()
        assert c.source.strip()
    assert sensor.title and sensor.mass_source and sensor.noise_source
    assert 0 <= sensor.mass < 5
    if sensor.accuracy is not None:
        assert sensor.accuracy.shape == (6,) and (sensor.accuracy > 0).all()
        assert sensor.accuracy_source.strip()
        assert (sensor.accuracy < 0.05 * sensor.calibration().range).all()
    assert np.abs(sensor.plate_offset).max() < 0.1 and sensor.plate_offset_source
    counts = None if sensor.counts is None else sensor.calibration().range * sensor.counts
    assert counts is None or ((counts > 1000).all() and (counts < 2**31).all())


def test_what_is_written_reads_the_same(sensor: Sensor, tmp_path: Path) -> None:
    file = tmp_path / "copy.toml"
    file.write_text(text(sensor), encoding="utf-8")
    copy = read(file)
    assert copy.name.partition("@")[0] == sensor.name and text(copy) == text(sensor)
    for field in ("white", "flicker", "correlation", "warmup_drift", "resolution", "range"):
        np.testing.assert_array_equal(getattr(copy.noise, field), getattr(sensor.noise, field))


def row_of_the_page(sensor: Sensor) -> str:
    """The sensor's row in the table of all: everything of the default calibration."""

    def short(six: np.ndarray) -> str:
        x, y, z, a, b, c = (f"{v:.3g}" for v in six)
        force = f"{x} · {z}" if x == y else f"{x} · {y} · {z}"
        return f"{force}, {a}" + ("" if a == b == c else f" · {c}" if a == b else f" · {b} · {c}")

    own = sensor.calibration()
    counts = None if sensor.counts is None else own.range * sensor.counts
    return (
        f"| `{sensor.name}` | {', '.join(c.name for c in sensor.calibrations)} | "
        f"{short(own.range)} | {short(own.resolution)} | {short(sensor.noise.row_std)} | "
        f"{1e3 * sensor.mass:.4g} | {1e3 * sensor.plate_offset[2]:.3g} | "
        f"{'float' if counts is None else short(counts)} |"
    )


def test_the_page_of_the_sensors_has_its_row(sensor: Sensor) -> None:
    rows = PAGE.read_text(encoding="utf-8").splitlines()
    assert row_of_the_page(sensor) in rows, f"docs/reference/sensors.md: {row_of_the_page(sensor)}"


def test_the_noise_belongs_to_the_default_calibration(sensor: Sensor) -> None:
    own, noise = sensor.calibration(), sensor.noise
    np.testing.assert_array_equal(noise.range, own.range)
    assert (noise.row_std > 0).all()
    assert (noise.row_std < 1e-2 * own.range).all()
    assert (noise.resolution < noise.row_std).all()
    assert (noise.resolution <= own.resolution).all()
    assert (own.resolution / np.sqrt(12) < noise.row_std).all()
    # within ten minutes a warm sensor drifts less than one row shows
    drift = np.exp(-noise.warmup_age / noise.warmup_time) * -np.expm1(-600 / noise.warmup_time)
    assert (noise.warmup_drift * drift < noise.row_std).all()


def test_noise_off_returns_every_bit_of_the_load() -> None:
    load = np.array([[0.0, -0.0, 1 / 3, 1e300, 5e-324, -7.1]])
    own = registry.load("sensors", "ati-gamma").noise
    assert noise_model("real", own) is own
    white = noise_model("white", own)
    assert white.row_std == pytest.approx(own.row_std)
    assert not NoiseStream(white, 1).corrupt([0.0], np.full((1, 6), 1e6))[1].any()
    with pytest.raises(ParameterError, match=r"no noise 'pink'\. Known: real, white, off"):
        noise_model("pink", own)
    measured, status = NoiseStream(noise_model("off", own), 1).corrupt([0.0], load)
    assert measured.tobytes() == load.tobytes()
    assert measured is not load and status.tolist() == [0]


def test_an_unknown_calibration_is_refused() -> None:
    with pytest.raises(NotFoundError, match="SI-20-1"):
        replace(registry.load("sensors", "ati-mini40"), default="SI-0-0")


def test_the_mini40s_noise_is_that_of_equal_gauges_near_the_published_rest() -> None:
    mini40 = registry.load("sensors", "ati-mini40")
    noise, covariance = mini40.noise, mini40.gauges @ mini40.gauges.T
    std = np.sqrt(np.diagonal(covariance))
    np.testing.assert_allclose(noise.correlation, covariance / np.outer(std, std))
    np.testing.assert_allclose(noise.white, 0.87e-3 * std)
    np.testing.assert_allclose(noise.flicker, 0.87e-3 / 8 * std)
    published = np.array([0.01515, 0.01425, 0.0293, 0.000425, 0.000735, 0.00029])
    ratio = noise.row_std / published
    assert (np.abs(np.delete(ratio, 4) - 1) < 0.15).all() and ratio[4] > 0.5
    level = published[[0, 1, 2, 5]] / std[[0, 1, 2, 5]]
    assert np.exp(np.log(level).mean()) == pytest.approx(0.87e-3, rel=0.01)


def test_a_simulated_gamma_rests_like_the_real_one(real: np.ndarray) -> None:
    noise = registry.load("sensors", "ati-gamma").noise
    t = np.arange(len(real)) / RATE
    rests = [NoiseStream(noise, s).corrupt(t, np.zeros((len(t), 6)))[0] for s in range(40)]
    std = np.sqrt(np.mean([r.var(axis=0) for r in rests], axis=0))
    np.testing.assert_allclose(std, real.std(axis=0), rtol=0.03)
    correlation = np.mean([np.corrcoef(r.T) for r in rests], axis=0)
    np.testing.assert_allclose(correlation, np.corrcoef(real.T), atol=0.03)

    f, simulated = signal.periodogram(np.array(rests), RATE, axis=1)
    simulated = simulated.mean(axis=0)
    _, measured = signal.periodogram(real, RATE, axis=0)
    edges = [2.5, 5.5, 11, 22, 44, 88, 175, 349]
    for low, high in itertools.pairwise(edges):
        octave = (f >= low) & (f < high)
        ratio = np.sqrt(measured[octave].mean(axis=0) / simulated[octave].mean(axis=0))
        assert (ratio < 6.5).all() and (ratio > 1 / 6.5).all(), (low, ratio)
        assert 1 / 1.6 < ratio[5] < 1.6, (low, ratio)


TEXT = text(registry.load("sensors", "ati-mini45"))


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    file = tmp_path / "mine.toml"
    file.write_text(TEXT.replace('name = "ati-mini45"', 'name = "mine"', 1), encoding="utf-8")
    return file


def test_a_path_stands_for_a_name_and_two_files_never_pass_for_one(mine):
    sensor = registry.load("sensors", str(mine))
    assert re.fullmatch(r"mine@[0-9a-f]{8}", sensor.name)
    assert registry.load("sensors", str(mine)) is sensor
    assert registry.load("sensors", sensor.name) is sensor
    assert registry.is_known("sensors", str(mine)) and registry.is_known("sensors", sensor.name)
    again = rebuilt(registry.record_of("sensors", sensor.name) or {})
    assert again.name == sensor.name and text(again) == text(sensor)
    assert registry.record_of("sensors", "ati-gamma") is None
    first = registry.load("sensors", str(mine))
    mine.write_text(mine.read_text().replace("0.0917", "0.0918", 1))
    second = registry.load("sensors", str(mine))
    assert first.name != second.name and (first.mass, second.mass) == (0.0917, 0.0918)


WRONG = {
    "unknown field": ("white =", "whit =", "there is no field noise.whit; did you mean"),
    "no source": ("[mass]  # kg\nvalue = 0.0917\nsource", "[mass]\nvalue = 0.0917\n#",
                  r"mass\.source is missing"),
    "unit in a text": ("value = 0.0917", 'value = "91.7 g"', r"mass\.value = '91.7 g' must be a "
                       "number in kg, without its unit"),
    "grams": ("value = 0.0917", "value = 91.7", r"mass\.value = 91.7 .*\(is it in g\?\)"),
    "millimetres": ("value = [0.0, 0.0, 0.0157]", "value = [0.0, 0.0, 15.7]",
                    r"plate_offset\.value .*\(is it in mm\?\)"),
    "shape": ("range = [145.0, ", "range = [", r"calibration 1\.range = .* must be six"),
    "zero range": ("range = [145.0, ", "range = [0.0, ", r"calibration 1\.range = .* above 0"),
    "coarse": ("resolution = [0.0625, ", "resolution = [200.0, ",
               r"1\.resolution = .* must be below range"),
    "millinewtons": ("white = [0.188, ", "white = [1880.0, ", r"noise\.white .* range .*mN"),
    "negative noise": ("white = [0.188, ", "white = [-0.1, ", r"noise\.white .* not be below 0"),
    "band": ("f_low = 0.001", "f_low = 200.0", r"noise.f_low = 200 Hz"),
    "default": ('default = "SI-290-10"', 'default = "SI-290"',
                r"default = 'SI-290' .*did you mean 'SI-290-10'"),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_file_is_one_line_that_names_file_and_field(case: str, tmp_path: Path) -> None:
    before, after, words = WRONG[case]
    assert before in TEXT
    file = tmp_path / "mine.toml"
    file.write_text(TEXT.replace(before, after, 1), encoding="utf-8")
    with pytest.raises(ParameterError) as error:
        read(file)
    message = str(error.value)
    assert message.startswith(f"{file}: ") and "\n" not in message
    assert re.search(words, message), message


def test_a_file_that_is_not_there_is_said(tmp_path: Path) -> None:
    with pytest.raises(NotFoundError, match=r"gone\.toml: cannot be read: No such file"):
        registry.load("sensors", str(tmp_path / "gone.toml"))
    with pytest.raises(NotFoundError, match="did you mean 'ati-mini45'"):
        registry.load("sensors", "ati-mini-45")
    with pytest.raises(ParameterError, match="sensor_model: incomplete"):
        rebuilt({"text": TEXT})


def test_a_map_may_name_the_file(
    mine: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    data = Path(__file__).parents[1] / "data" / "ntnu_kuka_ati_gamma"
    toml = (data / "static.toml").read_text().replace('model = "ati-gamma"', 'model = "mine.toml"')
    assert "mine.toml" in toml
    (tmp_path / "map.toml").write_text(toml)
    column_map.read(tmp_path / "map.toml")
    line = ["import", str(data / "0-calibration_fts-accel.csv"), "--map", "map.toml"]
    assert main([*line, "--out", "rec.parquet"]) == 0
    registry.forget()
    found = Recording.read("rec.parquet")
    assert str(found.metadata.sensor.model).startswith("mine@")


def test_a_robot_has_it_and_carries_it_elsewhere(mine: Path, tmp_path: Path) -> None:
    """Robot, recording and calibration by files alone; both TOML files may be gone afterwards."""
    case = next(c for c in CASES if not c.tool)
    toml, plan, rec = tmp_path / "arms" / "my.toml", tmp_path / "p.parquet", tmp_path / "r.parquet"
    toml.parent.mkdir()
    stated = ["--tool-mass", str(TOOL_MASS), "--tool-cog", *map(str, TOOL_COG)]
    line = ["robot", str(case.path), "--frame", case.frame, "--sensor", str(mine), *stated]
    assert main([*line, "--out", str(toml)]) == 0
    assert 'sensor = "../mine.toml"' in toml.read_text()
    assert main(["plan", str(toml), "--n", "12", "--out", str(plan)]) == 0
    line = ["record", "--robot", str(toml), "--plan", str(plan), "--out", str(rec)]
    assert main([*line, "--samples", "20"]) == 0
    before = registry.load("robots", str(toml)).name
    stated_then = mine.read_text()
    mine.write_text(stated_then.replace("0.0917", "0.0918", 1))
    assert registry.load("robots", str(toml)).name != before
    mine.unlink()
    toml.unlink()
    registry.forget()
    found = Recording.read(rec)
    assert found.metadata.robot == before
    robot = registry.load("robots", before)
    assert robot.sensor == found.metadata.sensor.model and robot.sensor.startswith("mine@")
    sensor = registry.load("sensors", robot.sensor)
    np.testing.assert_allclose(found.metadata.sensor.noise_std, sensor.noise.row_std)
    registry.forget()
    assert main(["calibrate", str(rec), "--out", str(tmp_path / "fit.json")]) == 0
    assert json.loads((tmp_path / "fit.json").read_text())["robot"] == before


def test_a_carried_sensor_never_replaces_a_built_in_one() -> None:
    weak = TEXT.replace('name = "ati-mini45"', 'name = "ati-gamma"', 1)
    registry.remember("sensors", "ati-gamma", {"toml": weak})
    assert registry.load("sensors", "ati-gamma").mass == 0.255
    registry.remember("sensors", "mine@00000000", {"toml": "format = 1"})
    with pytest.raises(ParameterError, match="sensor_model: name is missing"):
        registry.load("sensors", "mine@00000000")
