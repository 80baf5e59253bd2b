"""What the verbs share: argument checks, ``--set`` words, answers, progress bars, signals."""

import json
import math
import shlex
import signal
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import fields
from datetime import timedelta
from pathlib import Path
from types import MappingProxyType, NoneType
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

import tyro
from rich import progress as bars
from rich.console import Console as RichConsole
from rich.console import ConsoleOptions, RenderableType
from rich.markup import escape
from rich.padding import Padding
from rich.segment import Segment
from rich.table import Table
from rich.text import Text

from wrenchbed.data.overwrite_rules import Kind, check
from wrenchbed.errors import ParameterError, one_line, printable
from wrenchbed.files import locked
from wrenchbed.files.checked import load

_SIMPLE: dict[type, tuple[str, Callable[[str], Any]]] = {
    int: ("a whole number", lambda word: int(word, 0)), float: ("a number", float),
    str: ("text", str), bool: ("on or off", lambda word: {"on": True, "off": False}[word]),
}  # fmt: skip
"""Type of a setting → its name for people and the function that converts a word to it."""
Json = Annotated[bool, tyro.conf.arg(name="json", help="Print the result as JSON.")]
"""Option ``--json``: print the result as JSON on stdout; defined once for all verbs."""
Repeated = tyro.conf.UseAppendAction[tuple[str, ...]]
"""A text option that may be given several times."""
_CLAIMED = ExitStack()
"""Locks of the outputs of the verb that runs."""
_WORDS: list[str] = []
"""Words of the command line that is running."""


def pairs(words: Sequence[str]) -> dict[str, str]:
    """Parse words NAME=VALUE into a dict name → value (text); raise `ParameterError` for others."""
    split = [word.partition("=") for word in words]
    for word, (name, equals, _) in zip(words, split, strict=True):
        if not name or not equals:
            raise ParameterError(f"--set {word}: give NAME=VALUE")
    return {name: value for name, _, value in split}


def typed(options: type, words: Mapping[str, str], excluded: Sequence[str]) -> dict[str, Any]:
    """Convert words (field → text) to the types of a dataclass's fields; fields in ``excluded``
    have options of their own. A `ParameterError` if there is no such field (the message lists all),
    or a value has another type."""
    hints = get_type_hints(options)
    names = (f.name for f in fields(options) if f.name not in excluded)
    known = {name: kind for name in names if (kind := _simple_type(hints[name])) is not None}
    values: dict[str, Any] = {}
    for name, word in words.items():
        if name not in known:
            raise ParameterError(f"--set {name}: no such setting. Known: {', '.join(known)}")
        type_, several, optional = known[name]
        words_of_type, read = _SIMPLE[type_]
        try:
            if optional and word == "none":
                values[name] = None
            else:
                values[name] = tuple(map(read, word.split(","))) if several else read(word)
        except (ValueError, KeyError) as error:
            more = ", or several with commas between" if several else " or none" if optional else ""
            raise ParameterError(f"--set {name}={word}: must be {words_of_type}{more}") from error
    return values


def _simple_type(hint: Any) -> tuple[type, bool, bool] | None:
    """(type, whether the hint is a tuple of it, whether it allows None) of a type hint; None if no
    word of a command line can be its value."""
    optional = NoneType in get_args(hint)
    others = [a for a in get_args(hint) if a is not NoneType]
    inner = others[0] if optional and len(others) == 1 else hint
    several = get_origin(inner) is tuple
    leaves = {*get_args(inner)} - {Ellipsis} if several else {inner}
    simple = leaves.pop() if len(leaves) == 1 else None
    return (simple, several, optional) if simple in _SIMPLE else None


class Console(RichConsole):
    """A rich console that spells out control characters: foreign texts are shown as text."""

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        """Render as rich does, with control characters escaped in texts but not in rich's own."""
        for text, style, control in super().render(renderable, options):
            yield Segment(text if control else printable(text), style, control)


_OUT = Console()
_NOTES = Console(stderr=True)


def check_seed(seed: int) -> None:
    """Raise `ParameterError` for a negative seed."""
    if seed < 0:
        raise ParameterError(f"seed {seed} must not be negative")


@contextmanager
def outputs() -> Iterator[None]:
    """In the block, `check_out` and `check_folder` lock outputs; at its end the locks are
    released."""
    with _CLAIMED:
        yield


def check_out(
    out: Path | None, kind: Kind, *inputs: Path | None, force: bool = False, lock: bool = True
) -> None:
    """Raise `ParameterError` if ``out``, a file of ``kind`` to write, is an input, exists as
    another kind, or is a recording and not ``force``; with ``lock``, lock it against other
    processes."""
    if out is None:
        return
    if lock and out.name and not out.is_dir():
        _CLAIMED.enter_context(locked(out))
    check(out, kind, *inputs, force=force)


def check_folder(out: Path, files: Mapping[str, Kind] = MappingProxyType({})) -> None:
    """Lock the folder ``out``; a `ParameterError` if it or one of ``files`` (name → kind) is
    another kind of file."""
    if out.exists() and not out.is_dir():
        raise ParameterError(f"{out}: is a file; give a folder")
    _CLAIMED.enter_context(locked(out, folder=True))
    for name, kind in files.items():
        check(out / name, kind)


