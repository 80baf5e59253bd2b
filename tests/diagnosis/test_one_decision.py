"""One place makes or changes a verdict: read from the source."""

import ast
import re
from pathlib import Path

import wrenchbed
from wrenchbed.diagnosis.decision import decide
from wrenchbed.diagnosis.decision.decide import RULES

HOME = Path(wrenchbed.__file__).parent
MADE_OF = {"word", "causes", "probabilities", "keys"}
"""Fields of a verdict and of its causes that only the decision sets."""
MAKES = re.compile(r"\bVerdict\(|(?<!\.)\breplace\(")
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
    """The entries of a diagnosis follow from it: `answer` fills them in."""
    allowed = {"diagnosis/decision/decide.py", "diagnosis/answer.py"}
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
