"""Every sensor keeps the contract; the Gamma's noise is that of the real recording.

The suite finds the sensors by itself: a new file is tested as soon as it lies there.
"""

import itertools
import tomllib
from pathlib import Path

import numpy as np
import pytest
from scipy import signal, stats

from wrenchbed import registry
from wrenchbed.errors import NotFoundError, ParameterError
from wrenchbed.physics.noise import NoiseStream, noise_model
from wrenchbed.sensors.base import Sensor, SensorCalibration
from wrenchbed.sensors.described import read, text

REST = Path(__file__).parents[1] / "data" / "ntnu_kuka_ati_gamma" / "0-steady-state_wrench.csv"
PAGE = Path(__file__).parents[2] / "docs" / "reference" / "sensors.md"
FILES = Path(__file__).parents[2] / "src" / "wrenchbed" / "sensors"
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


def test_every_number_has_a_source(sensor: Sensor) -> None:
    """Each table of the file that holds numbers also says where they come from."""

    def has_numbers(value: object) -> bool:
        return isinstance(value, list | int | float) and not isinstance(value, bool)

    content = tomllib.loads((FILES / f"{sensor.name}.toml").read_text(encoding="utf-8"))
    tables = [v for v in content.values() if isinstance(v, dict)] + content["calibration"]
    assert len(tables) >= 4
    for table in tables:
        if any(map(has_numbers, table.values())):
            assert len(table["source"].split()) >= 1 and table["source"][0] != " "
    loose = {k for k, v in content.items() if has_numbers(v)} - {"format", "calibration"}
    assert not loose, f"without a source: {loose}"


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
    assert own is sensor.calibration(sensor.default)
    np.testing.assert_array_equal(noise.range, own.range)
    assert (noise.row_std > 0).all()
    assert (noise.row_std < 1e-2 * own.range).all()
    assert (noise.resolution < noise.row_std).all()
    assert (noise.resolution <= own.resolution).all()
    assert (own.resolution / np.sqrt(12) < noise.row_std).all()
    # within ten minutes a warm sensor drifts less than one row shows
    drift = np.exp(-noise.warmup_age / noise.warmup_time) * -np.expm1(-600 / noise.warmup_time)
    assert (noise.warmup_drift * drift < noise.row_std).all()


def test_white_noise_is_independent_and_gaussian_with_the_same_deviation() -> None:
    own = registry.load("sensors", "ati-mini40").noise
    model, std = noise_model("white", own), own.row_std
    np.testing.assert_array_equal(model.row_std, std)
    n = 8_000
    rows = NoiseStream(model, 7).corrupt(np.arange(n) / 100, np.zeros((n, 6)))[0]
    np.testing.assert_allclose(rows.std(axis=0), std, rtol=5 / np.sqrt(2 * n))
    assert stats.kstest((rows / std).ravel(), "norm").pvalue > 1e-3
    for lag in (1, 2, 10):
        shared = (rows[lag:].T @ rows[:-lag]) / n / np.outer(std, std)
        assert np.abs(shared).max() < 5 / np.sqrt(n)
    far, status = NoiseStream(model, 1).corrupt([0.0, 1e6], np.full((2, 6), 1e6))
    assert status.tolist() == [0, 0] and (np.abs(far - 1e6) < 6 * std).all()


def test_noise_off_returns_every_bit_of_the_load() -> None:
    load = np.array([[0.0, -0.0, 1 / 3, 1e300, 5e-324, -7.1]])
    own = registry.load("sensors", "ati-gamma").noise
    assert noise_model("real", own) is own
    with pytest.raises(ParameterError, match=r"no noise 'pink'\. Known: real, white, off"):
        noise_model("pink", own)
    measured, status = NoiseStream(noise_model("off", own), 1).corrupt([0.0], load)
    assert measured.tobytes() == load.tobytes()
    assert measured is not load and status.tolist() == [0]


def test_calibrations_that_are_unknown_or_without_a_range_are_refused() -> None:
    with pytest.raises(NotFoundError, match="SI-20-1"):
        registry.load("sensors", "ati-mini40").calibration("SI-0-0")
    with pytest.raises(ParameterError, match="SI-0-0.range"):
        SensorCalibration("SI-0-0", np.zeros(6), np.ones(6), "none")


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


def test_the_gammas_figures_are_those_of_the_recording(real: np.ndarray) -> None:
    noise = registry.load("sensors", "ati-gamma").noise
    assert real.shape == (698, 6)
    f, p = signal.periodogram(real, RATE, axis=0)
    flicker = np.sqrt((p[1:3] * f[1:3, None]).mean(axis=0))
    shown = flicker**2 * np.log(noise.f_high * len(real) / RATE / 0.4)
    white = np.sqrt(real.var(axis=0, ddof=1) - shown)
    np.testing.assert_allclose(noise.white, white, rtol=0.005)
    np.testing.assert_allclose(noise.flicker, flicker, rtol=0.02)
    np.testing.assert_allclose(noise.correlation, np.corrcoef(real.T), atol=0.006)


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
