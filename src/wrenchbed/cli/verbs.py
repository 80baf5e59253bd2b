"""One function a verb; its signature is the command's usage."""

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

import wrenchbed as wb
from wrenchbed.cli import tables
from wrenchbed.errors import ParameterError, PlanError

Json = Annotated[bool, tyro.conf.FlagCreatePairsOff, tyro.conf.arg(name="json")]
"""Print the result as JSON on stdout."""

_OUT = Console()


def list_(
    kind: tyro.conf.Positional[Literal["robots", "sensors", "drivers"]], /, as_json: Json = False
) -> None:
    """List what exists, one line each.

    Args:
        kind: of plug-in.
        as_json: Print the result as JSON.
    """
    rows = {name: tables.describe(wb.load(kind, name)) for name in wb.names(kind)}
    _answer(rows, as_json, tables.plugins(kind, rows))


def plan(
    robot: tyro.conf.Positional[str],
    /,
    out: Path,
    n: int = 100,
    motion: Literal["poses", "multisine"] = "poses",
    seconds: float = 60.0,
    rate: float = 125.0,
    seed: int = 0,
    as_json: Json = False,
) -> None:
    """Choose poses, or a multi-sine motion, for a robot.

    Args:
        robot: name, see `wrenchbed list robots`.
        out: Parquet file to write.
        n: Number of poses.
        motion: Poses to rest at, or a multi-sine to follow.
        seconds: Length of a motion.
        rate: Sampling rate of a motion [Hz].
        seed: Of the random choice.
        as_json: Print the result as JSON.
    """
    _check_seed(seed)
    arm = wb.load("robots", robot)
    chosen = wb.poses(arm, n, seed) if motion == "poses" else wb.multisine(arm, seconds, rate, seed)
    chosen.write(out)
    what = f"{len(chosen)} poses" if motion == "poses" else f"{seconds:g} s at {rate:g} Hz"
    result = {"plan": str(out), "robot": robot, "mode": chosen.mode, "rows": len(chosen)}
    _answer(result, as_json, f"planned {what} for {robot} → {out}")


def record(
    robot: str,
    plan: Path,
    out: Path,
    driver: str = "sim",
    parameters: Path | None = None,
    noise: Literal["real", "white", "off"] = "real",
    samples: int = 100,
    rate: float | None = None,
    seed: int = 0,
    as_json: Json = False,
) -> None:
    """Run a plan on a simulated or real robot and record what its sensor reads.

    Args:
        robot: Name, see `wrenchbed list robots`.
        plan: Parquet file with q1…qN, see `wrenchbed plan`.
        out: Recording to write; an existing one is kept as OUT~.
        driver: Name, see `wrenchbed list drivers`.
        parameters: JSON {name: value} in SI: what the simulated robot truly is.
        noise: Of the simulated sensor.
        samples: Rows a pose.
        rate: Sampling rate [Hz]; the plan's, else 100 at rest and 125 in motion.
        seed: Of the noise.
        as_json: Print the result as JSON.
    """
    _check_seed(seed)
    _check_out(out, plan, parameters)
    device = wb.load("drivers", driver)
    todo = wb.Plan.read(plan)
    if todo.robot != robot:
        raise PlanError(f"{plan}: the plan is for robot {todo.robot!r}, not {robot!r}")
    options = device.options(
        robot=robot, parameters=_parameters(parameters), noise=noise, seed=seed
    )
    with device(options) as link, _progress(f"recording {robot}", len(todo)) as tell:
        done = wb.record(link, todo, out, samples=samples, rate=rate, progress=tell)
    result = {"recording": str(out), "robot": robot, "mode": todo.mode, "rows": done.rows,
              "visited": done.visited, "seconds": done.seconds}  # fmt: skip
    what = f"{done.visited} poses" if todo.mode == "static" else f"{done.rows} samples of motion"
    text = f"recorded {what}, {done.rows} rows, {done.seconds:.0f} s of {driver} time → {out}"
    _answer(result, as_json, text)


def import_(
    files: tyro.conf.Positional[tuple[Path, ...]],
    /,
    map: Path,
    out: Path,
    as_json: Json = False,
) -> None:
    """Bring CSV files in through a column map that states units.

    Args:
        files: CSV files; several are merged on time.
        map: TOML or JSON column map, see docs/import.md.
        out: Recording to write.
        as_json: Print the result as JSON.
    """
    _check_out(out, map, *files)
    imported = wb.import_files(files, wb.read_map(map))
    imported.recording.write(out)
    rows = len(imported.recording)
    result = {"recording": str(out), "rows": rows, "rows_left_out": imported.left_out}
    left = f", {imported.left_out} outside the other files' times left out" * (
        imported.left_out > 0
    )
    _answer(result, as_json, f"imported {rows} rows{left} → {out}")


def calibrate(
    recording: tyro.conf.Positional[Path],
    /,
    out: Path | None = None,
    free: tuple[str, ...] = (),
    hold: tuple[str, ...] = (),
    prior: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    loss: Literal["linear", "huber", "student"] = "linear",
    truth: Path | None = None,
    as_json: Json = False,
) -> None:
    """Identify a robot's parameters: value ± standard uncertainty, and what the data cannot tell.

    Args:
        recording: Parquet file.
        out: Fit to write, JSON.
        free: Parameters, groups (tool.cog) or patterns (L1?) to identify; the robot's own if none.
        hold: Of these, to hold at their stated or nominal value.
        prior: Take each tolerance as a prior standard deviation.
        loss: Huber and Student's t resist outliers.
        truth: JSON {name: value} of a simulated robot, shown beside the estimates.
        as_json: Print the result as JSON.
    """
    options = wb.Options(free or None, hold, prior, loss)
    _check_out(out, recording, truth)
    known = None if truth is None else _parameters(truth)
    fit = wb.calibrate(wb.Recording.read(recording), options)
    for name, value in (known or {}).items():
        if name not in fit.theta or isinstance(value, bool) or not isinstance(value, int | float):
            raise ParameterError(f"{truth}: {name!r} = {value!r} is no parameter with a number")
    if out is not None:
        fit.write(out)
    _answer(fit.to_json(), as_json, tables.fit(fit, known))
    if out is not None and not as_json:
        _OUT.print(f"fit → {out}", soft_wrap=True, markup=False, highlight=False)


def _check_seed(seed: int) -> None:
    if seed < 0:
        raise ParameterError(f"seed {seed} must not be negative")


def _check_out(out: Path | None, *inputs: Path | None) -> None:
    """Refuse to write over what was read."""
    if out is not None and out.resolve() in [i.resolve() for i in inputs if i is not None]:
        raise ParameterError(f"{out}: is an input too; give another name")


def _parameters(path: Path | None) -> dict[str, float]:
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


def _answer(result: Any, as_json: bool, shown: Any) -> None:
    if as_json:
        print(json.dumps(result, indent=1, ensure_ascii=False, allow_nan=False))
    elif isinstance(shown, str):
        _OUT.print(shown, soft_wrap=True, markup=False, highlight=False)
    else:
        _OUT.print(shown)


@contextmanager
def _progress(what: str, total: int) -> Iterator[Callable[[int], None]]:
    """A bar on stderr; nothing where stderr is no terminal."""
    console = Console(stderr=True)
    bar = Progress(
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(),
        console=console, disable=not console.is_terminal, transient=True,
    )  # fmt: skip
    with bar:
        task = bar.add_task(what, total=total)
        yield lambda n: bar.advance(task, n)
