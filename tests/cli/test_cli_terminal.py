"""Any locale, any width: help, results and errors are printed, not tracebacks."""

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
    assert shown.returncode == 0 and shown.stderr.count("\n") == 1, shown.stderr
    assert fit.is_file()


def test_a_bar_without_a_terminal_is_silent(capsys):
    with console.progress("work", 3) as report:
        report(1, "first")
    assert capsys.readouterr() == ("", "")
