"""The verbs with few options: list, simulate, compare, campaign, study, doctor, view, report."""

import os
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

import tyro
from rich.console import Group
from rich.text import Text

import wrenchbed as wb
from wrenchbed.cli import console
from wrenchbed.cli.console import Json
from wrenchbed.data.overwrite_rules import Kind, keeping
from wrenchbed.errors import MissingExtraError

Kinds = Literal[
    "robots", "sensors", "drivers", "transducers", "emulators", "twins", "effects", "channels",
    "exports", "checks",
]  # fmt: skip
_MARKS = {"ok": ("ok", "green"), "note": ("note", "yellow"), "fails": ("FAILS", "bold red")}
"""Word and style by grade of a line of `doctor`."""


def list_(kind: tyro.conf.Positional[Kinds], /, as_json: Json = False) -> None:
    """List what exists, one line each.

    Args:
        kind: Kind of plug-in; effects with the channels in which they show: those of the wrench, or
            of the joint efforts; checks: what a recording is examined for before it is calibrated.
    """
    from wrenchbed.calibration.checks.finding import REASONS

    kind = "emulators" if kind == "twins" else kind
    rows = dict(REASONS) if kind == "checks" else wb.descriptions(kind)
    rows |= wb.SimDriver.drive_faults() if kind == "effects" else {}
    table = console.table()
    for name, text in rows.items():
        channel = "effort" if name.startswith("drive.") else "wrench"
        channels = (channel,) if kind == "effects" else ()
        table.add_row(Text(name, style="bold"), *channels, text)
    console.answer(rows, as_json, table)


def simulate(
    twin: tyro.conf.Positional[Path],
    /,
    like: Path,
    out: Path,
    noise: Literal["off", "white", "real"] = "off",
    seed: int = 0,
    force: bool = False,
    as_json: Json = False,
) -> None:
    """Run MuJoCo with a twin's effects on a recording's motion.

    Args:
        twin: JSON file, see `wrenchbed diagnose`.
        like: Recording whose times and joint values it follows.
        out: Recording to write.
        noise: Noise of the simulated sensor.
        seed: Seed of the noise and of what effects draw.
        force: Replace a recording at OUT; it is kept as OUT~, or OUT~2 and so on.
    """
    console.check_seed(seed)
    console.check_out(out, Kind.RECORDING, twin, like, force=force)
    simulated = wb.simulate(wb.Twin.read(twin), wb.Recording.read(like), noise=noise, seed=seed)
    keeping(out, simulated.write)
    rows = len(simulated)
    result = {"recording": str(out), "like": str(like), "rows": rows}
    console.answer(result, as_json, f"simulated {rows} rows of {like} → {out}")


def compare(
    a: tyro.conf.Positional[Path],
    b: tyro.conf.Positional[Path],
    /,
    out: Path | None = None,
    as_json: Json = False,
) -> None:
    """Say what changed from A to B, and by how many σ: two fits, recordings or diagnoses.

    Args:
        a: fit.json, a recording, diagnosis.json or its folder.
        b: Another one of the same kind and robot.
        out: HTML page to write.
    """
    console.check_out(out, Kind.PAGE, a, b)
    result = wb.compare(a, b)
    if out is not None:
        result.page(console.command()).write(out)
    console.answer(result.to_json(), as_json, compared(result))


def compared(result: wb.Comparison) -> Group:
    """Displays of a comparison: its sentences, then a table of all compared numbers."""
    table = console.table("|", ">A", ">B", ">B − A", ">σ", space=1)
    for c in result.changes:
        table.add_row(*c.cells, style="bold" if c.changed else "")
    parts = [Text(s, style="bold" if k == 0 else "") for k, s in enumerate(result.sentences)]
    unlike = [Text(f"not compared  {x}", style="dim") for x in result.left]
    numbers = Group("", table) if result.changes else ""
    return Group(*parts, numbers, *([""] if unlike else []), *unlike)


@dataclass(frozen=True)
class RobotArguments:
    """Options of `campaign`: number of simulated robots, what varies, poses, samples, seed."""

    robots: int = 100  # Number of robots.
    # What differs from robot to robot, with commas: noise, parameters, poses.
    vary: str = "noise,parameters"
    plan: Path | None = None  # Plan that all robots run; random poses if none.
    poses: int = 100  # Poses of each robot, without --plan.
    samples: int = 50  # Rows a pose.
    seed: int = 0  # Seed of everything random.

    def fleet(self, robot: str) -> "wb.Fleet":
        """Make the settings of a campaign (many simulated robots), which determine its table."""
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


