"""The command line: exit codes, one clear line a mistake, and nothing written."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from wrenchbed import parquet
from wrenchbed.cli import main
from wrenchbed.recording import Recording

DATA = Path(__file__).parent / "data" / "ntnu_kuka_ati_gamma"


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Path:
    """A plan, a recording and a fit of the UR5."""
    folder = tmp_path_factory.mktemp("made")
    plan, rec, fit = (str(folder / n) for n in ("plan.parquet", "rec.parquet", "fit.json"))
    assert main(["plan", "ur5", "--n", "20", "--out", plan]) == 0
    run = ["record", "--robot", "ur5", "--plan", plan, "--out", rec, "--samples", "5"]
    assert main(run) == 0
    assert main(["calibrate", rec, "--out", fit]) == 0
    return folder


def names(folder: Path) -> list[str]:
    return [p.name for p in folder.iterdir()]


def said(capfd) -> str:
    """The one line on stderr."""
    captured = capfd.readouterr()
    lines = [line for line in captured.err.splitlines() if line]
    assert len(lines) == 1, captured.err
    assert lines[0].startswith("wrenchbed: error: ")
    return lines[0]


@pytest.mark.parametrize("kind", ["robots", "sensors", "drivers"])
def test_list_names_every_plug_in(capfd, kind):
    from wrenchbed import registry

    assert main(["list", kind, "--json"]) == 0
    assert list(json.loads(capfd.readouterr().out)) == list(registry.names(kind))
    assert main(["list", kind]) == 0
    shown = capfd.readouterr().out
    assert all(n in shown for n in registry.names(kind))


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


def spoiled(made: Path, folder: Path, change) -> str:
    """A recording with one thing wrong, written without any check."""
    table = pq.read_table(made / "rec.parquet")
    columns = {n: table.column(n).to_numpy().copy() for n in table.column_names}
    raw = json.loads(table.schema.metadata[b"wrenchbed"])
    change(columns, raw)
    path = folder / "bad.parquet"
    parquet.write(path, parquet.table_of(columns, raw))
    return str(path)


def cut(columns, raw):
    for name in columns:
        columns[name] = columns[name][:0]


def degrees(columns, raw):
    for j in range(1, 7):
        columns[f"q{j}"] = np.rad2deg(columns[f"q{j}"])


BAD_RECORDINGS = {
    "NaN": (lambda c, r: c["fx"].__setitem__(3, np.nan), "column 'fx', row 3: nan"),
    "unsorted": (lambda c, r: c.update(t=c["t"][::-1].copy()), "column 't', row 1"),
    "missing column": (lambda c, r: c.pop("tz"), "column 'tz' is missing"),
    "wrong robot": (lambda c, r: r.update(robot="medrue"), "robot 'medrue': row 0"),
    "unknown robot": (lambda c, r: r.update(robot="hal"), "there is no robot 'hal' here"),
    "0 rows": (cut, "0 rows"),
    "mixed units": (degrees, "is it in degrees?"),
    "negative mass": (lambda c, r: r["tool"].update(mass=-1.0), "tool.mass = -1.0 must be above 0"),
    "negative weight": (
        lambda c, r: [c.update({k: -c[k]}) for k in ("fx", "fy", "fz", "tx", "ty", "tz")],
        "opposite sign",
    ),
}


@pytest.mark.parametrize("name", BAD_RECORDINGS)
def test_a_bad_recording_gives_one_line_and_nothing_is_written(made, tmp_path, capfd, name):
    change, words = BAD_RECORDINGS[name]
    path = spoiled(made, tmp_path, change)
    assert main(["calibrate", path, "--out", str(tmp_path / "fit.json")]) == 1
    line = said(capfd)
    assert words in line
    assert names(tmp_path) == ["bad.parquet"]


def test_a_truncated_recording_gives_one_line(made, tmp_path, capfd):
    whole = (made / "rec.parquet").read_bytes()
    (tmp_path / "bad.parquet").write_bytes(whole[: len(whole) // 2])
    arguments = ["calibrate", str(tmp_path / "bad.parquet"), "--out", str(tmp_path / "fit.json")]
    assert main(arguments) == 1
    assert "not a complete Parquet file" in said(capfd)
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
        (np.zeros((2, 6)), ["--rate", "0"], "must be above 0"),
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
        ('{"tool.mas": 1}', "did you mean 'tool.mass'"),
        ('{"dq1": 90}', "is it in degrees?"),
        ("[1]", "must be a JSON object"),
        ("{", "not valid JSON"),
        ('{"tool.inertia.xx": 5}', "is that of no body"),
    ],
)
def test_wrong_parameters_give_one_line(made, tmp_path, capfd, text, words):
    (tmp_path / "truth.json").write_text(text)
    arguments = ["record", "--robot", "ur5", "--plan", str(made / "plan.parquet")]
    arguments += [
        "--out",
        str(tmp_path / "r.parquet"),
        "--parameters",
        str(tmp_path / "truth.json"),
    ]
    assert main(arguments) == 1
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


def test_what_was_read_is_never_written_over(made, tmp_path, capfd):
    rec = tmp_path / "rec.parquet"
    rec.write_bytes((made / "rec.parquet").read_bytes())
    before = rec.read_bytes()
    assert main(["calibrate", str(rec), "--out", str(rec)]) == 1
    assert "is an input too" in said(capfd)
    assert main(["record", "--robot", "ur5", "--plan", str(rec), "--out", str(rec)]) == 1
    assert "is an input too" in said(capfd)
    out = str(tmp_path / "new.parquet")
    assert main(["record", "--robot", "ur5", "--plan", str(rec), "--out", out]) == 1
    assert "this is a recording" in said(capfd)
    assert rec.read_bytes() == before
    assert names(tmp_path) == ["rec.parquet"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["plan", "ur5", "--seed", "-1"], "seed -1 must not be negative"),
        (["plan", "ur5", "--n", "0"], "is empty"),
        (["plan", "ur5", "--motion", "multisine", "--rate", "nan"], "10 Hz or more"),
        (["plan", "ur5", "--motion", "multisine", "--seconds", "inf"], "10 Hz or more"),
    ],
)
def test_impossible_plans_give_one_line(tmp_path, capfd, arguments, words):
    assert main([*arguments, "--out", str(tmp_path / "p.parquet")]) == 1
    assert words in said(capfd)
    assert names(tmp_path) == []


def test_a_misspelt_truth_is_refused(made, tmp_path, capfd):
    (tmp_path / "truth.json").write_text('{"tool.mas": 1}')
    arguments = ["calibrate", str(made / "rec.parquet"), "--truth", str(tmp_path / "truth.json")]
    assert main(arguments) == 1
    assert "'tool.mas' = 1 is no parameter" in said(capfd)


def test_a_map_with_mixed_units_gives_one_line(tmp_path, capfd):
    text = (DATA / "static.toml").read_text().replace('"fy", unit = "N"', '"fy", unit = "lbf"')
    (tmp_path / "map.toml").write_text(text)
    file = str(DATA / "0-calibration_fts-accel.csv")
    out = str(tmp_path / "rec.parquet")
    assert main(["import", file, "--map", str(tmp_path / "map.toml"), "--out", out]) == 1
    assert "mixed units: fx in N, fy in lbf, fz in N" in said(capfd)
    assert names(tmp_path) == ["map.toml"]


def test_real_files_import_and_calibrate(tmp_path, capfd):
    out = str(tmp_path / "rec.parquet")
    file = str(DATA / "0-calibration_fts-accel.csv")
    assert main(["import", file, "--map", str(DATA / "static.toml"), "--out", out]) == 0
    assert "24 rows" in capfd.readouterr().out
    assert main(["calibrate", out]) == 0
    assert "0.9332" in capfd.readouterr().out


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
        (["medrue", "--goal", "target-position", "--points", "none.csv"], "cannot be read as CSV"),
        (["medrue", "--index", "O1", "--n", "10", "--pool", "5"], "cannot be chosen from a pool"),
        (["medrue", "--index", "O1", "--motion", "multisine"], "either poses or a motion"),
        (["medrue", "--index", "O1", "--goal", "target-position"], "chooses its own poses"),
        (["medrue", "--points", "none.csv"], "--points goes with --goal"),
        (["medrue", "--touch-cost", "2"], "--touch-cost goes with --goal"),
        (["medrue", "--pool", "200"], "--pool goes with --index or --goal"),
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
