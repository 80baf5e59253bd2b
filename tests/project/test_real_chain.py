"""The verbs one after the other on the shipped real measurements, every export included."""

import json
from pathlib import Path

import mujoco
import pytest

import wrenchbed as wb
from wrenchbed.cli import main

REAL = Path(__file__).parents[1] / "data" / "ntnu_kuka_ati_gamma"
CSV = REAL / "0-calibration_fts-accel.csv"


def verb(*words: object) -> None:
    assert main([str(w) for w in words]) == 0, words


@pytest.fixture(scope="module")
def imported(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("real")
    verb("import", CSV, "--map", REAL / "static.toml", "--out", folder / "rec.parquet")
    verb("calibrate", folder / "rec.parquet", "--out", folder / "fit.json")
    verb("diagnose", folder / "rec.parquet", "--out", folder / "found")
    return folder


@pytest.mark.slow
def test_every_file_is_exported_and_read_again(imported, tmp_path):
    rec, twin = imported / "rec.parquet", imported / "found" / "twin.json"
    verb("export", twin, "--mjcf", tmp_path / "model")
    (model,) = (tmp_path / "model").glob("*.xml")
    exported = mujoco.MjModel.from_xml_path(str(model))
    weighed = exported.body("tool").mass[0]
    assert weighed == pytest.approx(0.933, abs=0.005)
    assert all(json.loads(p.read_text()) for p in (tmp_path / "model").glob("*.json"))
    verb("export", rec, "--mcap", tmp_path / "rec.mcap")
    assert (tmp_path / "rec.mcap").read_bytes()[:5] == b"\x89MCAP"
    verb("simulate", twin, "--like", rec, "--out", tmp_path / "better.parquet")
    assert len(wb.Recording.read(tmp_path / "better.parquet")) == len(wb.Recording.read(rec))


@pytest.mark.slow
def test_reports_and_pictures_are_written(imported, tmp_path, capsys):
    rec, fit, found = (imported / n for n in ("rec.parquet", "fit.json", "found"))
    verb("view", rec, "--rrd", tmp_path / "view.rrd")
    assert (tmp_path / "view.rrd").stat().st_size > 10_000
    assert "<svg" in (found / "report.html").read_text(encoding="utf-8")
    for name in ("diagnosis.json", "twin.json", "report.html", "diagnosis.rrd"):
        assert (found / name).stat().st_size > 100
    capsys.readouterr()
    page = tmp_path / "report.html"
    assert main(["report", str(rec), str(fit), "--out", str(page)]) == 1  # an arm without a model
    said = capsys.readouterr().err
    assert "no model of robot 'kuka-lbr-med14'" in said and said.count("\n") == 1
    assert not page.exists()
