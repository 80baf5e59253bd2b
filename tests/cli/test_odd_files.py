"""Files that users have: odd names, edited by hand, of simulations without noise."""

import json
import os
import re
import shutil
from pathlib import Path

import mujoco
import numpy as np
import pytest

from wrenchbed.cli import main
from wrenchbed.data.recording import Recording
from wrenchbed.pages.draw import Drawn
from wrenchbed.reports.recording_page import recording_page
from wrenchbed.twin.comparison import simulators

NTNU = Path(__file__).resolve().parents[1] / "data" / "ntnu_kuka_ati_gamma"
RECORD = ["record", "--robot", "ur5", "--plan", "p.parquet", "--samples", "6", "--out"]


@pytest.fixture
def folder(made, tmp_path, monkeypatch):
    """With a plan and a recording of it."""
    monkeypatch.chdir(tmp_path)
    for name, short in (("plan", "p"), ("rec", "r")):
        shutil.copy(made / f"{name}.parquet", f"{short}.parquet")
    return tmp_path


def refused(line, told, capsys):
    capsys.readouterr()
    assert main(line) == 1
    error = capsys.readouterr().err
    assert told in error
    assert error.startswith("wrenchbed: error: ")
    assert (error.count("\n"), len(error) < 300) == (1, True)


@pytest.mark.slow
def test_a_recording_without_noise_has_a_report(folder):
    assert main([*RECORD, "off.parquet", "--noise", "off"]) == 0
    assert main(["report", "off.parquet", "--out", "off.html"]) == 0
    text = (folder / "off.html").read_text()
    assert "agrees with the recording" in text
    shown = re.sub("<script.*?</script>", "", text, flags=re.DOTALL)
    assert "nan" not in shown.replace("tenance", "")
    assert "NaN" not in "".join(re.findall('type="application/json".*?</script>', text, re.DOTALL))


def test_a_twin_of_a_real_robot_without_inertia_is_exported(tmp_path):
    """As `diagnose` writes it for NTNU's recording at rest, of which no inertia is known."""
    twin = {"format": 1, "robot": "oriented", "theta": {"tool.mass": 0.93, "tool.cog.z": 0.0438}}
    (tmp_path / "twin.json").write_text(json.dumps(twin))
    assert main(["export", str(tmp_path / "twin.json"), "--mjcf", str(tmp_path / "model")]) == 0
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "model" / "oriented.xml"))
    tool = model.body("tool")
    assert tool.mass[0] == pytest.approx(0.93)
    assert np.all(tool.inertia < 1e-6)


def test_an_effect_twice_on_one_joint_is_named(folder, capsys):
    values = {"joint": 2, "stiffness": 9000.0}
    once = {"effect": "joint.compliance", "parameters": values}
    (folder / "twin.json").write_text(
        json.dumps({"format": 1, "robot": "ur5", "effects": [once, once]})
    )
    text = "joint.compliance:joint=2,stiffness=9000"
    for line in (
        ["simulate", "twin.json", "--like", "r.parquet", "--out", "s.parquet"],
        ["export", "twin.json", "--mjcf", "model"],
        [*RECORD, "twice.parquet", "--effect", text, "--effect", text],
    ):
        refused(line, "effect joint.compliance acts twice", capsys)


def test_a_page_shows_the_tool_that_its_simulator_has(made, folder, monkeypatch):
    """Whatever else of a fit was edited by hand: its theta is what is simulated."""
    monkeypatch.setattr("wrenchbed.reports.recording_page.draw", lambda c: Drawn(c, "<svg></svg>"))
    fit, recording = json.loads((made / "fit.json").read_text()), Recording.read("r.parquet")
    path = folder / "edited.json"
    path.write_text(json.dumps(fit | {"tool": {"mass": "one"}, "parameters": "nonsense"}))
    assert simulators(recording, [path])[1].fitted
    (_, mass), (_, place) = recording_page(recording, [path], "").context["tool"]
    assert mass == f"{fit['tool']['mass']:.4g} kg" and place.endswith(" mm")


@pytest.mark.parametrize("digits", [400, 5_000])
def test_a_whole_number_beyond_all_floats_is_refused(digits, folder, capsys):
    (folder / "p.json").write_text('{"tool.mass": 1' + digits * "0" + "}")
    line = [*RECORD, "x.parquet", "--parameters", "p.json"]
    refused(line, "tool.mass" if digits == 400 else "p.json", capsys)


@pytest.mark.slow
def test_names_that_are_not_utf_8(folder):
    """Every verb reads and writes such files."""
    odd = os.fsdecode(b"r\xff")
    os.rename(folder / "r.parquet", folder / f"{odd}.parquet")  # noqa: PTH104
    (folder / f"{odd}.json").write_text(json.dumps({"format": 1, "robot": "ur5"}))
    for line in (
        ["calibrate", f"{odd}.parquet", "--out", f"{odd}.fit.json"],
        ["report", f"{odd}.parquet", f"{odd}.fit.json", "--out", f"{odd}.html"],
        ["view", f"{odd}.parquet", f"{odd}.fit.json", "--rrd", f"{odd}.rrd"],
        ["export", f"{odd}.parquet", "--mcap", f"{odd}.mcap"],
        ["export", f"{odd}.json", "--mjcf", f"{odd}.model"],
        ["simulate", f"{odd}.json", "--like", f"{odd}.parquet", "--out", f"{odd}.s.parquet"],
        ["plan", "ur5", "--n", "2", "--out", f"{odd}.plan.parquet"],
    ):
        assert main(line) == 0, line
        assert main([*line, "--force"] if line[-2] == "--mcap" else line) in (0, 1), line
    assert len(Recording.read(f"{odd}.s.parquet")) == 100
    assert json.loads((folder / f"{odd}.fit.json").read_bytes())["recording"] == f"{odd}.parquet"
