"""The command line: the library's verbs, files in and out. Only this package prints."""

import signal
import sys
import warnings
from collections.abc import Callable
from typing import Any

import tyro
from rich.console import Console

from wrenchbed.cli import blind, serve, study, twin, verbs
from wrenchbed.cli.diagnose import diagnose
from wrenchbed.cli.fleet import campaign
from wrenchbed.cli.plan import plan
from wrenchbed.cli.record import record
from wrenchbed.cli.view import report, view
from wrenchbed.errors import WrenchbedError, WrenchbedWarning

_VERBS: dict[str, Callable[..., Any]] = {
    "list": verbs.list_,
    "plan": plan,
    "record": record,
    "import": verbs.import_,
    "calibrate": verbs.calibrate,
    "diagnose": diagnose,
    "view": view,
    "report": report,
    "simulate": twin.simulate,
    "export": twin.export,
    "twin": serve.twin,
    "campaign": campaign,
    "study": study.study,
    "blind": blind.blind,
}
_GROUPS: dict[str, dict[str, Callable[..., Any]]] = {"blind": blind.VERBS}
_KEPT = {
    "record": "; what was recorded is on disk, and on a robot `record … --resume` goes on",
    "campaign": "; what was done so far is on disk, and the same command goes on",
    "study": "; what was done so far is on disk, and the same command goes on",
    "blind": "; what was done so far is on disk, and the same command goes on",
}
"""What a verb that was stopped leaves."""


def main(arguments: list[str] | None = None) -> int:
    """Run one verb. Returns 0 done, 1 a named error (one line on stderr), 2 usage, 130 stopped."""
    stderr = Console(stderr=True, soft_wrap=True, highlight=False)
    words = sys.argv[1:] if arguments is None else arguments
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("always", WrenchbedWarning)
            warnings.showwarning = lambda message, *_, **__: stderr.print(
                f"wrenchbed: warning: {message}", style="yellow", markup=False
            )
            group = words[0] if words and words[0] in _GROUPS else None
            tyro.extras.subcommand_cli_from_dict(
                _VERBS if group is None else _GROUPS[group],
                prog="wrenchbed" if group is None else f"wrenchbed {group}",
                description="Testbed for force-sensing robots: plan, record, calibrate, diagnose."
                if group is None
                else _VERBS[group].__doc__,
                args=words if group is None else words[1:],
            )
    except WrenchbedError as error:
        stderr.print(f"wrenchbed: error: {error}", style="red", markup=False)
        return 1
    except OSError as error:
        what = f"{error.filename}: {error.strerror}" if error.filename else str(error)
        stderr.print(f"wrenchbed: error: {what}", style="red", markup=False)
        return 1
    except KeyboardInterrupt:
        kept = _KEPT.get(words[0], "") if words else ""
        stderr.print(f"wrenchbed: stopped{kept}", markup=False)
        return 130
    return 0


def run() -> None:
    """Entry point of the console script; being told to end is like Ctrl-C."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    sys.exit(main())
