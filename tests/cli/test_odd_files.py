"""Files that users have: odd names, edited by hand, of simulations without noise."""

import json
import os
import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

from wrenchbed.cli import main
from wrenchbed.data.recording import Recording

NTNU = Path(__file__).resolve().parents[1] / "data" / "ntnu_kuka_ati_gamma"
RECORD = ["record", "--robot", "ur5", "--plan", "p.parquet", "--samples", "6", "--out"]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["plan", "ur5", "--n", "12", "--out", "p.parquet"]) == 0
    assert main([*RECORD, "r.parquet"]) == 0
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


def test_a_fit_edited_by_hand_is_refused_by_field(folder, capsys):
    assert main(["calibrate", "r.parquet", "--out", "fit.json"]) == 0
    fit = json.loads((folder / "fit.json").read_text())
    line = ["report", "r.parquet", "edited.json", "--out", "r.html"]
    here = [0, 0, 0]
    for tool in (
        None, {"mass": 1.0}, {"mass": "one", "cog": here}, {"mass": 10**400, "cog": here},
        {"mass": float("nan"), "cog": here}, {"mass": 1.0, "cog": {}},
    ):  # fmt: skip
        (folder / "edited.json").write_text(json.dumps(fit | {"tool": tool}))
        refused(line, "edited: field 'tool' is not as `calibrate` writes it", capsys)
    (folder / "edited.json").write_text(json.dumps(fit | {"parameters": "nonsense"}))
    assert main(line) == 0, "the page does not read what parameters were fitted"


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
    assert len(Recording.read(f"{odd}.s.parquet")) == 72
    assert json.loads((folder / f"{odd}.fit.json").read_bytes())["recording"] == f"{odd}.parquet"


def cells(row, column, cell, lines=24, blank=()):
    """A log of 12 columns with one odd cell; a blank line before some rows."""
    rng = np.random.default_rng(0)
    table = rng.normal(size=(lines, 13)).round(6).astype(str).tolist()
    table[row][column] = cell
    text = [",".join(("t", *"abcdef", *("fx", "fy", "fz", "tx", "ty", "tz")))]
    for number, line in enumerate(table):
        text += [""] * (number in blank) + [",".join(line)]
    return "\n".join(text) + "\n"


@pytest.mark.parametrize("cell", ["abc", "", "1e999"])
@pytest.mark.parametrize(("lines", "row"), [(24, 9), (15_000, 14_321)])
def test_a_bad_cell_is_blamed_on_its_row(cell, lines, row, tmp_path):
    """In small files and in those that are read in a stream."""
    from wrenchbed.data.text_table import read_text
    from wrenchbed.errors import MapError

    path = tmp_path / "log.csv"
    path.write_text(cells(row, 8, cell, lines))
    with pytest.raises(MapError, match=rf"'fy', row {row}: .*\(line {row + 2}\)"):
        read_text(path).numbers("fy")
