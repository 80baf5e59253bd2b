"""The verb that works on many simulated robots."""

import os
from pathlib import Path
from typing import Annotated, Any

import tyro

import wrenchbed as wb
from wrenchbed.cli import console
from wrenchbed.cli.console import Json
from wrenchbed.errors import MissingExtraError, ParameterError
from wrenchbed.files import write_json


def campaign(
    robot: tyro.conf.Positional[str],
    /,
    out: Path,
    robots: int = 100,
    vary: str = "noise,parameters",
    plan: Path | None = None,
    poses: int = 100,
    samples: int = 50,
    diagnose: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    workers: int | None = None,
    scheduler: str | None = None,
    only: int | None = None,
    seed: int = 0,
    as_json: Json = False,
) -> None:
    """Plan, record, calibrate and diagnose many simulated robots: one row each, and a summary.

    A stopped campaign goes on when the same line is given again; with more robots it grows.

    Args:
        robot: Name of a simulated robot.
        out: Folder for robots.parquet and summary.html, .md and figures.
        robots: Number of them.
        vary: What differs from robot to robot, with commas: noise, parameters, effects, poses.
        plan: That all robots run; random poses if none.
        poses: Of each robot, without --plan.
        samples: Rows a pose.
        diagnose: Also diagnose each recording, a second or more each.
        workers: Local processes; as many as cores if left out.
        scheduler: Address of a Dask scheduler, tcp://…, whose workers are used instead.
        only: Work on this robot alone and write its recording and fit to OUT/NUMBER.
        seed: All follows from it.
        as_json: Print the key results as JSON.
    """
    words = tuple(w.strip() for w in vary.split(",") if w.strip())
    chosen = None if plan is None else wb.Plan.read(plan)
    fleet = wb.Fleet(robot, robots, words, poses, samples, seed, diagnose, chosen)
    if only is not None:
        _alone(fleet, only, out, as_json)
        return
    count = workers if workers is not None else os.cpu_count() or 1
    if count < 1:
        raise ParameterError(f"--workers {count} must be at least 1")
    with console.progress(f"campaign {robot}", robots, rate=True) as tell:
        table = wb.campaign(fleet, out, workers=count, scheduler=scheduler, progress=tell)
    from wrenchbed.campaigns import summary

    told = summary.figures(table)
    written = ["robots.parquet"]
    try:
        summary.page(fleet, table).write(out, "summary")
        written += ["summary.html", "summary.md"]
    except MissingExtraError as error:
        console.OUT.print(f"no summary: {error}", markup=False)
    lines = [f"{n.replace('_', ' '):32}{v:12.6g}" for n, v in told.items() if v is not None]
    lines.append(f"{', '.join(written)} → {out}")
    console.answer(told | {"folder": str(out)}, as_json, "\n".join(lines))


def _alone(fleet: Any, k: int, out: Path, as_json: bool) -> None:
    """One robot again, with its files."""
    from wrenchbed.campaigns.one_robot import one, recorded

    if k < 0:
        raise ParameterError(f"--only {k} must not be negative")
    folder = out / str(k)
    recording, _ = recorded(fleet, k)
    recording.write(folder / "rec.parquet")
    wb.calibrate(wb.Recording.read(folder / "rec.parquet")).write(folder / "fit.json")
    row = {n: v for n, v in one(fleet, k).items() if v == v}  # without NaN
    write_json(folder / "row.json", row)
    console.answer(row, as_json, f"robot {k}: rec.parquet, fit.json, row.json → {folder}")
