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
    known = [*registry.names(kind), *(SimDriver.drive_faults() if kind == "effects" else ())]
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
def test_record_killed_with_9_leaves_a_recording_that_calibrates(tmp_path, capfd):
    with recording_process(tmp_path, 1500) as process:
        wait_for(tmp_path / "rec.parquet", 500)
        process.send_signal(signal.SIGKILL)
    with pytest.warns(UserWarning, match="did not finish"):
        rows = len(Recording.read(tmp_path / "rec.parquet"))
    assert 500 <= rows < 20_000
    assert rows % 50 == 0
    capfd.readouterr()
    assert main(["calibrate", str(tmp_path / "rec.parquet")]) == 0
    captured = capfd.readouterr()
    assert "did not finish" in captured.err
    assert "tool.mass" in captured.out


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


@pytest.mark.slow
def test_poses_chosen_by_an_index_and_touches_planned_for_an_accuracy(tmp_path, capfd):
    poses, rec, touched, fit = (str(tmp_path / n) for n in ("p.parquet", "r.parquet", "t.parquet",
                                                            "fit.json"))  # fmt: skip
    chosen = ["plan", "medrue", "--index", "O1", "--n", "20", "--pool", "300", "--out", poses]
    assert main(chosen) == 0
    assert pq.read_table(poses).num_rows == 20
    capfd.readouterr()
    points = tmp_path / "points.csv"
    grid = [(x, y, z) for x in (0.2, 0.6) for y in (0.3, 0.6) for z in (-0.25, -0.1)]
    points.write_text("x,y,z\n" + "".join(f"{x},{y},{z}\n" for x, y, z in grid))
    goal = ["plan", "medrue", "--goal", "target-position", "--accuracy", "1e-3", "--pool", "300",
            "--points", str(points), "--out", poses, "--json"]  # fmt: skip
    assert main(goal) == 0
    told = json.loads(capfd.readouterr().out)
    assert told["assured_mm"] <= 1.0 < told["before_mm"]
    assert told["poses"] == pq.read_table(poses).num_rows
    assert told["touches"] == pq.read_table(told["touch_plan"]).num_rows
    for plan, out in ((poses, rec), (told["touch_plan"], touched)):
        run = ["record", "--robot", "medrue", "--plan", plan, "--out", out, "--samples", "20"]
        assert main(run) == 0
    both = ["calibrate", rec, "--touches", touched, "--free", "candidates", "sensor.bias",
            "--prior", "--out", fit, "--json"]  # fmt: skip
    capfd.readouterr()
    assert main(both) == 0
    result = json.loads(capfd.readouterr().out)
    assert {"xT", "x0", "sensor.bias.fx"} <= set(result["parameters"])
    assert abs(result["parameters"]["zT"]["value"] - 0.1346) < 2e-3


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