def check_positive(flag: str, count: int) -> int:
    """Return ``count``; raise `ParameterError`, naming the option ``flag``, if it is below 1."""
    if count < 1:
        raise ParameterError(f"{flag} {count} must be at least 1")
    return count


def parameters(path: Path | None) -> dict[str, float]:
    """Read a JSON object {name: value} from a file; empty dict without a file."""
    if path is None:
        return {}
    raw = load(path, ParameterError)
    if not isinstance(raw, dict):
        raise ParameterError(f"{path}: must be a JSON object {{name: value}}")
    return raw


def command() -> str:
    """Command line of the running verb, as text for reports."""
    return shlex.join(["wrenchbed", *_WORDS])


def note_words(words: Sequence[str]) -> None:
    """Store the words of the running command line, which `command` returns."""
    _WORDS[:] = words


def say(text: str) -> None:
    """Print a line of text on stdout, without line breaks or markup."""
    _print(one_line(text))


def note(display: RenderableType) -> None:
    """Print a notice on stderr before a verb goes on; stdout is for the result alone."""
    _NOTES.print(display, markup=False, highlight=False)


def _print(text: str) -> None:
    _OUT.print(text, soft_wrap=True, markup=False, highlight=False)


def answer(result: Any, as_json: bool, *displays: RenderableType) -> None:
    """Print a verb's result: as JSON if ``as_json``, else as displays (texts or rich tables)."""
    if as_json:
        print(json.dumps(result, indent=1, allow_nan=False))
        return
    for display in displays:
        if isinstance(display, str):
            _print(display)
        else:
            _OUT.print(display)


def table(*heads: str, indent: int = 0, space: int = 2, title: str | None = None) -> Table:
    """Make a rich table without ruled lines.

    Args:
        heads: heads of the columns, with ``>`` before one of a right-aligned and ``|`` before one
            of a left-aligned column whose lines are never broken. All empty: no line of heads.
        indent: columns to the left of the table.
        space: columns between its columns.
        title: above it, at the left.
    """
    grid = Table(
        box=None, padding=(0, space, 0, indent), header_style="dim", title=title and escape(title),
        title_justify="left", show_header=any(head.strip("|>") for head in heads),
    )  # fmt: skip
    for head in heads:
        side: Literal["right", "left"] = "right" if head.startswith(">") else "left"
        grid.add_column(escape(head.lstrip("|>")), justify=side, no_wrap=head[:1] in ("|", ">"))
    return grid


def section(title: str, lines: Iterable[RenderableType]) -> list[RenderableType]:
    """Displays: an empty line, a title, and lines (texts indented); empty list without lines."""
    inside = [Padding(Text(x), (0, 0, 0, 2)) if isinstance(x, str) else x for x in lines]
    return ["", Text(title, style="bold"), *inside] if inside else []


class _Remaining(bars.ProgressColumn):
    """Time until the task's field ``ends``, on the clock of its display; it falls by itself."""

    def render(self, task: bars.Task) -> Text:
        """Return the time as h:mm:ss, dashes before any step was finished."""
        left = max(0.0, task.fields["ends"] - task.get_time())
        return Text(str(timedelta(seconds=round(left))) if left < math.inf else "-:--:--")


@contextmanager
def progress(what: str, total: int | None, *, alike: bool = True) -> Iterator[Callable[..., None]]:
    """Show a progress bar called ``what`` if stderr is a terminal; yield a function (steps, label).

    It shows the remaining time, by the mean time of a step after the first, which loads and
    compiles; the elapsed time if ``total`` is None or steps are not ``alike``. A first report of
    other than 1 step counts an earlier run's.
    """
    console = Console(stderr=True)
    time = _Remaining() if alike and total is not None else bars.TimeElapsedColumn()
    text = bars.TextColumn("{task.description}")
    columns = (text, bars.BarColumn(), bars.MofNCompleteColumn(), time)
    bar = bars.Progress(*columns, console=console, disable=not console.is_terminal, transient=True)
    with bar:
        bar.add_task(what, total=total, ends=math.inf)
        (task,), begun, first, earlier = bar.tasks, math.nan, 0.0, math.nan

        def report(n: int, label: str = "") -> None:
            nonlocal begun, first, earlier
            bar.update(task.id, advance=n, description=f"{what}: {label}" if label else what)
            if math.isnan(earlier):
                earlier = 0 if n == 1 else n
            done, now = task.completed - earlier, bar.get_time()
            if math.isnan(begun) and done > 0:
                begun, first = now, done
            elif done >= first + 2:  # two processes finish their first steps at once
                a_step = (now - begun) / (done - first)
                bar.update(task.id, ends=now + a_step * (task.remaining or 0.0))

        yield report


@contextmanager
def until_signal() -> Iterator[threading.Event]:
    """Yield an event that SIGINT and SIGTERM set; restore the former handlers at the end."""
    event = threading.Event()
    kinds = (signal.SIGINT, signal.SIGTERM)
    before = {kind: signal.signal(kind, lambda *_: event.set()) for kind in kinds}
    try:
        yield event
    finally:
        for kind, handler in before.items():
            signal.signal(kind, handler)
