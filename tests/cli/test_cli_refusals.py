"""The command line refuses bad input in one clear line, and writes nothing."""

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from commanded import names, said
from wrenchbed.cli import main
from wrenchbed.data import parquet

BAD_RECORDINGS = {
    "wrong robot": ({}, {"robot": "medrue"}, "robot 'medrue': row 0"),
    "unknown robot": ({}, {"robot": "hal"}, "there is no robot 'hal' here"),
    "mixed units": ({"q": np.rad2deg(1.0)}, {}, "is it in degrees?"),
    "negative weight": ({"f": -1.0, "t": -1.0}, {}, "opposite sign"),
}
"""Factors of columns by their first letter, changes of metadata, and words of the refusal."""


@pytest.mark.parametrize("name", BAD_RECORDINGS)
def test_a_bad_recording_gives_one_line_and_nothing_is_written(made, tmp_path, capfd, name):
    factors, changes, words = BAD_RECORDINGS[name]
    table, path = pq.read_table(made / "rec.parquet"), tmp_path / "bad.parquet"
    columns = {
        n: table[n].to_numpy() * (factors.get(n[0], 1) if n != "t" else 1)
        for n in table.column_names
    }
    raw = json.loads(table.schema.metadata[b"wrenchbed"]) | changes
    parquet.write(path, parquet.table_of(columns, raw))
    assert main(["calibrate", str(path), "--out", str(tmp_path / "fit.json")]) == 1
    assert words in said(capfd)
    assert names(tmp_path) == ["bad.parquet"]


def bad_plan(folder: Path, q, robot="ur5") -> str:
    path = folder / "plan.parquet"
    data = {f"q{j + 1}": np.asarray(q, dtype=float)[:, j] for j in range(np.shape(q)[1])}
    parquet.write(path, parquet.table_of(data, {"format": 1, "robot": robot}))
    return str(path)


@pytest.mark.parametrize(
    ("q", "extra", "words"),
    [
        (np.full((2, 6), 90.0), [], "row 0: q1 = 90 rad is outside its limits"),
        (np.zeros((2, 5)), [], "has 6 joints (q1…q6), found 5"),
        (np.zeros((2, 6)), ["--driver", "warp"], "no driver 'warp'"),
        (np.zeros((2, 6)), ["--robot", "medrue"], "the plan is for robot 'ur5', not 'medrue'"),
        (np.zeros((2, 6)), ["--samples", "0"], "must be above 0"),
        (np.zeros((2, 6)), ["--rate", "-5"], "must be above 0"),
        (np.zeros((2, 6)), ["--parameters", "none.json"], "none.json: there is no such file"),
    ],
)
def test_a_plan_that_cannot_run_gives_one_line_and_nothing_is_written(
    tmp_path, capfd, q, extra, words
):
    plan = bad_plan(tmp_path, q)
    out = str(tmp_path / "rec.parquet")
    assert main(["record", "--robot", "ur5", "--plan", plan, "--out", out, *extra]) == 1
    assert words in said(capfd)
    assert names(tmp_path) == ["plan.parquet"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('{"tool.mass": -1}', "tool.mass = -1 kg lies outside"),
        ("[1]", "must be a JSON object"),
        ("{", "not valid JSON"),
        ('{"tool.inertia.xx": 5}', "is that of no body"),
    ],
)
def test_wrong_parameters_give_one_line(made, tmp_path, capfd, text, words):
    (tmp_path / "truth.json").write_text(text)
    arguments = ["record", "--robot", "ur5", "--plan", made / "plan.parquet"]
    arguments += ["--out", tmp_path / "r.parquet", "--parameters", tmp_path / "truth.json"]
    assert main([*map(str, arguments)]) == 1
    assert words in said(capfd)
    assert names(tmp_path) == ["truth.json"]


def test_a_place_that_cannot_be_written_gives_one_line(made, tmp_path, capfd):
    (tmp_path / "file").write_text("")
    out = str(tmp_path / "file" / "plan.parquet")
    assert main(["plan", "ur5", "--out", out]) == 1
    assert "file" in said(capfd)
    out = str(tmp_path / "file" / "fit.json")
    assert main(["calibrate", str(made / "rec.parquet"), "--out", out]) == 1
    assert "file" in said(capfd)
    assert names(tmp_path) == ["file"]


def test_a_misspelt_truth_is_refused(made, tmp_path, capfd):
    (tmp_path / "truth.json").write_text('{"tool.mas": 1}')
    arguments = ["calibrate", str(made / "rec.parquet"), "--truth", str(tmp_path / "truth.json")]
    assert main(arguments) == 1
    assert "'tool.mas' = 1 is no parameter" in said(capfd)
