"""Scripts: what they import exists; a slower job is noticed."""

import ast
import importlib.util
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


def loaded(name):
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


def test_the_table_names_files_that_exist():
    root = SCRIPTS.parent
    table = tomllib.loads((SCRIPTS / "mutate.toml").read_text(encoding="utf-8"))
    for group in table["group"].values():
        for pattern in (*group["modules"], *group["tests"]):
            assert any(root.glob(pattern)), pattern
