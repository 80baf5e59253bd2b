"""The command line: the library's verbs, files in and out. Only this package prints.

What verbs there are, told without loading what they need.
"""

import ast
import signal
import sys
import textwrap
import warnings
from collections.abc import Callable, Mapping, Sequence
from difflib import get_close_matches
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from wrenchbed.errors import WrenchbedError, WrenchbedWarning

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


_VERBS = {
    "list": ("verbs", "list_"),
    "plan": ("plan", "plan"),
    "record": ("record", "record"),
    "import": ("verbs", "import_"),
    "calibrate": ("verbs", "calibrate"),
    "diagnose": ("diagnose", "diagnose"),
    "view": ("view", "view"),
    "report": ("view", "report"),
    "simulate": ("verbs", "simulate"),
    "export": ("verbs", "export"),
    "twin": ("serve", "twin"),
    "campaign": ("campaign", "campaign"),
    "study": ("verbs", "study"),
    "blind": ("blind", "blind"),
}
"""Module and function of each verb: only the one that is asked for is loaded."""
_GROUPS = ("blind",)
_KEPT = {
    "record": "; what was recorded is on disk, and on a robot `record … --resume` goes on",
    "campaign": "; what was done so far is on disk, and the same command goes on",
    "study": "; what was done so far is on disk, and the same command goes on",
    "blind": "; what was done so far is on disk, and the same command goes on",
}
"""What a verb that was stopped leaves."""


def main(arguments: list[str] | None = None) -> int:
    """Run one verb. Returns 0 done, 1 a named error (one line on stderr), 2 usage, 130 stopped."""
    words = sys.argv[1:] if arguments is None else arguments
    verbs = {verb: (f"wrenchbed.cli.{m}", f) for verb, (m, f) in _VERBS.items()}
    if not words or words[0] not in verbs:
        asked = bool(words) and words[0] in ("-h", "--help")
        if asked:
            print(usage(verbs))
            raise SystemExit(0)
        what = unknown(words[0], verbs) if words else usage(verbs)
        print(f"wrenchbed: error: {what}" if words else what, file=sys.stderr)
        raise SystemExit(2)
    return _run(words)


def _run(words: Sequence[str]) -> int:
    from rich.console import Console

    stderr = Console(stderr=True, soft_wrap=True, highlight=False)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("always", WrenchbedWarning)
            warnings.showwarning = lambda message, *_, **__: stderr.print(
                f"wrenchbed: warning: {message}", style="yellow", markup=False
            )
            _ask(words)
    except WrenchbedError as error:
        stderr.print(f"wrenchbed: error: {error}", style="red", markup=False)
        return 1
    except OSError as error:
        what = f"{error.filename}: {error.strerror}" if error.filename else str(error)
        stderr.print(f"wrenchbed: error: {what}", style="red", markup=False)
        return 1
    except KeyboardInterrupt:
        stderr.print(f"wrenchbed: stopped{_KEPT.get(words[0], '')}", markup=False)
        return 130
    return 0


def _ask(words: Sequence[str]) -> None:
    """Let a verb read its options and work."""
    import tyro

    verb, rest = words[0], list(words[1:])
    module, function = _VERBS[verb]
    home = import_module(f"wrenchbed.cli.{module}")
    own: Callable[..., Any] = getattr(home, function)
    if verb in _GROUPS:
        tyro.extras.subcommand_cli_from_dict(
            home.VERBS, prog=f"wrenchbed {verb}", description=own.__doc__, args=rest
        )
        return
    tyro.cli(own, prog=f"wrenchbed {verb}", args=rest)


def run() -> None:
    """Entry point of the console script; being told to end is like Ctrl-C."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    sys.exit(main())
