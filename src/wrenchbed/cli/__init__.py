"""The command line: every verb is a function of the library with files in and out.
Free: the inside of each file (tables and their layout); tests/cli speak.
Others rely on: verbs, options, exit codes and JSON: public, change docs/contracts.md with them;
docstrings of verbs and comments of options: run `scripts/command_line`, which writes
docs/reference/command-line.md of them; texts of errors: run `scripts/messages`.
Never: compute; a verb calls the library and prints what it returns, and only this room prints.
Read first: this file, then `console`; each verb's module is loaded when it is called.
Before libraries are loaded, memory and terminal are checked: libraries of linear algebra hang, or
end the process, where the address space is too small for them."""

import ast
import atexit
import io
import os
import resource
import select
import shutil
import signal
import sys
import textwrap
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, redirect_stderr
from functools import partial, wraps
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from wrenchbed.errors import (
    OBEYED,
    ParameterError,
    ShortageError,
    WrenchbedError,
    WrenchbedWarning,
    did_you_mean,
    one_line,
    printable,
    shortage,
)

_VERBS = {
    "list": ("small_verbs", "list_"),
    "robot": ("robot_sensor_twin", "robot"),
    "sensor": ("robot_sensor_twin", "sensor"),
    "plan": ("plan", "plan"),
    "record": ("record", "record"),
    "import": ("exchange", "import_"),
    "calibrate": ("calibrate", "calibrate"),
    "diagnose": ("diagnose", "diagnose"),
    "view": ("small_verbs", "view"),
    "report": ("small_verbs", "report"),
    "simulate": ("small_verbs", "simulate"),
    "export": ("exchange", "export"),
    "check": ("monitoring", "check"),
    "compare": ("small_verbs", "compare"),
    "live": ("monitoring", "live_"),
    "doctor": ("small_verbs", "doctor_"),
    "twin": ("robot_sensor_twin", "twin"),
    "campaign": ("small_verbs", "campaign"),
    "study": ("small_verbs", "study"),
    "blind": ("blind", "blind"),
}
"""Verb → module of this package and name of its function."""
_GROUPS = ("blind",)
"""Verbs that consist of other verbs."""
_GOES_ON = ("campaign", "study", "blind")
"""Verbs that continue stopped work when the same command is given again."""
_COLUMNS = 80
_GB = 1e9
_LEAST = 1.2e9
"""Address space below which libraries fail to load or hang [bytes]; measured on two cores."""
_LEAST_DRAWN = 4.5e9
"""Least address space of verbs that load rerun, which reserves much and uses little [bytes]."""
_DRAWN = ("diagnose", "view")
_STOPPED = 130
"""Exit code of a program that Ctrl-C or SIGTERM stopped, as a shell has it."""
_AGAIN_S = 0.05
"""Delay after which an interrupt swallowed in a callback is raised again [s]."""
_LEAST_COLUMNS = 40
"""Least width of the output [characters]; in a narrower one tyro 1.0 never ends to print help."""


def run() -> None:
    """Entry point of the program `wrenchbed`: run `main` and exit; SIGTERM acts like Ctrl-C."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    sys.unraisablehook = _raise_again
    prepare()
    try:
        code = main()
        sys.stdout.flush()
    except BrokenPipeError:
        if not _unread():
            raise
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # drops what is buffered
        code = 128 + signal.SIGPIPE
    if code == _STOPPED:
        _leave()
    sys.exit(code)


def _leave() -> None:
    """End a stopped program without CPython's finalization, in which threads of libraries that were
    stopped midway may abort it; what is registered to run at exit still runs."""
    try:
        atexit._run_exitfuncs()
        sys.stderr.flush()
    finally:
        os._exit(_STOPPED)


def _unread() -> bool:
    """Whether nobody reads standard output any more, as after ``| head -1``."""
    reader = select.poll()
    reader.register(sys.stdout.fileno(), 0)
    return any(event & select.POLLERR for _, event in reader.poll(0))


def _raise_again(unraisable: "sys.UnraisableHookArgs") -> None:
    """Hook for exceptions that the interpreter swallows in callbacks: raises an interrupt again."""
    if unraisable.exc_type is KeyboardInterrupt:
        threading.Timer(_AGAIN_S, signal.raise_signal, (signal.SIGTERM,)).start()
    else:
        sys.__unraisablehook__(unraisable)


def main(arguments: list[str] | None = None) -> int:
    """Run the verb that the arguments name; return its exit code: 0 done, 1 a named error (one line
    on stderr), 2 usage, 130 stopped; verbs with verdicts return further codes."""
    words = sys.argv[1:] if arguments is None else arguments
    if words and words[0] in _VERBS:
        try:
            return _run(words)
        except KeyboardInterrupt as stop:
            usual = "; what was done so far is on disk, and the same command goes on"
            notes = getattr(stop, "__notes__", [usual * (words[0] in _GOES_ON)])
            print(f"wrenchbed: stopped{notes[0]}", file=sys.stderr)
            return _STOPPED
    match words:
        case ["-h" | "--help", *_]:
            print(_usage())
        case ["--version"]:
            import wrenchbed

            print(f"wrenchbed {wrenchbed.__version__}")
        case []:
            print(_usage(), file=sys.stderr)
            raise SystemExit(2)
        case [word, *_]:
            hint = did_you_mean(word, _VERBS) or "."
            text = f"there is no verb {word!r}{hint} Known: {', '.join(_VERBS)}"
            print(f"wrenchbed: error: {one_line(text)}", file=sys.stderr)
            raise SystemExit(2)
    raise SystemExit(0)


def _usage() -> str:
    """Text of the program's help: each verb with the first paragraph of its docstring."""
    indent = max(map(len, _VERBS)) + 4
    lines = [
        "usage: wrenchbed VERB …", "",
        "Testbed for force-sensing robots: plan, record, calibrate, diagnose.", "",
    ]  # fmt: skip
    for verb, (module, function) in _VERBS.items():
        spec = find_spec(f"wrenchbed.cli.{module}")
        assert spec is not None and spec.origin is not None  # the verb's own module
        tree = ast.parse(Path(spec.origin).read_text(encoding="utf-8"))  # it is not imported
        node = next(n for n in tree.body if isinstance(n, ast.FunctionDef) and n.name == function)
        text = (ast.get_docstring(node) or "").partition("\n\n")[0]
        first, *more = textwrap.wrap(" ".join(text.split()), _COLUMNS - indent)
        lines += [f"  {verb:{indent - 2}}{first}", *(" " * indent + line for line in more)]
    lines += [
        "",
        "wrenchbed VERB --help   describes a verb",
        "wrenchbed --version     prints the version",
    ]
    return "\n".join(lines)