def study(
    paper: tyro.conf.Positional[Literal["medrue", "ur5"]],
    /,
    out: Path | None = None,
    quick: bool = False,
    robots: int | None = None,
    seed: int = 0,
    as_json: Json = False,
) -> None:
    """Reproduce a paper's tables and figures on MuJoCo data, beside its numbers and error bounds.

    A stopped study goes on where it stopped.

    Args:
        paper: medrue (Sensors 2016, 16, 798) or ur5 (installation error of a force sensor).
        out: Folder for tables (Markdown, HTML), figures (SVG) and results (Parquet).
        quick: A small version, a minute or two.
        robots: Random MedRUE robots (200, quick 8), or repetitions on the UR5 (20, quick 3).
        seed: Seed of everything random.
    """
    from wrenchbed import studies

    console.check_seed(seed)
    folder = Path("out") / f"study-{paper}" if out is None else out
    console.check_folder(folder, {f"{paper}.html": Kind.PAGE})
    with console.progress(f"study {paper}", studies.steps(paper, quick, robots)) as report:
        page = studies.run(
            paper, folder, quick=quick, robots=robots, seed=seed, report=report,
            command=console.command(),
        )  # fmt: skip
    written = f"tables and figures → {folder / paper}.html, {folder / paper}.md"
    console.answer(page.summary, as_json, page.lead, written)


def doctor_(
    robot: str = "ur5",
    host: str | None = None,
    sensor: str | None = None,
    seconds: float = 3.0,
    as_json: Json = False,
) -> int:
    """Look at a UR robot and its sensor, and say what would fail. Moves nothing.

    Exit code 0: nothing fails; 3: something would; 1: an error.

    Args:
        robot: Name of the arm that recordings will be made with.
        host: Address of the robot's controller.
        sensor: HOST of a Net F/T box, or its address: netft://HOST.
        seconds: Time for which each stream is watched [s].
    """
    from wrenchbed.hardware.drivers.rtde.doctor import doctor

    lines = doctor(wb.load("robots", robot), host or "", sensor or "", seconds)
    ok = all(line.grade != "fails" for line in lines)
    table = console.table()
    for line in lines:
        word, style = _MARKS[line.grade]
        text = Text(line.found)
        if line.remedy:
            text.append(f"\n→ {line.remedy}", style="dim")
        table.add_row(Text(word, style=style), Text(line.name, style="bold"), text)
    console.answer({"ok": ok, "lines": [asdict(line) for line in lines]}, as_json, table)
    return 0 if ok else 3


def view(
    recording: tyro.conf.Positional[Path],
    against: tyro.conf.Positional[tuple[Path, ...]] = (),
    /,
    rrd: Path | None = None,
    port: int = 9876,
) -> None:
    """Look at a recording with what simulators predict, at a plan or at a diagnosis, in rerun.

    Args:
        recording: Parquet file, of a plan too; the folder of a diagnosis; or an .rrd file.
        against: fit.json and twin.json files whose simulators are compared with it.
        rrd: Write this file and open nothing.
        port: Port of the viewer's data, on 127.0.0.1.
    """
    console.check_out(rrd, Kind.PICTURE, recording, *against)
    wb.view(recording, against, rrd=rrd, port=port)
    if rrd is not None:
        console.say(f"view → {rrd}")


def report(
    recording: tyro.conf.Positional[Path],
    against: tyro.conf.Positional[tuple[Path, ...]] = (),
    /,
    out: Path = Path("report.html"),
) -> None:
    """Write one HTML page about a recording, what simulators predict for it, and fits.

    A diagnosis writes its own report, see `wrenchbed diagnose`.

    Args:
        recording: Parquet file.
        against: fit.json and twin.json files whose simulators are compared with it.
        out: Page to write.
    """
    console.check_out(out, Kind.PAGE, recording, *against)
    wb.report(wb.Recording.read(recording), against, out, console.command())
    console.say(f"report → {out}")
