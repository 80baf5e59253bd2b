"""What the verbs share: checks of their arguments, answers, progress bars.

How long a server runs.

NAME=VALUE of settings that one driver or one twin alone has.
"""

import json
import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, get_args, get_origin, get_type_hints

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

from wrenchbed.errors import ParameterError

Json = Annotated[bool, tyro.conf.FlagCreatePairsOff, tyro.conf.arg(name="json")]
"""Print the result as JSON on stdout."""

OUT = Console()


def check_seed(seed: int) -> None:
    """Refuse a negative seed."""
    if seed < 0:
        raise ParameterError(f"seed {seed} must not be negative")


def check_out(out: Path | None, *inputs: Path | None) -> None:
    """Refuse to write over what was read."""
    if out is not None and out.resolve() in [i.resolve() for i in inputs if i is not None]:
        raise ParameterError(f"{out}: is an input too; give another name")


def parameters(path: Path | None) -> dict[str, float]:
    """A JSON object {name: value}; empty without a file."""
    if path is None:
        return {}
    try:
        raw = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise ParameterError(f"{path}: there is no such file") from error
    except ValueError as error:
        raise ParameterError(f"{path}: not valid JSON: {error}") from error
    if not isinstance(raw, dict):
        raise ParameterError(f"{path}: must be a JSON object {{name: value}}")
    return raw


def answer(result: Any, as_json: bool, shown: Any) -> None:
    """Print what people read, or JSON on stdout."""
    if as_json:
        print(json.dumps(result, indent=1, ensure_ascii=False, allow_nan=False))
    elif isinstance(shown, str):
        OUT.print(shown, soft_wrap=True, markup=False, highlight=False)
    else:
        OUT.print(shown)


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

        def tell(n: int, label: str = "") -> None:
            text = f"{what}: {label}" if label else what
            bar.update(task, advance=n, description=text)

        yield tell


@contextmanager
def until_signal() -> Iterator[threading.Event]:
    """An event that SIGINT and SIGTERM set; the handlers before are put back."""
    told = threading.Event()
    kinds = (signal.SIGINT, signal.SIGTERM)
    before = {kind: signal.signal(kind, lambda *_: told.set()) for kind in kinds}
    try:
        yield told
    finally:
        for kind, handler in before.items():
            signal.signal(kind, handler)


_SIMPLE = {int: "a whole number", float: "a number", str: "text", bool: "on or off"}


def pairs(given: Sequence[str]) -> dict[str, str]:
    """Words by name.

    Raises:
        ParameterError: one is not NAME=VALUE.
    """
    split = [text.partition("=") for text in given]
    for text, (name, equals, _) in zip(given, split, strict=True):
        if not name or not equals:
            raise ParameterError(f"--set {text}: give NAME=VALUE")
    return {name: value for name, _, value in split}


def typed(options: type, words: Mapping[str, str], besides: Sequence[str]) -> dict[str, Any]:
    """Values of fields of an options' dataclass; those that have a flag of their own are refused.

    Raises:
        ParameterError: no such field, listing all, or a word that is no value of its type.
    """
    hints = get_type_hints(options)
    known = {f.name: hints[f.name] for f in fields(options) if f.name not in besides}
    known = {name: hint for name, hint in known.items() if _parts(hint)}
    found = {}
    for name, word in words.items():
        if name not in known:
            raise ParameterError(f"--set {name}: no such setting. Known: {', '.join(known)}")
        try:
            found[name] = _value(known[name], word)
        except ValueError as error:
            raise ParameterError(f"--set {name}={word}: must be {_what(known[name])}") from error
    return found


def _parts(hint: Any) -> tuple[Any, ...]:
    """What a word of this type is made of; nothing where no word can be one."""
    if hint in _SIMPLE:
        return (hint,)
    inner = tuple(a for a in get_args(hint) if a not in (NoneType, Ellipsis))
    simple = get_origin(hint) in (tuple, UnionType) and inner and all(map(_parts, inner))
    return inner if simple else ()


def _what(hint: Any) -> str:
    """What a word must be."""
    inner = _parts(hint)[0]
    if get_origin(hint) is tuple:
        return f"{_SIMPLE[inner]}, or several with commas between"
    return _SIMPLE[inner] + (" or none" if get_origin(hint) is UnionType else "")


def _value(hint: Any, word: str) -> Any:
    if get_origin(hint) is UnionType:
        inner = next(a for a in get_args(hint) if a is not NoneType)
        return None if word == "none" else _value(inner, word)
    if get_origin(hint) is tuple:
        inner = _parts(hint)[0]
        return tuple(_value(inner, part) for part in word.split(","))
    if hint is bool:
        if word not in ("on", "off"):
            raise ValueError
        return word == "on"
    return int(word, 0) if hint is int else hint(word)
