"""Scripts: what they import exists; a slower job is noticed; mutants that a weak test overlooks."""

import ast
import importlib.util
import json
import os
import re
import subprocess
import sys
import tomllib
from importlib import import_module
from importlib.machinery import SourceFileLoader
from pathlib import Path

import pytest

SCRIPTS = Path(__file__).parents[2] / "scripts"
IN_PYTHON = [
    p
    for p in sorted(SCRIPTS.iterdir())
    if p.is_file() and (p.suffix == ".py" or p.read_bytes().startswith(b"#!/usr/bin/env python3"))
]
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


def loaded(name):
    """A script as a module."""
    loader = SourceFileLoader(name, str(SCRIPTS / name))
    module = importlib.util.module_from_spec(importlib.util.spec_from_loader(name, loader))
    loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def bench():
    return loaded("bench_ratios.py")


def test_the_page_of_the_effects_is_the_rendered_one():
    page = loaded("effects")
    assert page.PAGE.read_text(encoding="utf-8") == page.render(), "run scripts/effects"


@pytest.mark.parametrize("path", IN_PYTHON, ids=lambda p: p.name)
def test_imported_names_exist(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("wrenchbed"):
            module = import_module(node.module)
            for alias in node.names:
                if not hasattr(module, alias.name):
                    import_module(f"{node.module}.{alias.name}")


def test_the_last_three_runs_on_such_a_processor_count(bench):
    def recorded(cpu, *runs):
        entries = [{"machine": {"cpu": c}, "ratios": {"a": ratio}} for ratio, c in runs]
        return bench.recorded(entries, cpu)

    runs = [(2.5, "x"), (3.3, "x"), (2.8, "x"), (70.0, "y"), (3.0, "x")]
    assert recorded("x", *runs) == {"a": 3.0}
    assert recorded("y", *runs) == {"a": 70.0}
    assert recorded("z", *runs) == {}
    assert recorded("x", *runs, (1.0, "x")) == {"a": 1.0}  # after a gain, and after a loss
    assert recorded("x", *runs, (9.0, "x")) == {"a": 9.0}


def test_the_page_is_that_of_the_history(bench):
    entries = bench.history()
    assert bench.PAGE.read_text(encoding="utf-8") == bench.page(entries)


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