def prepare() -> None:
    """Set up standard output and error for any character and at least `_LEAST_COLUMNS` columns."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    if shutil.get_terminal_size().columns < _LEAST_COLUMNS:
        os.environ["COLUMNS"] = str(_LEAST_COLUMNS)


def _check_memory(verb: str) -> None:
    """Refuse to run a verb under a memory limit (`ulimit -v`) below what it needs; let a limited
    process load its linear algebra with one thread, as each reserves memory."""
    need = _LEAST_DRAWN if verb in _DRAWN else _LEAST
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit == resource.RLIM_INFINITY:
        return
    if limit < need:
        raise ShortageError(
            f"out of memory: this process may use {limit / _GB:.2g} GB of address space and needs "
            f"{need / _GB:.2g} GB: raise the limit (`ulimit -v {round(need / 1024)}`)"
        )
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")


def _check_epoch() -> None:
    """Check that SOURCE_DATE_EPOCH, if set, is a whole number of seconds before the year 10000:
    numpy raises on others wherever it is loaded."""
    epoch = os.environ.get("SOURCE_DATE_EPOCH", "0")
    if not (epoch.isascii() and epoch.isdecimal() and len(epoch) < 12):
        raise ParameterError(
            f"SOURCE_DATE_EPOCH is {one_line(epoch)[:40]!r}: must be whole seconds since 1970"
        )


def _run(words: Sequence[str]) -> int:
    try:
        _check_memory(words[0])
        _check_epoch()
    except (ShortageError, ParameterError) as error:
        print(f"wrenchbed: error: {error}", file=sys.stderr)
        return 1
    from wrenchbed.cli.console import Console

    stderr = Console(stderr=True, soft_wrap=True, highlight=False)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("always", WrenchbedWarning)
            warnings.showwarning = lambda message, *_, **__: stderr.print(
                f"wrenchbed: warning: {one_line(str(message))}", style="yellow", markup=False
            )
            return _call(words[0], words[1:])
    except WrenchbedError as error:
        stderr.print(f"wrenchbed: error: {error}", style="red", markup=False)
        return 1
    except Exception as error:
        _check_interrupt(error)
        if isinstance(error, BrokenPipeError) and _unread():
            raise
        what = _in_words(error)
        if not what:
            raise
        stderr.print(f"wrenchbed: error: {one_line(what)}", style="red", markup=False)
        return 1


def _check_interrupt(error: BaseException | None) -> None:
    """Raise KeyboardInterrupt if an error hides one: among its causes or, of ctypes, as text."""
    while error is not None:
        if isinstance(error, KeyboardInterrupt) or "KeyboardInterrupt" in str(error):
            raise error if isinstance(error, KeyboardInterrupt) else KeyboardInterrupt()
        error = error.__cause__ or error.__context__


def _in_words(error: Exception) -> str:
    """Message for an error about a missing file or resource; empty if a library is broken."""
    if isinstance(error, OSError):
        short = shortage(error, error.filename or "")
        reason = f"{error.filename}: {error.strerror}" if error.filename else str(error)
        return str(short or reason)
    return str(shortage(error) or "")


def _call(verb: str, arguments: Sequence[str]) -> int:
    """Parse a verb's arguments and call it; return its exit code, 0 if the verb returns none."""
    import tyro

    from wrenchbed.cli.console import note_words, outputs

    note_words([verb, *arguments])
    module, name = _VERBS[verb]
    home = import_module(f"wrenchbed.cli.{module}")
    function = getattr(home, name)
    config = (tyro.conf.OmitArgPrefixes, tyro.conf.FlagCreatePairsOff)
    prog, args = f"wrenchbed {verb}", list(arguments)
    with _cleaned(args):
        if verb in _GROUPS:
            call = tyro.extras.subcommand_cli_from_dict(
                {name: _later(f) for name, f in home.VERBS.items()}, prog=prog,
                description=function.__doc__, args=args, config=config,
            )  # fmt: skip
        else:
            call = tyro.cli(_later(function), prog=prog, args=args, config=config)
    with outputs():
        code = call()
    return code if isinstance(code, int) else 0


def _later(function: Callable[..., Any]) -> Callable[..., Callable[[], Any]]:
    """Wrap a function: a call stores its arguments and returns a function that makes the call."""

    @wraps(function)
    def bound(*args: Any, **kwargs: Any) -> Callable[[], Any]:
        return partial(function, *args, **kwargs)

    return bound


@contextmanager
def _cleaned(arguments: Sequence[str]) -> Iterator[None]:
    """Escape control characters in what the block prints to stderr, if ``arguments`` hold any."""
    if not any(map(OBEYED.search, arguments)):
        yield
        return
    printed = io.StringIO()
    try:
        with redirect_stderr(printed):
            yield
    finally:
        sys.stderr.write(printable(printed.getvalue()))
