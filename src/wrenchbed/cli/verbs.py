"""One function a verb; its signature is the command's usage."""

from pathlib import Path
from typing import Annotated, Literal

import tyro

import wrenchbed as wb
from wrenchbed.cli import console, tables
from wrenchbed.cli.console import Json
from wrenchbed.errors import ParameterError, PlanError


def list_(
    kind: tyro.conf.Positional[Literal["robots", "sensors", "drivers", "effects"]],
    /,
    as_json: Json = False,
) -> None:
    """List what exists, one line each.

    Args:
        kind: of plug-in.
        as_json: Print the result as JSON.
    """
    rows = {name: tables.describe(wb.load(kind, name)) for name in wb.names(kind)}
    console.answer(rows, as_json, tables.plugins(kind, rows))


def record(
    robot: str,
    plan: Path,
    out: Path,
    driver: str = "sim",
    parameters: Path | None = None,
    noise: Literal["real", "white", "off"] = "real",
    effect: tyro.conf.UseAppendAction[tuple[str, ...]] = (),
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
        effect: ID[:name=value,…] of an effect on the simulated robot, see `wrenchbed list effects`;
            without values of typical size. May be repeated.
        samples: Rows a pose.
        rate: Sampling rate [Hz]; the plan's, else 100 at rest and 125 in motion.
        seed: Of the noise.
        as_json: Print the result as JSON.
    """
    console.check_seed(seed)
    console.check_out(out, plan, parameters)
    device = wb.load("drivers", driver)
    todo = wb.Plan.read(plan)
    if todo.robot != robot:
        raise PlanError(f"{plan}: the plan is for robot {todo.robot!r}, not {robot!r}")
    extra = {"effects": effect} if effect else {}
    if effect and "effects" not in device.options.__dataclass_fields__:
        raise ParameterError(f"--effect: driver {driver!r} does not simulate effects")
    truth = console.parameters(parameters)
    options = device.options(robot=robot, parameters=truth, noise=noise, seed=seed, **extra)
    with device(options) as link, console.progress(f"recording {robot}", len(todo)) as tell:
        done = wb.record(link, todo, out, samples=samples, rate=rate, progress=tell)
    result = {"recording": str(out), "robot": robot, "mode": todo.mode, "rows": done.rows,
              "visited": done.visited, "seconds": done.seconds}  # fmt: skip
    kind = "poses" if todo.points is None else "touches"
    what = f"{done.visited} {kind}" if todo.mode == "static" else f"{done.rows} samples of motion"
    text = f"recorded {what}, {done.rows} rows, {done.seconds:.0f} s of {driver} time → {out}"
    console.answer(result, as_json, text)


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
    console.check_out(out, map, *files)
    imported = wb.import_files(files, wb.read_map(map))
    imported.recording.write(out)
    rows = len(imported.recording)
    result = {"recording": str(out), "rows": rows, "rows_left_out": imported.left_out}
    left = f", {imported.left_out} outside the other files' times left out" * (
        imported.left_out > 0
    )
    console.answer(result, as_json, f"imported {rows} rows{left} → {out}")


def calibrate(
    recording: tyro.conf.Positional[Path],
    /,
    out: Path | None = None,
    free: tuple[str, ...] = (),
    hold: tuple[str, ...] = (),
    prior: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    loss: Literal["linear", "huber", "student"] = "linear",
    touches: Path | None = None,
    touch_std: float | None = None,
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
        touches: Recording of touches (columns px py pz) of the same robot, fitted together.
        touch_std: With --touches: how far the tip sits from its point, per axis [m]; 5e-5.
        loss: Huber and Student's t resist outliers.
        truth: JSON {name: value} of a simulated robot, shown beside the estimates.
        as_json: Print the result as JSON.
    """
    options = wb.Options(free or None, hold, prior, loss)
    console.check_out(out, recording, touches, truth)
    known = None if truth is None else console.parameters(truth)
    data = wb.Recording.read(recording)
    if touches is None and touch_std is not None:
        raise ParameterError("--touch-std goes with --touches")
    spread = {} if touch_std is None else {"std": touch_std}
    seats = None if touches is None else wb.Touches.of(wb.Recording.read(touches), **spread)
    fit = wb.calibrate(data, options, seats)
    for name, value in (known or {}).items():
        if name not in fit.theta or isinstance(value, bool) or not isinstance(value, int | float):
            raise ParameterError(f"{truth}: {name!r} = {value!r} is no parameter with a number")
    if out is not None:
        fit.write(out)
    console.answer(fit.to_json(), as_json, tables.fit(fit, known))
    if out is not None and not as_json:
        console.OUT.print(f"fit → {out}", soft_wrap=True, markup=False, highlight=False)
