"""Folders of the diagnosis import downwards only."""

import ast
from pathlib import Path

import pytest

import wrenchbed.diagnosis

HOME = Path(wrenchbed.diagnosis.__file__).parent
ABOVE = {
    "prepare": set(),
    "evidence": {"prepare"},
    "explain": {"prepare", "evidence"},
    "gap": {"prepare", "evidence", "explain", "next"},
    "decision": {"prepare", "evidence", "explain", "gap"},
    "efforts": {"prepare", "evidence", "explain", "gap", "decision", "next", "answer"},
    "between_rows": {"prepare"},
    "next": {"prepare", "evidence", "explain"},
}
"""What each folder may import of the others."""


@pytest.mark.parametrize("folder", ABOVE)
def test_a_folder_imports_only_what_is_below_it(folder):
    prefix = "wrenchbed.diagnosis."
    for path in (HOME / folder).glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(prefix):
                other = node.module.removeprefix(prefix).split(".")[0]
                assert other == folder or other in ABOVE[folder], f"{path.name}: {node.module}"


def test_every_folder_is_listed():
    assert {p.parent.name for p in HOME.glob("*/__init__.py")} == set(ABOVE)
