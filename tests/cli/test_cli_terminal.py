"""Any locale, any width: help, results and errors are printed, not tracebacks."""

import json
import os
import subprocess
import sys

import pytest

from wrenchbed.cli import _GROUPS, _VERBS, console

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
    "environment",
    [LATIN, PLAIN | {"COLUMNS": "1"}, {"COLUMNS": "0"}],
    ids=["ISO-8859-1", "C, 1 column", "0 columns"],
)
def test_every_verbs_help_is_printed(environment):
    done = run(environment, "-c", HELPS.format(words=WORDS))
    assert done.returncode == 0, done.stderr[-500:]
    assert done.stdout.count("usage: wrenchbed") == len(WORDS)


@pytest.mark.sampled
@pytest.mark.parametrize("environment", [PLAIN, LATIN], ids=["C", "ISO-8859-1"])
def test_results_and_errors_are_printed(made, tmp_path, environment):
    fit = tmp_path / "fit.json"
    shown = run(environment, "-m", "wrenchbed", "calibrate", made / "rec.parquet", "--out", fit)
    assert shown.returncode == 0, shown.stderr
    assert fit.is_file()
    missing = run(environment, "-m", "wrenchbed", "calibrate", tmp_path / "päth…parquet")
    assert missing.returncode == 1 and missing.stderr.count("\n") == 1, missing.stderr


@pytest.mark.slow
def test_json_says_the_same_in_every_encoding(made):
    words = ("-m", "wrenchbed", "calibrate", made / "rec.parquet", "--json")
    plain = run(PLAIN, *words, encoding="ascii").stdout
    whole = run({"PYTHONUTF8": "1"}, *words, encoding="utf-8").stdout
    assert json.loads(plain) == json.loads(whole)


def test_a_bar_without_a_terminal_is_silent(capsys):
    with console.progress("work", 3) as report:
        report(1, "first")
    assert capsys.readouterr() == ("", "")
