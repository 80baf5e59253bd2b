"""A sensor from a user's file stands wherever a name does; a wrong file is one clear line."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm_files import CASES, TOOL_COG, TOOL_MASS
from recorded import METADATA, columns
from wrenchbed import registry
from wrenchbed.cli import main
from wrenchbed.data import column_map
from wrenchbed.data.metadata import SensorInfo
from wrenchbed.data.recording import Recording
from wrenchbed.errors import NotFoundError, ParameterError
from wrenchbed.sensors.described import read, rebuilt, text

TEXT = text(registry.load("sensors", "ati-mini45"))


@pytest.fixture(autouse=True)
def fresh(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is known from another test."""
    monkeypatch.setattr(registry, "_records", {})
    monkeypatch.setattr(registry, "_known", {})


def forgotten() -> None:
    registry._records.clear()
    registry._known.clear()


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    file = tmp_path / "mine.toml"
    file.write_text(TEXT.replace('name = "ati-mini45"', 'name = "mine"', 1), encoding="utf-8")
    return file


def test_a_path_stands_for_a_name(mine: Path) -> None:
    sensor = registry.load("sensors", str(mine))
    assert re.fullmatch(r"mine@[0-9a-f]{8}", sensor.name)
    assert registry.load("sensors", str(mine)) is sensor
    assert registry.load("sensors", sensor.name) is sensor
    assert registry.is_known("sensors", str(mine)) and registry.is_known("sensors", sensor.name)
    again = rebuilt(registry.record_of("sensors", sensor.name) or {})
    assert again.name == sensor.name and text(again) == text(sensor)
    assert registry.record_of("sensors", "ati-gamma") is None


def test_two_files_never_pass_for_one(mine: Path) -> None:
    first = registry.load("sensors", str(mine))
    mine.write_text(mine.read_text().replace("0.0917", "0.0918", 1))
    second = registry.load("sensors", str(mine))
    assert first.name != second.name and (first.mass, second.mass) == (0.0917, 0.0918)


WRONG = {
    "unknown field": ("white =", "whit =", "there is no field noise.whit; did you mean"),
    "unknown table": ("[mass]", "[masse]", r"there is no field masse; did you mean 'mass'"),
    "no table": ("[mass]  # kg\nvalue = 0.0917\n", "[mass]\n", r"mass\.value is missing"),
    "no source": ("[mass]  # kg\nvalue = 0.0917\nsource", "[mass]\nvalue = 0.0917\n#",
                  r"mass\.source is missing"),
    "unit in a text": ("value = 0.0917", 'value = "91.7 g"', r"mass\.value = '91.7 g' must be a "
                       "number in kg, without its unit"),
    "grams": ("value = 0.0917", "value = 91.7", r"mass\.value = 91.7 .*\(is it in g\?\)"),
    "negative mass": ("value = 0.0917", "value = -0.1", r"mass\.value = -0.1 must be 0 … 20 kg"),
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
    "format": ("format = 1", "format = 2", "format = 2 must be 1"),
    "no calibration": ("[[calibration]]", "[[calibrations]]", "did you mean 'calibration'"),
    "not TOML": ("format = 1", "format = ", "not valid TOML"),
    "not finite": ("f_high = 100.0", "f_high = inf", r"noise\.f_high = inf must be a number"),
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


def test_a_file_that_is_not_there_is_said(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    with pytest.raises(NotFoundError, match=r"gone\.toml: cannot be read: No such file"):
        registry.load("sensors", str(tmp_path / "gone.toml"))
    with pytest.raises(NotFoundError, match="did you mean 'ati-mini45'"):
        registry.load("sensors", "ati-mini-45")
    with pytest.raises(ParameterError, match="sensor_model: incomplete"):
        rebuilt({"text": TEXT})


def test_a_recording_carries_its_sensor(mine: Path, tmp_path: Path) -> None:
    name = registry.known_as("sensors", str(mine))
    rec = tmp_path / "rec.parquet"
    Recording(replace(METADATA, sensor=SensorInfo(name)), columns()).write(rec)
    mine.unlink()
    forgotten()
    read_again = Recording.read(rec)
    assert read_again.metadata.sensor.model == name
    assert registry.load("sensors", name).calibration().range[0] == 290.0
    copy = tmp_path / "copy.parquet"
    read_again.write(copy)
    forgotten()
    assert Recording.read(copy).metadata.sensor.model == name
    assert registry.is_known("sensors", name)


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
    forgotten()
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
    forgotten()
    found = Recording.read(rec)
    assert found.metadata.robot == before
    robot = registry.load("robots", before)
    assert robot.sensor == found.metadata.sensor.model and robot.sensor.startswith("mine@")
    sensor = registry.load("sensors", robot.sensor)
    np.testing.assert_allclose(found.metadata.sensor.noise_std, sensor.noise.row_std)
    forgotten()
    assert main(["calibrate", str(rec), "--out", str(tmp_path / "fit.json")]) == 0
    assert json.loads((tmp_path / "fit.json").read_text())["robot"] == before


def test_a_carried_sensor_never_replaces_a_built_in_one(tmp_path: Path) -> None:
    weak = TEXT.replace('name = "ati-mini45"', 'name = "ati-gamma"', 1)
    registry.remember("sensors", "ati-gamma", {"toml": weak})
    assert registry.load("sensors", "ati-gamma").mass == 0.255
    registry.remember("sensors", "mine@00000000", {"toml": "format = 1"})
    with pytest.raises(ParameterError, match="sensor_model: name is missing"):
        registry.load("sensors", "mine@00000000")
