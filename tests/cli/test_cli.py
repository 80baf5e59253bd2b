"""The command line: usage, exit codes, one clear line a mistake, options, a terminal or none."""

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from importlib.metadata import version

import pytest

import wrenchbed as wb
from wrenchbed.cli import _GROUPS, _VERBS, console, main
from wrenchbed.errors import ParameterError
from wrenchbed.robots.checked_moves import Limits


@pytest.mark.parametrize("kind", ["robots", "sensors", "drivers", "effects"])
def test_list_names_every_plug_in(capfd, kind):
    faults = wb.SimDriver.drive_faults() if kind == "effects" else ()
    known = list(dict.fromkeys([*wb.names(kind), *faults]))  # of two a joint's own sensor has
    assert main(["list", kind, "--json"]) == 0
    assert list(json.loads(capfd.readouterr().out)) == known
    assert main(["list", kind]) == 0
    shown = capfd.readouterr().out
    assert all(n in shown for n in known) and max(map(len, shown.splitlines())) <= 80


def test_list_names_every_check_of_a_recording(capfd):
    assert main(["list", "checks", "--json"]) == 0
    told = json.loads(capfd.readouterr().out)
    assert told["dead channel"] and len(told) == 23 and all(told.values())


def test_results_are_json_on_demand_or_a_table_of_eighty_columns(made, capfd, tmp_path):
    out = str(tmp_path / "p.parquet")
    assert main(["plan", "medrue", "--n", "3", "--out", out, "--json"]) == 0
    assert json.loads(capfd.readouterr().out)["rows"] == 3
    assert main(["calibrate", str(made / "rec.parquet"), "--json"]) == 0
    fit = json.loads(capfd.readouterr().out)
    assert fit["parameters"]["tool.mass"]["unit"] == "kg"
    assert fit == json.loads((made / "fit.json").read_text())
    assert main(["calibrate", str(made / "rec.parquet")]) == 0
    out = capfd.readouterr().out
    assert max(map(len, out.splitlines())) <= 80 and "\x1b[" not in out  # no colours when piped
    assert "tool.mass" in out and "what this data cannot tell" in out


def test_the_truth_stands_beside_the_estimates(made, capfd, tmp_path):
    (tmp_path / "truth.json").write_text('{"tool.mass": 1.35}')
    arguments = ["calibrate", str(made / "rec.parquet"), "--truth", str(tmp_path / "truth.json")]
    assert main(arguments) == 0
    (line,) = [x for x in capfd.readouterr().out.splitlines() if x.startswith("tool.mass")]
    value, off = line.split()[5:7]
    assert value == "1.35" and abs(float(off)) < 5 and line.rstrip().endswith("σ")


@pytest.mark.parametrize("written", [False, True])
@pytest.mark.parametrize("resume", [False, True])
@pytest.mark.parametrize("live", [False, True])
def test_a_stopped_recording_says_what_is_there(
    tmp_path, capfd, monkeypatch, written, resume, live
):
    """Before the first row there is nothing with which `--resume` could go on."""
    plan, out = tmp_path / "plan.parquet", tmp_path / "rec.parquet"
    assert main(["plan", "ur5", "--n", "3", "--out", str(plan)]) == 0
    words = ["record", "--robot", "ur5", "--plan", str(plan), "--out", str(out)]
    if resume:
        assert main([*words, "--samples", "5"]) == 0

    def stopped(*_, **__):
        if written:
            out.write_bytes(b"rows")
        raise KeyboardInterrupt

    monkeypatch.setattr("wrenchbed.record", stopped)
    monkeypatch.setattr("wrenchbed.SimDriver.live", live)
    capfd.readouterr()
    assert main([*words, *(["--resume"] * resume)]) == 130
    said = capfd.readouterr().err
    assert ("what was recorded is on disk" in said) == written
    assert ("--resume" in said) == (live and (written or resume))


@pytest.mark.parametrize("line", ["", "fly", "plan ur5", "list planets", "plan ur5 --x 1"])
def test_usage_errors_exit_with_2(line):
    with pytest.raises(SystemExit, match="^2$"):
        main(line.split())


def test_help_names_every_verb_and_the_nearest_to_one_that_is_not_there(capfd):
    with pytest.raises(SystemExit, match="^0$"):
        main(["--help"])
    out = capfd.readouterr().out
    for verb in ("list", "plan", "record", "import", "calibrate", "campaign", "blind"):
        assert f"\n  {verb} " in out
    assert max(map(len, out.splitlines())) <= 80
    assert "Identify a robot's parameters: value ± standard uncertainty" in out
    with pytest.raises(SystemExit):
        main(["--version"])
    assert capfd.readouterr().out == f"wrenchbed {version('wrenchbed')}\n"
    with pytest.raises(SystemExit):
        main(["callibrate"])
    assert "did you mean 'calibrate'?" in capfd.readouterr().err


HEAVY = ("rerun", "rtde_control", "can", "canopen", "matplotlib", "mujoco", "scipy", "pyarrow",
         "gymnasium", "rosbags", "mcap", "tyro", "pinocchio")  # fmt: skip


@pytest.mark.parametrize(
    "how, heavy",
    [
        ("import wrenchbed", HEAVY),
        ("from wrenchbed.cli import main; main(['-h'])", HEAVY),
        ("import wrenchbed.reports.diagnosis_page", ("scipy.signal", "scipy.stats", "gymnasium")),
    ],
)
def test_nothing_heavy_is_loaded_before_it_is_used(how, heavy):
    code = f"import sys\ntry:\n    {how}\nexcept SystemExit:\n    pass\n"
    code += f"print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


