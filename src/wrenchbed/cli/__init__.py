"""The command line: the library's verbs, files in and out. Only this package prints."""

import signal
import sys
import warnings
from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any

from wrenchbed.errors import WrenchbedError, WrenchbedWarning

_VERBS = {
    "list": ("verbs", "list_"),
    "plan": ("plan", "plan"),
    "record": ("record", "record"),
    "import": ("verbs", "import_"),
    "calibrate": ("verbs", "calibrate"),
    "diagnose": ("diagnose", "diagnose"),
    "view": ("view", "view"),
    "report": ("view", "report"),
    "simulate": ("twin", "simulate"),
    "export": ("twin", "export"),
    "twin": ("serve", "twin"),
    "campaign": ("fleet", "campaign"),
    "study": ("study", "study"),
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
        from wrenchbed.cli import overview

        asked = bool(words) and words[0] in ("-h", "--help")
        if asked:
            print(overview.usage(verbs))
            raise SystemExit(0)
        what = overview.unknown(words[0], verbs) if words else overview.usage(verbs)
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
