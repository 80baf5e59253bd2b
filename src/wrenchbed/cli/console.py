"""What the verbs share: argument checks, ``--set`` words, answers, progress bars, signals."""

import json
import math
import re
import shlex
import signal
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, fields
from pathlib import Path
from types import MappingProxyType, NoneType, UnionType
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

import tyro
from rich.console import Console as RichConsole
from rich.console import ConsoleOptions, RenderableType
from rich.padding import Padding
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TextColumn,
    TimeElapsedColumn,
)
from rich.segment import Segment
from rich.table import Table
from rich.text import Text

from wrenchbed.cli import terminal
from wrenchbed.data.checked import load
from wrenchbed.data.outputs import Kind, check
from wrenchbed.errors import OBEYED, ParameterError, one_line, printable
from wrenchbed.files import locked

_AT_ONCE_S = 1.0
"""Steps that are done within so many seconds were done by an earlier run."""
_LEAST_DONE = 2
"""Steps before the remaining time is shown: one of several processes says nothing of the others."""
_SIMPLE = {int: "a whole number", float: "a number", str: "text", bool: "on or off"}
Flag = Annotated[bool, tyro.conf.FlagCreatePairsOff]
"""An option without a value."""
Json = Annotated[
    bool, tyro.conf.FlagCreatePairsOff,
    tyro.conf.arg(name="json", help="Print the result as JSON."),
]  # fmt: skip
"""Print the result as JSON on stdout; said here once for all verbs."""
Repeated = tyro.conf.UseAppendAction[tuple[str, ...]]
"""A text option that may be given several times."""
_CLAIMED = ExitStack()
"""Locks of the outputs of the verb that runs."""


def pairs(words: Sequence[str]) -> dict[str, str]:
    """Values by name, as text.

    Raises:
        ParameterError: a word is not NAME=VALUE.
    """
    split = [word.partition("=") for word in words]
    for word, (name, equals, _) in zip(words, split, strict=True):
        if not name or not equals:
            raise ParameterError(f"--set {word}: give NAME=VALUE")
    return {name: value for name, _, value in split}


def typed(options: type, words: Mapping[str, str], excluded: Sequence[str]) -> dict[str, Any]:
    """Values for fields of an options dataclass; fields with a flag of their own are excluded.

    Raises:
        ParameterError: no such field (the message lists all), or a value of another type.
    """
    hints = get_type_hints(options)
    known = {f.name: hints[f.name] for f in fields(options) if f.name not in excluded}
    known = {name: hint for name, hint in known.items() if _simple_types(hint)}
    values = {}
    for name, word in words.items():
        if name not in known:
            raise ParameterError(f"--set {name}: no such setting. Known: {', '.join(known)}")
        try:
            values[name] = _value(known[name], word)
        except ValueError as error:
            rule = _rule(known[name])
            raise ParameterError(f"--set {name}={word}: must be {rule}") from error
    return values


def _simple_types(hint: Any) -> tuple[Any, ...]:
    """The simple types that a hint is made of; empty if no word can be its value."""
    if hint in _SIMPLE:
        return (hint,)
    inner = tuple(a for a in get_args(hint) if a not in (NoneType, Ellipsis))
    simple = get_origin(hint) in (tuple, UnionType) and inner and all(map(_simple_types, inner))
    return inner if simple else ()


def _rule(hint: Any) -> str:
    text = _SIMPLE[_simple_types(hint)[0]]
    if get_origin(hint) is tuple:
        return f"{text}, or several with commas between"
    return text + (" or none" if get_origin(hint) is UnionType else "")


def _value(hint: Any, word: str) -> Any:
    if get_origin(hint) is UnionType:
        return None if word == "none" else _value(_simple_types(hint)[0], word)
    if get_origin(hint) is tuple:
        return tuple(_value(_simple_types(hint)[0], part) for part in word.split(","))
    if hint is bool:
        if word not in ("on", "off"):
            raise ValueError
        return word == "on"
    return int(word, 0) if hint is int else hint(word)


class Console(RichConsole):
    """A console on which text of foreign files is only text: control characters are spelled out."""

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        """Segments as rich makes them, cleaned; rich's own control codes stay."""
        for text, style, control in super().render(renderable, options):
            yield Segment(text if control else printable(text), style, control)


_OUT = Console()
_NOTES = Console(stderr=True)


def check_seed(seed: int) -> None:
    """Refuse a negative seed."""
    if seed < 0:
        raise ParameterError(f"seed {seed} must not be negative")


@contextmanager
def outputs() -> Iterator[None]:
    """Let go of all outputs when the block ends."""
    with _CLAIMED:
        yield


def check_out(
    out: Path | None, kind: Kind, *inputs: Path | None, force: bool = False, lock: bool = True
) -> None:
    """Refuse to replace what must not be replaced, and keep other processes off the output."""
    if out is None:
        return
    if lock and out.name and not out.is_dir():
        _CLAIMED.enter_context(locked(out))
    check(out, kind, *inputs, force=force)


def check_folder(out: Path, files: Mapping[str, Kind] = MappingProxyType({})) -> None:
    """Refuse a file where a folder is needed, and a folder that has other files of these names."""
    if out.exists() and not out.is_dir():
        raise ParameterError(f"{out}: is a file; give a folder")
    _CLAIMED.enter_context(locked(out, folder=True))
    for name, kind in files.items():
        check(out / name, kind)


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
    _print(one_line(text))


