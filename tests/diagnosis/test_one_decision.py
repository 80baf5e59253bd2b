"""The room's shape, read from its source: one place decides, folders import downwards only."""

import ast
import re
from pathlib import Path

import pytest

import wrenchbed
from wrenchbed.diagnosis.decision import decide
from wrenchbed.diagnosis.decision.decide import RULES

HOME = Path(wrenchbed.__file__).parent
MADE_OF = {"word", "causes", "probabilities", "keys"}
"""Fields of a verdict and of its causes that only the decision sets."""
MAKES = re.compile(r"\bVerdict\(|\b(?:word|causes|probabilities|keys)=")
MOST_RULES, MOST_LINES = 12, 400


def makers(source):
    """Lines that make a verdict, or change one or its causes."""
    lines = []
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.Call):
            continue
        name = getattr(node.func, "id", getattr(node.func, "attr", ""))
        changes = {k.arg for k in node.keywords} & MADE_OF if name == "replace" else set()
        if name == "Verdict" or changes:
            lines.append(node.lineno)
    return lines


def test_a_maker_is_seen():
    assert makers("v = Verdict('none', (), None, {})\nw = replace(v, word='unknown')") == [1, 2]
    assert makers("w = replace(d, notes=())\nx = word(v)") == []


def test_only_the_decision_makes_or_changes_a_verdict():
    """The entries of a diagnosis follow from it: `json_entries` fills them in."""
    allowed = {"diagnosis/decision/decide.py", "diagnosis/json_entries.py"}
    found = {
        path.relative_to(HOME).as_posix(): lines
        for path in sorted(HOME.rglob("*.py"))
        if MAKES.search(text := path.read_text(encoding="utf-8")) and (lines := makers(text))
    }
    assert {name: lines for name, lines in found.items() if name not in allowed} == {}


def test_the_decision_is_a_page_with_few_rules():
    assert len(RULES) + 1 <= MOST_RULES  # with that of rivals
    assert len(Path(decide.__file__).read_text(encoding="utf-8").splitlines()) <= MOST_LINES
    assert all(rule.__doc__ for rule in RULES.values())


ABOVE = {
    "prepare": set(),
    "evidence": {"prepare"},
    "explain": {"prepare", "evidence"},
    "gap": {"prepare", "evidence", "explain", "next"},
    "decision": {"prepare", "evidence", "explain", "gap"},
    "efforts": {*"prepare evidence explain gap decision next json_entries result".split()},
    "between_rows": {"prepare"},
    "next": {"prepare", "evidence", "explain"},
}
"""What each folder may import of the others."""


@pytest.mark.parametrize("folder", ABOVE)
def test_a_folder_imports_only_what_is_below_it(folder):
    prefix = "wrenchbed.diagnosis."
    for path in (HOME / "diagnosis" / folder).glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(prefix):
                other = node.module.removeprefix(prefix).split(".")[0]
                assert other == folder or other in ABOVE[folder], f"{path.name}: {node.module}"


def test_every_folder_is_listed():
    assert {p.parent.name for p in HOME.glob("diagnosis/*/__init__.py")} == set(ABOVE)
