"""What the verbs share: checks of their arguments, answers, progress bars."""

import json
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
