"""Every number has a name, a unit and a source, or a reason for its size."""

import ast
import re
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[2] / "src" / "wrenchbed"
ROOMS = ("physics", "effects", "benchmark/lookalikes", "benchmark/referee", "benchmark/efforts",
         "hardware/drivers")  # fmt: skip
FILES = sorted(f for room in ROOMS for f in (SOURCE / room).rglob("*.py"))
SOURCED = [f for f in FILES if "drivers" not in f.parts]
"""Files whose numbers name a source. Drivers give reasons, which no test can judge."""
TRIVIAL = {0.0, 0.5, 1.0, 2.0, 3.0, 4.0, 6.0, 10.0}
"""Numbers of formulas: identities, halves, dimensions and axes."""
ROUNDING = 1e-6
"""Smaller ones guard against division by zero."""
ORIGIN = re.compile(
    r"estimate|doi|10\.\d{4,}/|\bISO\b|\bIEC\b|\bCiA\b|data sheet|manual|\bEq|\bsection \d|\bRFC\b"
    r"|measured|tuned on|source:|specification|by definition|(19|20)\d\d",
    re.IGNORECASE,
)
"""Words by which a docstring or a comment names where a number comes from."""
REASON = 8
"""Words from which a constant's own docstring can give a reason for its size."""


def literals(node):
    """Numbers in an expression or a body that are not part of plain formulas or indices."""
    found = []
    todo = list(ast.iter_child_nodes(node))
    while todo:
        child = todo.pop()
        if isinstance(child, ast.Subscript):
            todo.append(child.value)
            continue
        if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            continue
        if isinstance(child, ast.Constant) and type(child.value) in (int, float):
            value = abs(child.value)
            if (
                value not in TRIVIAL
                and value > ROUNDING
                and not (isinstance(child.value, int) and value <= 16)
            ):
                found.append(child)
        todo += ast.iter_child_nodes(child)
    return found


def explained(tree, lines):
    """(owner's name, line, texts that may name the source) of each scope that holds numbers."""
    module = ast.get_docstring(tree) or ""

    def scopes(body, texts, where):
        for k, node in enumerate(body):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                own = [*texts, ast.get_docstring(node) or ""]
                yield node.name, node, [*own, comments(node)]
                yield from scopes(
                    [n for n in ast.walk(node) if isinstance(n, ast.FunctionDef) and n is not node],
                    own, node.name,
                )  # fmt: skip
            elif isinstance(node, ast.ClassDef):
                yield from scopes(node.body, [*texts, *declared(node)], node.name)
            elif isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None:
                after = body[k + 1] if k + 1 < len(body) else None
                text = ""
                if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant):
                    text = str(after.value.value)
                yield where, node, [*texts, text, comments(node)]

    def declared(node):
        """The docstring of a class, and the ``source`` that it declares of its numbers."""
        yield ast.get_docstring(node) or ""
        for item in node.body:
            if isinstance(item, ast.Assign) and ast.unparse(item.targets[0]) == "source":
                yield str(ast.literal_eval(item.value))

    def comments(node):
        return " ".join(line.partition("#")[2] for line in lines[node.lineno - 1 : node.end_lineno])

    yield from scopes(tree.body, [module], "module")


@pytest.mark.parametrize("path", SOURCED, ids=lambda p: str(p.relative_to(SOURCE)))
def test_numbers_name_their_source(path):
    text = path.read_text(encoding="utf-8")
    bare = [
        f"{path.name}:{node.lineno} {name}: {', '.join(ast.unparse(n) for n in numbers[:4])}"
        for name, node, texts in explained(ast.parse(text), text.splitlines())
        if (numbers := literals(node)) and not any(ORIGIN.search(t) for t in texts)
        if isinstance(node, ast.FunctionDef) or len(texts[-2].split()) < REASON
    ]
    assert not bare, "say where these come from, or why they are so large:\n" + "\n".join(bare)


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(SOURCE)))
def test_constants_are_explained(path):
    body = ast.parse(path.read_text(encoding="utf-8")).body
    lines = path.read_text(encoding="utf-8").splitlines()
    bare = []
    for k, node in enumerate(body):
        if not isinstance(node, ast.Assign) or not literals(node):
            continue
        after = body[k + 1] if k + 1 < len(body) else None
        said = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
        if not said and "#" not in " ".join(lines[node.lineno - 1 : node.end_lineno]):
            bare.append(f"{path.name}:{node.lineno} {ast.unparse(node)[:60]}")
    assert not bare, "say what these are, in which unit:\n" + "\n".join(bare)