@pytest.mark.parametrize("epoch", ["yesterday", "-1", "9" * 20, ""])
def test_a_date_of_builds_that_is_none_is_refused_in_one_line(epoch, monkeypatch, capsys):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", epoch)
    assert main(["list", "robots"]) == 1
    assert "must be whole seconds since 1970" in capsys.readouterr().err


PLAIN = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
LATIN = {"PYTHONIOENCODING": "iso-8859-1"}
WORDS = [[], *([verb] for verb in _VERBS), *([g, v] for g in _GROUPS for v in ("make", "score"))]
HELPS = """
import sys
from wrenchbed.cli import main, prepare
prepare()
for words in {words}:
    try:
        main([*words, "--help"])
    except SystemExit as end:
        assert not end.code, words
"""


def run(environment: dict[str, str], *words: object, encoding: str = "latin-1"):
    return subprocess.run(
        [sys.executable, *map(str, words)], env=os.environ | environment, capture_output=True,
        text=True, encoding=encoding, check=False, timeout=60.0,
    )  # fmt: skip


@pytest.mark.sampled
@pytest.mark.parametrize(
    ("environment", "words"),
    [
        (LATIN, WORDS[:3]),
        (LATIN, WORDS),
        (PLAIN | {"COLUMNS": "1"}, WORDS),
        ({"COLUMNS": "0"}, WORDS),
    ],
    ids=["some in ISO-8859-1", "ISO-8859-1", "C, 1 column", "0 columns"],
)
def test_every_verbs_help_is_printed(environment, words):
    done = run(environment, "-c", HELPS.format(words=words))
    assert done.returncode == 0, done.stderr[-500:]
    assert done.stdout.count("usage: wrenchbed") == len(words)


@pytest.mark.sampled
@pytest.mark.parametrize("environment", [PLAIN, LATIN], ids=["C", "ISO-8859-1"])
def test_results_and_errors_are_printed(made, tmp_path, environment):
    fit, missing = tmp_path / "fit.json", tmp_path / "päth…parquet"
    both = (
        "from wrenchbed.cli import main, prepare; prepare();"
        f"assert main(['calibrate', {str(made / 'rec.parquet')!r}, '--out', {str(fit)!r}]) == 0;"
        f"assert main(['calibrate', {str(missing)!a}]) == 1"
    )
    shown = run(environment, "-c", both)
    assert shown.returncode == 0 and shown.stderr.count("\n") == 1 and fit.is_file(), shown.stderr


@pytest.mark.parametrize("words", [["--help"], ["list", "checks"], ["record", "--help"]])
def test_output_that_nobody_reads_ends_the_program_quietly(words):
    read, write = os.pipe()
    os.close(read)
    line = [sys.executable, "-m", "wrenchbed", *words]
    done = subprocess.run(line, stdout=write, stderr=subprocess.PIPE, env=os.environ, check=False)
    os.close(write)
    assert done.returncode and not done.stderr


@dataclass
class Device:
    robot: str = "ur5"
    limits: Limits | None = None
    rate: float | None = 125.0
    nodes: tuple[int, ...] = (1, 2)
    counts: tuple[float, ...] = (1.0,)
    tries: int = 5
    torque: bool = False
    channel: str = "can0"


def test_words_become_what_the_options_hold():
    words = console.pairs(
        ("rate=none", "nodes=0x10,17", "counts=1e6,2.5", "tries=7", "torque=on", "channel=a=b")
    )
    assert console.typed(Device, words, ("robot",)) == {
        "rate": None, "nodes": (16, 17), "counts": (1e6, 2.5), "tries": 7, "torque": True,
        "channel": "a=b",
    }  # fmt: skip
    assert console.typed(Device, {"rate": "500"}, ()) == {"rate": 500.0}


@pytest.mark.parametrize(
    ("word", "why"),
    [
        ("rate=fast", "rate=fast: must be a number or none"),
        ("nodes=1,x", "a whole number, or several with commas"),
        ("tries=1.5", "must be a whole number"),
        ("torque=yes", "must be on or off"),
        ("robot=ur5", "no such setting. Known: rate, nodes, counts, tries, torque, channel"),
        ("limits=1", "no such setting"),
        ("tries", "give NAME=VALUE"),
        ("=5", "give NAME=VALUE"),
    ],
)
def test_other_words_are_refused(word, why):
    with pytest.raises(ParameterError, match=why):
        console.typed(Device, console.pairs((word,)), ("robot",))


SWALLOWED = """
import signal, sys, time
from wrenchbed import cli
class Deleted:
    def __del__(self):
        signal.raise_signal(signal.SIGTERM)
def verb(words):
    Deleted()
    time.sleep(0.5)
    return 0
cli._run, sys.argv = verb, ["wrenchbed", "list"]
cli.run()
"""
IN_AN_IMPORT = """
import sys
from wrenchbed import cli
def verb(*_):
    try:
        raise KeyboardInterrupt
    except KeyboardInterrupt as cause:
        raise ImportError("initialization failed") from cause
cli._call, sys.argv = verb, ["wrenchbed", "list"]
cli.run()
"""
IN_CTYPES = IN_AN_IMPORT.replace("cause", "_").replace(
    "raise ImportError", "pass\n    raise ValueError('argument 1: KeyboardInterrupt') #"
)


@pytest.mark.parametrize("code", [SWALLOWED, IN_AN_IMPORT, IN_CTYPES])
def test_no_interrupt_is_lost_or_printed_as_an_error(code):
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (130, "wrenchbed: stopped\n")
