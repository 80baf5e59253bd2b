"""What scripts import from the package exists."""

import ast
from importlib import import_module
from pathlib import Path

import pytest

SCRIPTS = [
    p
    for p in sorted((Path(__file__).parents[2] / "scripts").iterdir())
    if p.is_file() and (p.suffix == ".py" or p.read_bytes().startswith(b"#!/usr/bin/env python3"))
]


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda p: p.name)
def test_imported_names_exist(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("wrenchbed"):
            module = import_module(node.module)
            for alias in node.names:
                if not hasattr(module, alias.name):
                    import_module(f"{node.module}.{alias.name}")
