"""Bad input, odd files and a lack of memory: one clear line each, and nothing is written."""

import errno
import json
import os
import re
import resource
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
import pytest

import wrenchbed as wb
from commanded import names, said
from simulated import UR5_TRUTH, WHITE, static
from wrenchbed.cli import main
from wrenchbed.data.plan import is_plan
from wrenchbed.data.recording import Recording
from wrenchbed.data.text_table import read_text
from wrenchbed.errors import ShortageError, shortage
from wrenchbed.pages.draw import Drawn
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.reports.recording_page import recording_page
from wrenchbed.twin.simulator_predictions import simulators


def test_a_plan_of_another_number_of_joints_is_refused(tmp_path, capfd):
    wb.Plan.of("ur5", np.zeros((2, 5))).write(tmp_path / "p")
    words = ["record", "--robot", "ur5", "--plan", str(tmp_path / "p"), "--out"]
    assert main([*words, str(tmp_path / "r")]) == 1
    assert "has 6 joints (q1…q6), found 5" in said(capfd) and names(tmp_path) == ["p"]


MB = 1_000_000


LIMITED = [
    (resource.RLIMIT_AS, 150 * MB, "calibrate rec.parquet", "out of memory", "ulimit -v"),
    (resource.RLIMIT_AS, 500 * MB, "diagnose rec.parquet", "out of memory", "ulimit -v"),
    (resource.RLIMIT_NOFILE, 16, "campaign ur5 --robots 2", "open 16 and needs 72", "ulimit -n 72"),
    (resource.RLIMIT_NOFILE, 40, "campaign ur5 --robots 2", "open 40 and needs 72", "ulimit -n 72"),
]


@pytest.mark.sampled
@pytest.mark.parametrize(("kind", "value", "line", "why", "remedy"), LIMITED)
def test_a_low_limit_is_told_and_never_hangs(made, tmp_path, kind, value, line, why, remedy):
    done = subprocess.run(
        [sys.executable, "-m", "wrenchbed", *line.split(), "--out", tmp_path / "o"], cwd=made,
        capture_output=True, text=True, timeout=60.0, check=False,
        preexec_fn=lambda: resource.setrlimit(kind, (value, value)),
    )  # fmt: skip
    assert done.returncode == 1 and done.stderr.count("\n") == 1, done.stderr
    assert why in done.stderr and remedy in done.stderr and "rec.parquet" not in done.stderr


SHORT = [
    (pa.ArrowMemoryError("malloc of size 64 failed"), "out of memory"),
    (MemoryError(), "out of memory"),
    (OSError(errno.ENOMEM, "Cannot allocate memory"), "out of memory"),
    (OSError(errno.EMFILE, "Too many open files"), "too many open files"),
]


@pytest.mark.parametrize(("cause", "told"), SHORT, ids=["arrow", "numpy", "memory", "files"])
def test_no_file_is_called_damaged_for_want_of_memory(made, monkeypatch, cause, told, capsys):
    def fail(*_, **__):
        raise cause

    path = made / "rec.parquet"
    monkeypatch.setattr(pq, "ParquetFile", fail)
    monkeypatch.setattr(pq, "read_schema", fail)
    for read in (Recording.read, is_plan):
        with pytest.raises((ShortageError, MemoryError)):
            read(path)
    assert main(["calibrate", str(path)]) == 1
    said = capsys.readouterr().err
    assert told in said and "raise the limit" in said and "Parquet" not in said


@pytest.mark.parametrize(("cause", "told"), SHORT[2:], ids=["memory", "files"])
def test_a_text_file_is_not_blamed_either(tmp_path, monkeypatch, cause, told):
    def fail(*_, **__):
        raise cause

    path = tmp_path / "log.csv"
    path.write_text("t,fx\n0,1\n1,2\n")
    monkeypatch.setattr(Path, "open", fail)
    monkeypatch.setattr(Path, "read_bytes", fail)
    with pytest.raises(ShortageError, match=f"log.csv: {told}"):
        read_text(path)


def test_what_is_no_shortage_is_none():
    for error in (OSError(errno.ENOENT, "none"), ImportError("no module"), ValueError("memory")):
        assert shortage(error) is None
    unloaded = ImportError("libarrow.so.2600: failed to map segment from shared object")
    assert "out of memory" in str(shortage(unloaded))


RECORD = ["record", "--robot", "ur5", "--plan", "p.parquet", "--samples", "6", "--out"]


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


def test_a_page_shows_the_tool_that_its_simulator_has(made, folder, monkeypatch):
    """Whatever else of a fit was edited by hand: its theta is what is simulated."""
    monkeypatch.setattr("wrenchbed.reports.recording_page.draw", lambda c: Drawn(c, "<svg></svg>"))
    fit, recording = json.loads((made / "fit.json").read_text()), Recording.read("r.parquet")
    path = folder / "edited.json"
    path.write_text(json.dumps(fit | {"tool": {"mass": "one"}, "parameters": "nonsense"}))
    assert simulators(recording, [path])[1].fitted
    page = recording_page(recording, [path], "").html()
    assert f"<b>mass</b> {fit['tool']['mass']:.4g} kg" in page
    assert re.search(r"<b>centre of gravity</b> \([^)]+\) mm", page)


@pytest.mark.slow
def test_names_that_are_not_utf_8(folder):
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


MAP = """
[recording]
robot = "ur5"
mode = "static"

[[file]]
match = "*"
[file.columns]
t = { column = "t", unit = "s" }
segment = { column = "segment" }
"""
MAP += "".join(f'q{j} = {{ column = "q{j}", unit = "rad" }}\n' for j in range(1, 7))
MAP += "".join(
    f'{c} = {{ column = "{c}", unit = "{"N" if c[0] == "f" else "N·m"}" }}\n' for c in CHANNELS
)


@pytest.mark.parametrize("broken", [False, True])
def test_a_doubt_is_said_and_the_recording_written(tmp_path, capsys, broken):
    columns = dict(static("ur5", UR5_TRUTH, poses=30, samples=5, noise=WHITE).columns)
    if broken:
        columns["fx"], columns["fz"] = columns["fz"], columns["fx"]
    pa.csv.write_csv(pa.table({k: np.asarray(x) for k, x in columns.items()}), tmp_path / "a.csv")
    (tmp_path / "map.toml").write_text(MAP, encoding="utf-8")
    out = tmp_path / "rec.parquet"
    command = ["import", str(tmp_path / "a.csv"), "--map", str(tmp_path / "map.toml")]
    assert main([*command, "--out", str(out), "--json"]) == 0
    told = capsys.readouterr()
    assert out.exists()
    assert ("doubt" in json.loads(told.out)) == broken
    assert ("calibrate will refuse" in told.err) == broken
    assert main(["calibrate", str(out)]) == (1 if broken else 0)
    if broken:
        assert json.loads(told.out)["doubt"] in capsys.readouterr().err
