"""scripts/mutate on a small module: what a weak test overlooks survives, what it checks dies."""

import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

SCRIPTS = Path(__file__).parents[2] / "scripts"
MODULE = '''"""A small module."""

LIMIT = 0.75


def likely(p: float) -> bool:
    """Whether it counts."""
    if p < 0:
        raise ValueError("a probability is not negative")
    return p >= LIMIT


def never() -> int:
    return 3 + 4
'''
TESTS = """from tiny import likely


def test_sure_things_count():
    assert likely(1.0)
    assert not likely(0.0)
"""
TABLE = """[group.tiny]
modules = ["src/tiny.py"]
tests = ["tests/test_tiny.py"]
"""


@pytest.fixture
def tree(tmp_path):
    files = {"src/tiny.py": MODULE, "tests/test_tiny.py": TESTS, "scripts/mutate.toml": TABLE}
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path


def mutate(tree: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    table = tree / "scripts" / "mutate.toml"
    command = [sys.executable, str(SCRIPTS / "mutate"), "--table", str(table), *arguments]
    environment = {k: v for k, v in os.environ.items() if not k.startswith("COV")}
    return subprocess.run(command, capture_output=True, text=True, check=True, env=environment)


def outcomes(tree: Path) -> dict[str, str]:
    listed = mutate(tree, "--list").stdout
    after = dict(re.findall(r"^(\w+)  .*\n    -.*\n    \+ *(.*)$", listed, re.MULTILINE))
    journal = (tree / ".cache" / "mutate" / "journal.jsonl").read_text().splitlines()
    return {after[e["id"]]: e["outcome"] for e in map(json.loads, journal)}


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="mutants are forks")
def test_what_a_weak_test_overlooks_survives_and_what_it_checks_dies(tree):
    found = mutate(tree)
    told = outcomes(tree)
    assert told["return p < LIMIT"] == "killed"
    assert told["LIMIT = 2.25"] == "killed"
    assert told["LIMIT = 0.25"] == "survived"
    assert told["pass"] == "not reached"
    assert told["return 3 - 4"] == "not reached"
    assert "+LIMIT = 0.25" in found.stdout and "src/tiny.py:3" in found.stdout
    assert not any("negative" in text and "pass" not in text for text in told)  # no message
    assert (tree / "src" / "tiny.py").read_text() == MODULE
    # nothing is judged twice, and a better test is tried on what survived
    again = mutate(tree)
    assert again.stdout == found.stdout
    (tree / "tests" / "test_tiny.py").write_text(TESTS + "    assert not likely(0.5)\n")
    mutate(tree)
    assert outcomes(tree)["LIMIT = 0.25"] == "killed"


def test_a_table_that_names_no_file_is_refused(tree):
    table = tree / "scripts" / "mutate.toml"
    table.write_text(TABLE.replace("src/tiny.py", "src/teeny.py"))
    with pytest.raises(subprocess.CalledProcessError) as caught:
        mutate(tree, "--list")
    assert "the table names src/teeny.py: there is no such file" in caught.value.stderr


def test_the_table_names_files_that_exist():
    root = SCRIPTS.parent
    table = tomllib.loads((SCRIPTS / "mutate.toml").read_text(encoding="utf-8"))
    for group in table["group"].values():
        for pattern in (*group["modules"], *group["tests"]):
            assert any(root.glob(pattern)), pattern
