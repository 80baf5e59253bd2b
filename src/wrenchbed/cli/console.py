"""What the verbs share: argument checks, answers, progress bars, waiting for a signal."""

import json
import shlex
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TextColumn,
    TimeRemainingColumn,
)
from rich.text import Text

from wrenchbed.data.checked import load
from wrenchbed.errors import ParameterError

Flag = Annotated[bool, tyro.conf.FlagCreatePairsOff]
"""An option without a value."""
Json = Annotated[bool, tyro.conf.FlagCreatePairsOff, tyro.conf.arg(name="json")]
"""Print the result as JSON on stdout."""
Repeated = tyro.conf.UseAppendAction[tuple[str, ...]]
"""A text option that may be given several times."""

_OUT = Console()


def check_seed(seed: int) -> None:
    """Refuse a negative seed."""
    if seed < 0:
        raise ParameterError(f"seed {seed} must not be negative")


def check_out(out: Path | None, *inputs: Path | None) -> None:
    """Refuse to write over what was read."""
    if out is not None and out.resolve() in [i.resolve() for i in inputs if i is not None]:
        raise ParameterError(f"{out}: is an input too; give another name")


def check_folder(out: Path) -> None:
    """Refuse a file where a folder is needed."""
    if out.exists() and not out.is_dir():
        raise ParameterError(f"{out}: is a file; give a folder")


def check_positive(flag: str, count: int) -> int:
    """Refuse a number of processes or workers below 1."""
    if count < 1:
        raise ParameterError(f"{flag} {count} must be at least 1")
    return count


def parameters(path: Path | None) -> dict[str, float]:
    """A JSON object {name: value}; empty without a file."""
    if path is None:
        return {}
    raw = load(path, ParameterError)
    if not isinstance(raw, dict):
        raise ParameterError(f"{path}: must be a JSON object {{name: value}}")
    return raw


def command(*words: object) -> str:
    """A command line of wrenchbed, to be printed."""
    return shlex.join(["wrenchbed", *map(str, words)])


def say(text: str) -> None:
    """Print one line for people, unbroken and without markup."""
    _OUT.print(text, soft_wrap=True, markup=False, highlight=False)


def answer(result: Any, as_json: bool, display: Any) -> None:
    """Print what people read, text or a table of rich; or the result as JSON."""
    if as_json:
        print(json.dumps(result, indent=1, ensure_ascii=False, allow_nan=False))
    elif isinstance(display, str):
        say(display)
    else:
        _OUT.print(display)


class _RateColumn(ProgressColumn):
    """How many are done in a second, or a minute."""

    def render(self, task: Task) -> Text:
        speed = task.speed or 0.0
        return Text(f"{speed:.1f}/s" if speed >= 1.0 else f"{60.0 * speed:.0f}/min")


@contextmanager
def progress(what: str, total: int | None, *, rate: bool = False) -> Iterator[Callable[..., None]]:
    """A bar on stderr, nothing where stderr is no terminal; call it with (steps done, label)."""
    console = Console(stderr=True)
    columns = [TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn()]
    columns += [TimeRemainingColumn(), *([_RateColumn()] if rate else [])]
    bar = Progress(*columns, console=console, disable=not console.is_terminal, transient=True)
    with bar:
        task = bar.add_task(what, total=total)

        def report(n: int, label: str = "") -> None:
            text = f"{what}: {label}" if label else what
            bar.update(task, advance=n, description=text)

        yield report


@contextmanager
def until_signal() -> Iterator[threading.Event]:
    """An event that SIGINT and SIGTERM set; the handlers before are put back."""
    event = threading.Event()
    kinds = (signal.SIGINT, signal.SIGTERM)
    before = {kind: signal.signal(kind, lambda *_: event.set()) for kind in kinds}
    try:
        yield event
    finally:
        for kind, handler in before.items():
            signal.signal(kind, handler)
