"""How the command line starts: help, words that are no verbs, and nothing heavy loaded."""

import subprocess
import sys
from importlib.metadata import version

import pytest

from wrenchbed.cli import main


def test_usage_errors_exit_with_2(capfd):
    for arguments in (
        [],
        ["fly"],
        ["plan", "ur5"],
        ["list", "planets"],
        ["plan", "ur5", "--x", "1"],
    ):
        with pytest.raises(SystemExit) as caught:
            main(arguments)
        assert caught.value.code == 2, arguments


def test_help_names_every_verb(capfd):
    with pytest.raises(SystemExit) as caught:
        main(["--help"])
    assert caught.value.code == 0
    out = capfd.readouterr().out
    for verb in ("list", "plan", "record", "import", "calibrate", "campaign", "blind"):
        assert f"\n  {verb} " in out
    assert max(map(len, out.splitlines())) <= 80
    assert "Identify a robot's parameters: value ± standard uncertainty" in out


def test_a_verb_that_is_not_there_is_met_with_the_nearest(capfd):
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


def test_the_version_is_printed(capfd):
    with pytest.raises(SystemExit) as caught:
        main(["--version"])
    assert not caught.value.code
    assert capfd.readouterr().out == f"wrenchbed {version('wrenchbed')}\n"


@pytest.mark.parametrize("epoch", ["yesterday", "-1", "9" * 20, ""])
def test_a_date_of_builds_that_is_none_is_refused_in_one_line(epoch, monkeypatch, capsys):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", epoch)
    assert main(["list", "robots"]) == 1
    assert "must be whole seconds since 1970" in capsys.readouterr().err
