"""What verbs there are, told without loading what they need."""

import ast
import textwrap
from collections.abc import Mapping
from difflib import get_close_matches
from importlib.util import find_spec
from pathlib import Path

_WIDTH = 80


def usage(verbs: Mapping[str, tuple[str, str]]) -> str:
    """Every verb with the first paragraph of what it says of itself, in 80 columns."""
    room = max(map(len, verbs)) + 4
    lines = [
        "usage: wrenchbed VERB …", "",
        "Testbed for force-sensing robots: plan, record, calibrate, diagnose.", "",
    ]  # fmt: skip
    for verb, (module, function) in verbs.items():
        text = " ".join(_said(module, function).split())
        told = textwrap.wrap(text, _WIDTH - room)
        lines += [f"  {verb:{room - 2}}{told[0]}", *(" " * room + line for line in told[1:])]
    lines += ["", "wrenchbed VERB --help tells more of each."]
    return "\n".join(lines)


def unknown(word: str, verbs: Mapping[str, tuple[str, str]]) -> str:
    """What is wrong with a word that is no verb."""
    close = get_close_matches(word, verbs, 1)
    hint = f"; did you mean {close[0]}?" if close else "."
    return f"there is no verb {word!r}{hint} Known: {', '.join(verbs)}"


def _said(module: str, function: str) -> str:
    """First paragraph of a function's docstring, read from its source."""
    spec = find_spec(module)
    assert spec is not None and spec.origin is not None  # the verb's own module
    tree = ast.parse(Path(spec.origin).read_text(encoding="utf-8"))
    own = next(n for n in tree.body if isinstance(n, ast.FunctionDef) and n.name == function)
    return (ast.get_docstring(own) or "").partition("\n\n")[0]
