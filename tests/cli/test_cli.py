"""The command line: exit codes, one clear line a mistake, and nothing written."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from commanded import said
from wrenchbed import registry
from wrenchbed.cli import main
from wrenchbed.data.recording import Recording
from wrenchbed.hardware.drivers.sim import SimDriver


@pytest.mark.parametrize("kind", ["robots", "sensors", "drivers", "effects"])
def test_list_names_every_plug_in(capfd, kind):
    faults = SimDriver.drive_faults() if kind == "effects" else ()
    known = list(dict.fromkeys([*registry.names(kind), *faults]))  # of two a joint's own sensor has
    assert main(["list", kind, "--json"]) == 0
    assert list(json.loads(capfd.readouterr().out)) == known
    assert main(["list", kind]) == 0
    shown = capfd.readouterr().out
    assert all(n in shown for n in known) and max(map(len, shown.splitlines())) <= 80


def test_list_names_every_check_of_a_recording(capfd):
    assert main(["list", "checks", "--json"]) == 0
    told = json.loads(capfd.readouterr().out)
    assert told["dead channel"] and len(told) == 23 and all(told.values())


def test_results_are_json_on_demand(made, capfd, tmp_path):
    out = str(tmp_path / "p.parquet")
    assert main(["plan", "medrue", "--n", "3", "--out", out, "--json"]) == 0
    assert json.loads(capfd.readouterr().out)["rows"] == 3
    assert main(["calibrate", str(made / "rec.parquet"), "--json"]) == 0
    fit = json.loads(capfd.readouterr().out)
    assert fit["parameters"]["tool.mass"]["unit"] == "kg"
    assert fit == json.loads((made / "fit.json").read_text())


def test_the_shown_table_fits_eighty_columns(made, capfd, monkeypatch):
    assert main(["calibrate", str(made / "rec.parquet")]) == 0
    out = capfd.readouterr().out
    assert max(map(len, out.splitlines())) <= 80
    assert "\x1b[" not in out  # no colours when piped
    assert "tool.mass" in out
    assert "what this data cannot tell" in out


def test_the_truth_stands_beside_the_estimates(made, capfd, tmp_path):
    (tmp_path / "truth.json").write_text('{"tool.mass": 1.35}')
    arguments = ["calibrate", str(made / "rec.parquet"), "--truth", str(tmp_path / "truth.json")]
    assert main(arguments) == 0
    (line,) = [x for x in capfd.readouterr().out.splitlines() if x.startswith("tool.mass")]
    assert line.split()[5] == "1.35"
    assert line.rstrip().endswith("σ")
    assert abs(float(line.split()[6])) < 5


def recording_process(folder: Path, poses: int) -> subprocess.Popen:
    plan = str(folder / "plan.parquet")
    assert main(["plan", "ur5", "--n", str(poses), "--out", plan]) == 0
    command = [sys.executable, "-m", "wrenchbed", "record", "--robot", "ur5", "--plan", plan]
    command += ["--out", str(folder / "rec.parquet"), "--samples", "50"]
    return subprocess.Popen(command, stderr=subprocess.PIPE, text=True, preexec_fn=_heeds_ctrl_c)


def _heeds_ctrl_c() -> None:
    """Also where the tests run in the background, whose children ignore it."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def wait_for(path: Path, rows: int) -> None:
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline:
        if path.exists() and pq.read_metadata(path).num_rows >= rows:
            return
        time.sleep(0.05)
    raise AssertionError(f"{path} did not grow")


@pytest.mark.slow
def test_record_stopped_with_ctrl_c_finishes_its_file(tmp_path):
    with recording_process(tmp_path, 1500) as process:
        wait_for(tmp_path / "rec.parquet", 500)
        process.send_signal(signal.SIGINT)
        assert process.stderr is not None
        err = process.stderr.read()
    assert process.returncode == 130
    assert "what was recorded is on disk" in err and "--resume" in err
    assert len(Recording.read(tmp_path / "rec.parquet")) >= 500
    assert not list(tmp_path.glob("*.journal"))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["ur5", "--goal", "target-position"], "has no tool tip and target workspace"),
        (["medrue", "--goal", "target-position", "--accuracy", "-1"], "must be above 0"),
        (["medrue", "--goal", "target-position", "--points", "none.csv"], "there is no such file"),
        (["medrue", "--index", "O1", "--n", "10", "--pool", "5"], "cannot be chosen from a pool"),
        (["medrue", "--index", "O1", "--motion", "multisine"], "either poses or a motion"),
        (["medrue", "--index", "O1", "--goal", "target-position"], "chooses its own poses"),
        (["medrue", "--points", "none.csv"], "--points goes with --goal"),
        (["medrue", "--touch-cost", "2"], "--touch-cost goes with --goal"),
        (["medrue", "--pool", "200"], "--pool goes with --index, --goal or --for pose"),
        (["ur5", "--for", "pose", "--index", "O1"], "--for pose chooses its own poses"),
        (["ur5", "--for", "pose", "--motion", "multisine"], "--for pose chooses its own poses"),
        (["ur5", "--for", "pose", "--n", "9", "--pool", "5"], "cannot be chosen from a pool"),
        (["ur5", "--for", "dynamics"], "--motion excite goes with"),
    ],
)  # fmt: skip
def test_plans_that_make_no_sense_are_refused(tmp_path, capfd, arguments, message):
    out = tmp_path / "p.parquet"
    assert main(["plan", *arguments, "--out", str(out)]) == 1
    assert message in said(capfd)
    assert not out.exists()


def test_studies_and_touches_need_what_goes_with_them(tmp_path, capfd):
    assert main(["study", "medrue", "--robots", "0", "--out", str(tmp_path / "s")]) == 1
    assert "at least 2" in said(capfd)
    assert not (tmp_path / "s").exists()
    rec = tmp_path / "rec.parquet"
    assert main(["calibrate", str(rec), "--touch-std", "1e-3"]) == 1