def note(display: RenderableType) -> None:
    """Print on stderr what people read before a verb goes on; stdout is the result's."""
    _NOTES.print(display, markup=False, highlight=False)


def _print(text: str) -> None:
    _OUT.print(text, soft_wrap=True, markup=False, highlight=False)


def answer(result: Any, as_json: bool, display: Any) -> None:
    """Print what people read, text or a table of rich; or the result as JSON."""
    if as_json:
        text = json.dumps(result, indent=1, ensure_ascii=False, allow_nan=False)
        if terminal.lacks(text):
            text = json.dumps(result, indent=1, allow_nan=False)
        print(OBEYED.sub(_as_json, text))
    elif isinstance(display, str):
        _print(display)
    else:
        _OUT.print(display)


def _as_json(found: re.Match[str]) -> str:
    """A character as JSON spells it out."""
    units = found[0].encode("utf-16-be", "surrogatepass").hex()
    return "".join(f"\\u{units[k : k + 4]}" for k in range(0, len(units), 4))


@dataclass
class _Pace:
    """What is known of one task's steps; times are seconds since the task began.

    Attributes:
        begun, before: when steps began to be counted, and how many were done then.
        last, completed: when the last step was done, and how many were done then.
        shown: the shortest remaining time so far.
    """

    begun: float = 0.0
    before: float = 0.0
    last: float = 0.0
    completed: float = 0.0
    shown: float = math.inf

    def remaining(self, elapsed: float, completed: float, total: float) -> float | None:
        """Time that remains [s]; None while too little was done to tell.

        It is that of the mean rate at the last step's end, counts down while a step lasts, and
        never rises: where steps become slower it stays until the rate has come down to it.
        """
        if completed < self.completed or (not self.completed and elapsed < _AT_ONCE_S):
            self.begun, self.before, self.shown = elapsed, completed, math.inf
        if completed != self.completed:
            self.last, self.completed = elapsed, completed
        done, rest = completed - self.before, total - completed
        if done < min(_LEAST_DONE, total - self.before) or done <= 0:
            return None
        step = (self.last - self.begun) / done
        ahead = max(rest * step - (elapsed - self.last), (rest - 1.0) * step, 0.0)
        self.shown = min(self.shown, ahead)
        return self.shown


def table(*heads: str, indent: int = 0, space: int = 2, title: str | None = None) -> Table:
    """A table without lines.

    Args:
        heads: of the columns; after ``>`` of one that is right-aligned, after ``|`` of one that is
            left-aligned, neither of which breaks its lines. All empty: no line of heads.
        indent: columns to the left of it.
        space: between its columns.
        title: above it, at the left.
    """
    shown = Table(
        box=None, padding=(0, space, 0, indent), header_style="dim", title=title,
        title_justify="left", show_header=any(head.strip("|>") for head in heads),
    )  # fmt: skip
    for head in heads:
        side: Literal["right", "left"] = "right" if head.startswith(">") else "left"
        shown.add_column(head.lstrip("|>"), justify=side, no_wrap=head[:1] in ("|", ">"))
    return shown


def section(title: str, lines: Iterable[RenderableType]) -> list[RenderableType]:
    """An empty line, a heading and lines beneath it, texts indented; nothing without lines."""
    inside = [Padding(Text(x), (0, 0, 0, 2)) if isinstance(x, str) else x for x in lines]
    return ["", Text(title, style="bold"), *inside] if inside else []


class RemainingColumn(ProgressColumn):
    """Time that remains at the mean rate so far, steps of an earlier run left out."""

    def __init__(self) -> None:
        super().__init__()
        self._paces: dict[int, _Pace] = {}

    def render(self, task: Task) -> Text:
        """The time as h:mm:ss, dashes while nothing is known."""
        return Text(self.text(task.id, task.elapsed or 0.0, task.completed, task.total))

    def text(self, task: int, elapsed: float, completed: float, total: float | None) -> str:
        """The time that remains [h:mm:ss] after ``elapsed`` seconds."""
        pace = self._paces.setdefault(task, _Pace())
        remaining = None if total is None else pace.remaining(elapsed, completed, total)
        if remaining is None:
            return "-:--:--"
        seconds = round(remaining)
        return f"{seconds // 3600}:{seconds // 60 % 60:02}:{seconds % 60:02}"


class _RateColumn(ProgressColumn):
    """How many are done in a second, or a minute."""

    def render(self, task: Task) -> Text:
        speed = task.speed or 0.0
        return Text(f"{speed:.1f}/s" if speed >= 1.0 else f"{60.0 * speed:.0f}/min")


@contextmanager
def progress(
    what: str, total: int | None, *, rate: bool = False, alike: bool = True
) -> Iterator[Callable[..., None]]:
    """A bar on stderr, nothing where stderr is no terminal; call it with (steps done, label).

    Without a total, or with steps of which one may take much longer than another, it shows the
    time since its begin, else the time that remains.
    """
    console = Console(stderr=True)
    columns = [TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn()]
    time = RemainingColumn() if alike and total is not None else TimeElapsedColumn()
    columns += [time, *([_RateColumn()] if rate else [])]
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
