"""`wrenchbed campaign`: plan, record and calibrate many simulated robots."""

import os
from dataclasses import dataclass
from pathlib import Path

import tyro

import wrenchbed as wb
from wrenchbed.cli import console
from wrenchbed.cli.console import Json
from wrenchbed.data.outputs import Kind
from wrenchbed.errors import MissingExtraError


@dataclass(frozen=True)
class RobotArguments:
    """The simulated robots."""

    robots: int = 100  # Number of them.
    # What differs from robot to robot, with commas: noise, parameters, poses.
    vary: str = "noise,parameters"
    plan: Path | None = None  # That all robots run; random poses if none.
    poses: int = 100  # Of each robot, without --plan.
    samples: int = 50  # Rows a pose.
    seed: int = 0  # All follows from it.

    def fleet(self, robot: str) -> "wb.Fleet":
        """What the rows of the campaign follow from."""
        words = tuple(w.strip() for w in self.vary.split(",") if w.strip())
        plan = None if self.plan is None else wb.Plan.read(self.plan)
        return wb.Fleet(robot, self.robots, words, self.poses, self.samples, self.seed, plan)


def campaign(
    robot: tyro.conf.Positional[str],
    /,
    out: Path,
    simulated: RobotArguments,
    workers: int | None = None,
    as_json: Json = False,
) -> None:
    """Plan, record and calibrate many simulated robots: one row each, and a summary.

    A stopped campaign goes on when the same line is given again; with more robots it grows.

    Args:
        robot: Name of a simulated robot.
        out: Folder for robots.parquet and summary.html, .md and figures.
        workers: Processes; as many as cores if left out.
        as_json: Print the key results as JSON.
    """
    from wrenchbed.campaigns import summary

    fleet = simulated.fleet(robot)
    console.check_folder(out, {"summary.html": Kind.PAGE})
    count = console.check_positive("--workers", os.cpu_count() or 1 if workers is None else workers)
    with console.progress(f"campaign {robot}", simulated.robots) as report:
        table = wb.campaign(fleet, out, workers=count, progress=report)
    results = summary.figures(table)
    written = ["robots.parquet"]
    try:
        summary.page(fleet, table, out, console.command()).write(out, "summary")
        written += ["summary.html", "summary.md"]
    except MissingExtraError as error:
        console.say(f"no summary: {error}")
    lines = [f"{n.replace('_', ' '):32}{v:12.6g}" for n, v in results.items() if v is not None]
    lines.append(f"{', '.join(written)} → {out}")
    console.answer(results | {"folder": str(out)}, as_json, "\n".join(lines))
